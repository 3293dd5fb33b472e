//! The engine's warnings: counted, never printed; those that mean wrong results become errors.

#[cfg(doc)]
use super::error::Error;
use super::ffi;

pub(super) const KINDS: usize = ffi::mjNWARNING as usize;

/// What the engine warns of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum WarningKind {
    /// The inertia matrix is close to singular.
    Inertia,
    /// The contact list was full; also reported as [`Error::BufferFull`].
    ContactsFull,
    /// The constraint rows were full; also reported as [`Error::BufferFull`].
    ConstraintsFull,
    /// Too many shapes to draw.
    DrawnShapesFull,
    /// Bad position, the simulation was reset; also reported as [`Error::Diverged`].
    BadPosition,
    /// Bad velocity, the simulation was reset; also reported as [`Error::Diverged`].
    BadVelocity,
    /// Bad acceleration, the simulation was reset; also reported as [`Error::Diverged`].
    BadAcceleration,
    /// Bad control; also reported as [`Error::BadControl`].
    BadControl,
    /// Anything else that the engine warned of, as text.
    Other,
}

/// Warnings of one kind since they were last taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Warning {
    /// What the engine warns of.
    pub kind: WarningKind,
    /// How often (1 for [`WarningKind::Other`], whose texts are kept once each).
    pub count: u64,
    /// The engine's number with the last one: a degree of freedom, a buffer size, an actuator, ...
    pub info: i32,
    /// Simulation time at the start of the last call that warned, s.
    pub time: f64,
    /// The engine's text for [`WarningKind::Other`], else empty.
    pub text: String,
}

/// The tally of a simulation.
#[derive(Debug, Clone, Default)]
pub(super) struct Warnings {
    pub counted: [Tally; KINDS],
    pub texts: Vec<(f64, String)>,
}

/// Of one kind; see [`Warning`].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub count: u64,
    pub info: i32,
    pub time: f64,
}
