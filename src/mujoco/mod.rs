//! A safe binding to MuJoCo 2.2.2 and 3.x: the only place in the crate with unsafe code.
//!
//! - [`Model`]: loading ([`isolate_loading`]: in a child process); everything readable is on [`CompiledModel`].
//! - [`Simulation`]: a private copy of a model and its data; steps whole or in [`stages`], [`Contact`]s, Jacobians,
//!   constraint [`rows`], [`State`]s. The engine's numeric arrays are methods with the engine's names.
//! - [`Renderer`]: pictures, drawn offscreen without a display. [`Screen`]: the same in a window; [`Scene`] is what both
//!   draw, [`Camera`] and [`Perturb`] follow the mouse.
//! - [`Error`]: engine faults, dropped contacts, resets by the engine. Nothing is printed, logged or ended by MuJoCo.

mod arrays;
#[cfg(feature = "render")]
mod arrow;
mod borrowed;
#[cfg(feature = "render")]
mod camera;
mod collision;
mod compat;
mod compiled;
mod contact;
mod data_arrays;
#[cfg(feature = "render")]
mod egl;
mod error;
pub(crate) mod ffi;
#[cfg(feature = "view")]
mod figure;
mod foreign;
mod frozen;
mod guard;
mod ids;
mod isolation;
mod jacobian;
mod kinds;
mod model;
mod model_arrays;
mod options;
#[cfg(feature = "render")]
mod painter;
#[cfg(feature = "render")]
mod perturb;
mod poses;
#[cfg(feature = "view")]
mod rect;
#[cfg(feature = "render")]
mod render;
pub mod rows;
mod scan;
#[cfg(feature = "render")]
mod scene;
#[cfg(feature = "view")]
mod screen;
#[cfg(feature = "render")]
mod segment;
mod shown;
mod simulation;
pub mod stages;
mod state;
mod vfs;
mod warning_counters;
mod warnings;
#[cfg(feature = "view")]
mod window_context;

#[cfg(feature = "render")]
pub use arrow::Arrow;
#[doc(hidden)]
pub use borrowed::Borrowed;
#[cfg(feature = "render")]
pub use camera::Camera;
#[cfg(feature = "rerun")]
pub(crate) use camera::LAST_DRAWN_GROUP;
pub use collision::{Clearance, GeomSets, PairCollider};
pub use compat::MassRows;
pub use compiled::CompiledModel;
pub use contact::{Contact, ContactForce};
pub use error::{Buffer, Error};
#[cfg(feature = "view")]
pub use figure::{Figure, Line};
pub use ids::{
    ActuatorId, BodyId, CameraId, EqualityId, GeomId, Id, JointId, KeyframeId, MeshId, SensorId, SiteId, TendonId,
};
pub use isolation::isolate_loading;
pub use kinds::{
    Cone, EqualityKind, GeomKind, Integrator, JacobianStorage, JointKind, RowKind, RowState, Solver, TransmissionKind,
    WrapKind,
};
pub use model::Model;
#[cfg(feature = "render")]
pub use perturb::{Drag, Perturb, Pull};
#[cfg(feature = "view")]
pub use rect::Rect;
#[cfg(feature = "render")]
pub use render::{Drawing, Renderer, Tint};
pub use rows::ConstraintRow;
#[cfg(feature = "render")]
pub use scene::{Picked, Scene};
#[cfg(feature = "view")]
pub use screen::{Corner, Screen};
#[cfg(feature = "render")]
pub use segment::Segment;
pub use simulation::Simulation;
pub(crate) use simulation::Stamp;
pub(crate) use stages::{EngineStages, Hooks};
pub use state::State;
pub use warnings::{Warning, WarningKind};
#[cfg(feature = "view")]
pub(crate) use window_context::no_window;

/// The MuJoCo version that this crate was built for, e.g. "2.2.2".
pub fn mujoco_version() -> String {
    compat::header_version()
}

/// Disable flag: `solref` is used as it is, even if it is too stiff for the time step.
pub const DISABLE_REFSAFE: u32 = ffi::mjDSBL_REFSAFE;
