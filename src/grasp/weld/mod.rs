//! The thesis's constraint, Eqs. 4.1 to 4.3: one weld between the target and the merged fingertips, with bounds ("box") or
//! without ("rigid").
mod bilateral;
pub(crate) mod bounded_rows;
pub(crate) mod bounds;
mod impedance;
mod merged_hand;
pub(crate) mod rows;
mod six;
mod soft_axes;
pub(crate) mod solve;
mod tree_factor;
