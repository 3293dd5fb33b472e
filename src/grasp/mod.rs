//! Grasps: contacts -> quality -> phase -> constraint.
pub mod cones;
pub mod contact;
mod controller;
mod error;
mod force;
mod frozen;
mod grasps;
pub(crate) mod hand;
pub(crate) mod linalg;
#[cfg(feature = "metrics")]
pub mod metrics;
pub mod monitor;
mod settings;
mod snapshot;
pub(crate) mod spec;
mod state;
mod step;
pub(crate) mod weld;
mod weld_rows;

pub use cones::solve::SolveStatus;
pub use contact::contacts::GraspContact;
pub use controller::Grasp;
pub use error::Error;
pub use frozen::TOLERANCE as FROZEN_TOLERANCE;
pub use grasps::{GraspId, Grasps};
pub use hand::search::find_hand;
pub use monitor::phase::Phase;
pub use snapshot::Snapshot;
pub use spec::{
    DEFAULT_LATCH_TIME, DEFAULT_RELEASE_TIME, GraspSpec, LATCH_PER_WEIGHT, Limits, RELEASE_PER_LATCH,
    default_latch_quality, default_release_quality, weight,
};
pub use state::{GraspState, GraspsState};
pub use step::{StageClock, engine_step_timed};
pub use weld::bounds::Bounds;
pub use weld::rows::weld_xml;
