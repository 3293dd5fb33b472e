//! Grasps: contacts -> quality -> phase -> constraint.
pub mod arrow;
pub mod closure;
pub mod cone;
mod conic;
mod contacts;
mod controller;
pub mod dense;
mod detector;
mod error;
pub mod gram;
pub mod hull;
pub mod mobility;
pub mod phase;
pub mod quality;
mod quickhull;
pub mod softness;
pub mod solve;
mod step;
pub mod topology;
pub mod wrench;

pub use contacts::GraspContact;
pub use controller::{DEFAULT_LATCH_TIME, Grasp, GraspSpec, Limits};
pub use error::Error;
pub use phase::Phase;
pub use step::{StageClock, engine_step_timed, step, step_timed};
