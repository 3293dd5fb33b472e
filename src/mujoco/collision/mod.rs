//! Collision detection in parts: the engine's narrow phase for chosen pairs, and the certainty that no other pair touches.
//!
//! - [`PairCollider`] (`narrow_phase`) runs the engine's collision functions for some of the `pairs` that it tests, and
//!   gives their contacts the engine's `parameters`.
//! - [`Clearance`] watches all other pairs: their `distances`, from separating planes (`gjk`) between `shape`s, and how
//!   far bodies have `travel`led since, by bounds of their `motion`.

mod clearance;
mod distances;
mod gjk;
mod motion;
mod narrow_phase;
mod pairs;
mod parameters;
mod shape;
mod travel;

pub use clearance::{Clearance, GeomSets};
pub use narrow_phase::PairCollider;
