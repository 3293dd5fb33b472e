//! What can go wrong between this crate and the engine.

use super::compat;
use std::fmt;
use std::path::PathBuf;

/// Any failure of the binding. Every message says what, where, and what would be right.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The library found at run time is not the one that the crate was built against.
    #[error(
        "the MuJoCo library is version {library}, but mujoco-grasp was built with the headers of {header}: run it with that library, or build again"
    )]
    Version {
        /// Version of the headers.
        header: String,
        /// Version of the library.
        library: String,
    },

    /// A file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },

    /// A model did not load; `message` is MuJoCo's own text.
    #[error("{what} does not load: {message}")]
    Load {
        /// The file, or what the text is.
        what: String,
        /// MuJoCo's error text.
        message: String,
    },

    /// A name that the model does not have.
    #[error("the model has no {kind} named {name:?}{hint}")]
    UnknownName {
        /// "body", "joint", ...
        kind: &'static str,
        /// The name asked for.
        name: String,
        /// Close names and some that exist, ready to print.
        hint: String,
    },

    /// An index outside the model's or the data's range.
    #[error("{kind} {index} does not exist: there are {count}")]
    OutOfRange {
        /// "body", "contact", ...
        kind: &'static str,
        /// The index asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },

    /// What was made for one model is used with a simulation of another.
    #[error(
        "{what} is used with a simulation of another model than it was made for: make one for each model that is loaded"
    )]
    OtherModel {
        /// "a renderer", ...
        what: &'static str,
    },

    /// The engine reported a fault inside a call.
    #[error("MuJoCo fault in {call}: {message}")]
    Engine {
        /// The engine function.
        call: &'static str,
        /// The engine's text.
        message: String,
    },

    /// An earlier fault interrupted the engine, so its results are not to be trusted.
    #[error(
        "the simulation was interrupted by a fault in {call} ({message}): reset it or restore a saved state before going on"
    )]
    Interrupted {
        /// The engine function that failed.
        call: &'static str,
        /// The engine's text.
        message: String,
    },

    /// A buffer of fixed size is full, and the engine has dropped contacts or constraint rows.
    #[error("the {buffer} buffer is full ({size} places) at time {time} s, so MuJoCo dropped some: raise {buffer_attribute} in the model's <size> element", buffer_attribute = buffer.attribute())]
    BufferFull {
        /// Which one.
        buffer: Buffer,
        /// Its size.
        size: usize,
        /// Simulation time at the start of the call, s.
        time: f64,
    },

    /// A position, velocity or acceleration became NaN or huge, and the engine reset the simulation.
    #[error(
        "the simulation diverged at time {time} s: bad {quantity}[{index}] ({element}); MuJoCo has reset it to its initial configuration at time 0: restore a saved state, and look for a smaller time step or softer constraints"
    )]
    Diverged {
        /// "qpos", "qvel" or "qacc".
        quantity: &'static str,
        /// Index into it.
        index: usize,
        /// The joint that it belongs to, ready to print.
        element: String,
        /// Simulation time at the start of the call, s.
        time: f64,
    },

    /// A control was NaN or huge; the engine has applied zero to every actuator instead.
    #[error(
        "the control of {actuator} is {value} at time {time} s, so MuJoCo set all controls to zero: give finite controls"
    )]
    BadControl {
        /// The actuator, ready to print.
        actuator: String,
        /// The value given.
        value: f64,
        /// Simulation time at the start of the call, s.
        time: f64,
    },

    /// A slice has the wrong length.
    #[error("{what} has {got} numbers; {expected} are needed")]
    Length {
        /// Which argument.
        what: &'static str,
        /// The length needed.
        expected: usize,
        /// The length given.
        got: usize,
    },

    /// A number that is not allowed.
    #[error("{what} is {value}: it must be {rule}")]
    Value {
        /// Which quantity.
        what: &'static str,
        /// The value given.
        value: f64,
        /// What would be right.
        rule: &'static str,
    },

    /// A picture could not be drawn.
    #[error("cannot draw a picture: {0}")]
    Rendering(String),

    /// A window could not be opened.
    #[error("cannot open a window: {0}")]
    Window(String),

    /// Something that this crate does not do with this model.
    #[error("{0}")]
    Unsupported(String),
}

/// One of the engine's buffers of fixed size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Buffer {
    /// The contact list (nconmax).
    Contacts,
    /// The constraint rows (njmax).
    Constraints,
}

impl Buffer {
    /// The attribute of `<size>` that sets its size.
    pub fn attribute(self) -> &'static str {
        match self {
            Buffer::Contacts => compat::SIZE_OF_CONTACTS,
            Buffer::Constraints => compat::SIZE_OF_CONSTRAINTS,
        }
    }
}

impl fmt::Display for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Buffer::Contacts => "contact",
            Buffer::Constraints => "constraint",
        })
    }
}

/// `Ok` if `got == expected`.
pub(super) fn check_length(what: &'static str, expected: usize, got: usize) -> Result<(), Error> {
    if got == expected { Ok(()) } else { Err(Error::Length { what, expected, got }) }
}

/// `Ok` if `index < count`.
pub(super) fn check_index(kind: &'static str, index: usize, count: usize) -> Result<(), Error> {
    if index < count { Ok(()) } else { Err(Error::OutOfRange { kind, index, count }) }
}

/// `Ok` if `value` is finite and satisfies `ok`.
pub(super) fn check_value(
    what: &'static str,
    value: f64,
    rule: &'static str,
    ok: impl FnOnce(f64) -> bool,
) -> Result<(), Error> {
    if value.is_finite() && ok(value) { Ok(()) } else { Err(Error::Value { what, value, rule }) }
}
