//! Sweeps: many grasps of one scenario, each closed, shaken and pushed. Which survive?
//!
//! ```text
//! file -> grid -> trial -> table
//! (TOML) (grasps) (one)   (Parquet, `run` writes a file for every so many grasps)
//! ```
//! A row depends on the spec and on the grasp's id alone: not on the shard, the file, the thread or the machine's load.
mod file;
mod grid;
mod parameter;
mod run;
mod shard;
mod table;
mod trial;

use std::path::{Path, PathBuf};

pub use file::{FamilyEntry, LoadEntry, SweepFile, Values};
pub use grid::Case;
pub use run::{Report, Spread, run};
pub use shard::Shard;
pub use trial::{Row, Verdict};

use super::error::{Error, Field};
use super::plan::Plan;
use super::source::Source;
use parameter::Parameter;

/// A spec whose every name exists on its scenario's model, with all its grasps.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// The spec.
    pub spec: SweepFile,
    /// The spec's path, for messages.
    pub file: PathBuf,
    /// The scenario; its [`Stop`](super::stop::Stop) ends the sweep.
    pub plan: Plan,
    /// Every grasp, in the order of the spec.
    pub cases: Vec<Case>,
    /// Text of the scenario's file.
    scenario: String,
    /// What is varied, by name; the order is that of [`Case::values`].
    parameters: Vec<(String, Parameter)>,
}

impl Sweep {
    /// Reads a spec, its scenario and its tables; all paths in it are relative to its folder.
    ///
    /// # Errors
    /// Any [`Error`] that is bad input.
    pub fn load(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::Spec { file: path.to_path_buf(), source })?;
        let spec = SweepFile::parse(&text, path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let scenario = |e| Field::new(path, "scenario").wrong(format!("is \"{}\": {e}", spec.scenario));
        let source = Source::find_in(folder, &spec.scenario).map_err(scenario)?;
        let plan = Plan::of_source(&source, None)?;
        spec.check_on(&plan, path)?;
        let (fields, cases) = grid::expand(&spec, path)?;
        let parameters = fields
            .into_iter()
            .map(|(name, field)| match Parameter::named(&plan, &name) {
                Ok(parameter) => Ok((name, parameter)),
                Err(problem) => Err(Field::new(path, &field).wrong(problem)),
            })
            .collect::<Result<_, Error>>()?;
        let scenario = source.text.into_owned();
        Ok(Self { spec, file: path.to_path_buf(), plan, cases, scenario, parameters })
    }

    /// Number of grasps that a shard has.
    pub fn grasps_of(&self, shard: Shard) -> usize {
        self.parts(shard).map(|(_, cases)| cases.len()).sum()
    }

    /// Number and grasps of each file that a shard has.
    fn parts(&self, shard: Shard) -> impl Iterator<Item = (usize, &[Case])> {
        let size = self.spec.grasps_per_file;
        let of = move |file: usize| &self.cases[file * size..self.cases.len().min((file + 1) * size)];
        shard.files(self.cases.len().div_ceil(size)).map(move |file| (file, of(file)))
    }
}
