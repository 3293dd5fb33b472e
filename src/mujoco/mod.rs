//! A safe binding to MuJoCo 2.2.2 and 3.x: the only place in the crate with unsafe code.
//!
//! - [`Model`]: loading ([`isolate_loading`]: in a child process); everything readable is on [`CompiledModel`].
//! - [`Simulation`]: a private copy of a model and its data; steps whole or in [`stages`], [`Contact`]s, Jacobians,
//!   constraint [`rows`], [`State`]s. The engine's numeric arrays are methods with the engine's names.
//! - [`Renderer`]: pictures, drawn offscreen without a display.
//! - [`Error`]: engine faults, dropped contacts, resets by the engine. Nothing is printed, logged or ended by MuJoCo.

mod arrays;
mod arrow;
mod broad;
mod camera;
mod clearance;
mod collider;
mod compat;
mod compiled;
mod contact;
mod data_arrays;
mod egl;
mod error;
pub(crate) mod ffi;
mod foreign;
mod guard;
mod ids;
mod isolation;
mod jacobian;
mod kinds;
mod ledger;
mod mixing;
mod model;
mod model_arrays;
mod options;
mod pairs;
mod placement;
mod poses;
mod proximity;
mod render;
pub mod rows;
mod scan;
mod separation;
mod shape;
mod shown;
mod simulation;
pub mod stages;
mod state;
mod vfs;
mod warnings;

pub use arrow::Arrow;
pub use camera::Camera;
pub use clearance::Clearance;
pub use collider::PairCollider;
pub use compat::MassFactor;
pub use compiled::CompiledModel;
pub use contact::{Contact, ContactForce};
pub use error::{Buffer, Error};
pub use ids::{
    ActuatorId, BodyId, CameraId, EqualityId, GeomId, Id, JointId, KeyframeId, MeshId, SensorId, SiteId, TendonId,
};
pub use isolation::isolate_loading;
pub use kinds::{
    Cone, EqualityKind, GeomKind, Integrator, JacobianStorage, JointKind, RowKind, RowState, Solver, TransmissionKind,
    WrapKind,
};
pub use model::Model;
pub use render::{Drawing, Renderer};
pub use rows::ConstraintRow;
pub use simulation::Simulation;
pub use state::State;
pub use warnings::{Warning, WarningKind};

/// The MuJoCo version that this crate was built for, e.g. "2.2.2".
pub fn mujoco_version() -> String {
    compat::header_version()
}

/// Disable flag: `solref` is used as it is, even if it is too stiff for the time step.
pub const DISABLE_REFSAFE: u32 = ffi::mjDSBL_REFSAFE;
/// Enable flag: energies are computed in every step.
pub const ENABLE_ENERGY: u32 = ffi::mjENBL_ENERGY;
