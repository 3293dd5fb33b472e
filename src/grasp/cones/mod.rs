//! The form "cones": MuJoCo's own contact problem, exact, with the fingers' joints eliminated.
pub mod arrow;
pub(crate) mod coupled;
pub(crate) mod dynamics;
pub(crate) mod inverse_inertia;
pub(crate) mod joint_groups;
pub(crate) mod solve;
