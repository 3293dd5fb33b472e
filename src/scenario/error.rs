//! What can be wrong with a scenario, and with running it.

use std::path::{Path, PathBuf};

/// Errors of scenarios. Messages name the file, the field, and what would be right.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Neither a built-in scenario nor a file.
    #[error(
        "no built-in scenario and no file is called \"{name}\"; built in are {known}; or give the path of a scenario file"
    )]
    Unknown {
        /// What was asked for.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}; give a built-in scenario's name or the path of a scenario file", file.display())]
    Read {
        /// The scenario file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A model was given in the place of a scenario.
    #[error(
        "{}: is XML, as an MJCF is; give a scenario file: TOML that names the MJCF as its `model` (docs/reference.md)", file.display()
    )]
    Mjcf {
        /// The file.
        file: PathBuf,
    },
    /// The spec of a sweep cannot be read.
    #[error("{}: cannot be read: {source}; give the path of a sweep's spec", file.display())]
    Spec {
        /// The spec.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file of results is there and not of this sweep.
    #[error("{}: {problem}; give another folder, or remove it", file.display())]
    Part {
        /// The file.
        file: PathBuf,
        /// What it is.
        problem: String,
    },
    /// A recorded session cannot be replayed.
    #[error("{}: {problem}", file.display())]
    Recording {
        /// The recording.
        file: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The text is no scenario, or no spec.
    #[error("{}: {source}", file.display())]
    Parse {
        /// The scenario file.
        file: PathBuf,
        /// Where in the text, and why.
        source: Box<toml::de::Error>,
    },
    /// A field has a value that makes no sense.
    #[error("{}: {field} {problem}", file.display())]
    Field {
        /// The scenario file.
        file: PathBuf,
        /// The field, as in `push[0].duration`.
        field: String,
        /// What it is and what would be right.
        problem: String,
    },
    /// The MJCF cannot be loaded.
    #[error("{}: model: cannot load {}: {source}", file.display(), model.display())]
    Model {
        /// The scenario file.
        file: PathBuf,
        /// The MJCF.
        model: PathBuf,
        /// MuJoCo's own message.
        source: crate::mujoco::Error,
    },
    /// An option that makes no sense.
    #[error("{option} is {value}; {expected}")]
    Option {
        /// As on the command line.
        option: &'static str,
        /// What was given.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
    /// A grasp cannot be set up on this model.
    #[error("{}: grasp[{index}]: {source}", file.display())]
    Grasp {
        /// The scenario file.
        file: PathBuf,
        /// Which `[[grasp]]`.
        index: usize,
        /// Why.
        source: crate::grasp::Error,
    },
    /// Inverse kinematics cannot be set up.
    #[error("{}: goal: {source}", file.display())]
    Goal {
        /// The scenario file.
        file: PathBuf,
        /// Why.
        source: crate::kinematics::Error,
    },
    /// The simulation stopped before its end.
    #[error("{what}, at {time:.3} s: {source}")]
    Step {
        /// Which run.
        what: String,
        /// Simulation time \[s\].
        time: f64,
        /// Why.
        source: crate::grasp::Error,
    },
    /// The simulation was asked to stop, as by Ctrl-C, before its end.
    #[error("interrupted")]
    Interrupted,
    /// The quality of a grasp cannot be computed.
    #[error("the quality of the grasp: {0}")]
    Quality(#[source] crate::grasp::metrics::quality::QualityError),
    /// MuJoCo refused something outside a step.
    #[error(transparent)]
    Engine(#[from] crate::mujoco::Error),
    /// A result cannot be written.
    #[error("{}: cannot be written: {source}", file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

impl Error {
    /// Whether the user's input is at fault (exit status 2) and not the run (exit status 1).
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Unknown { .. }
            | Self::Read { .. }
            | Self::Mjcf { .. }
            | Self::Spec { .. }
            | Self::Part { .. }
            | Self::Recording { .. }
            | Self::Parse { .. }
            | Self::Field { .. }
            | Self::Model { .. }
            | Self::Option { .. }
            | Self::Grasp { .. }
            | Self::Goal { .. } => true,
            Self::Step { .. } | Self::Interrupted | Self::Quality(_) | Self::Engine(_) | Self::Write { .. } => false,
        }
    }
}

/// A field of a scenario file, to complain about.
pub(super) struct Field<'a> {
    file: &'a Path,
    name: String,
}

impl<'a> Field<'a> {
    pub(super) fn new(file: &'a Path, name: &str) -> Self {
        Self { file, name: name.to_owned() }
    }

    /// The error that says what the field is and what would be right.
    pub(super) fn wrong(self, problem: impl Into<String>) -> Error {
        Error::Field { file: self.file.to_path_buf(), field: self.name, problem: problem.into() }
    }

    /// The error for a name that the model does not have; `source` lists those that it has.
    pub(super) fn unknown(self, source: crate::mujoco::Error) -> Error {
        self.wrong(format!("is unknown: {source}"))
    }
}
