//! The spec of a sweep as it is written: TOML, checked for everything that can be checked without the model.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::scenario::error::{Error, Field};
use crate::scenario::file::{distinct, file_name, finite, non_negative, positive, toml};
use crate::scenario::plan::Plan;

/// A spec. SI units, seconds, radians; see `docs/sweep.md`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SweepFile {
    /// The sweep's name; also that of its folder of results.
    pub name: String,
    /// A built-in scenario's name, or the path of a scenario file, relative to this file.
    pub scenario: String,
    /// What random parameters are drawn with, together with the grasp's id.
    #[serde(default)]
    pub seed: u64,
    /// Iterations of MuJoCo's noslip solver, all of them made, in both modes; left out: the model's.
    #[serde(default)]
    pub noslip: Option<usize>,
    /// Rows of one file of results.
    #[serde(default = "grasps_per_file")]
    pub grasps_per_file: usize,
    /// Time without load after each of the loads \[s\].
    #[serde(default = "rest")]
    pub rest: f64,
    /// Families of grasps, one or more.
    #[serde(default)]
    pub grasp: Vec<FamilyEntry>,
    /// What each grasp has to bear, one after the other.
    #[serde(default)]
    pub load: Vec<LoadEntry>,
}

fn grasps_per_file() -> usize {
    64
}

fn rest() -> f64 {
    0.2
}

/// One `[[grasp]]`: every keyframe with every line of the table, every combination of the lists, and every sample.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FamilyEntry {
    /// Begins the ids of its grasps.
    pub name: String,
    /// Keyframes to start from; left out: the scenario's start.
    #[serde(default)]
    pub keyframes: Vec<String>,
    /// CSV file with a grasp in each line: its head names parameters. Relative to this file.
    #[serde(default)]
    pub table: Option<PathBuf>,
    /// Grasps for each combination, which differ in what is drawn.
    #[serde(default)]
    pub samples: Option<usize>,
    /// Parameter -> values.
    #[serde(default)]
    pub set: BTreeMap<String, Values>,
}

/// Values of one parameter.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged, expecting = "expected a number, a list of numbers, or { min = NUMBER, max = NUMBER }")]
pub enum Values {
    /// The same for all.
    One(f64),
    /// Each of these.
    Each(Vec<f64>),
    /// Drawn evenly for each grasp.
    Drawn(Range),
}

/// From `min` to below `max`.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// Least value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

/// One `[[load]]`: a shake, a push, or both at once.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LoadEntry {
    /// Its name, for `lost_in`.
    pub name: String,
    /// \[s\]
    pub duration: f64,
    /// The load goes as a sine of this frequency \[Hz\]; 0: it is constant.
    #[serde(default)]
    pub frequency: f64,
    /// Acceleration of the hand's base, as felt by all that it carries \[m/s^2\], world axes.
    #[serde(default)]
    pub acceleration: [f64; 3],
    /// At the target's centre of mass \[N\], world axes.
    #[serde(default)]
    pub force: [f64; 3],
    /// On the target \[N m\], world axes.
    #[serde(default)]
    pub torque: [f64; 3],
}

impl SweepFile {
    /// Parses and checks a spec; `path` is where the text comes from and appears in messages.
    ///
    /// # Errors
    /// [`Error::Parse`] for text that is no spec (unknown keys included), [`Error::Field`] for a value that makes no sense.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let file: Self = toml(text, path)?;
        file.check(path)?;
        Ok(file)
    }

    fn check(&self, path: &Path) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, field);
        file_name(at("name"), &self.name)?;
        non_negative(at("rest"), self.rest)?;
        if let Some(noslip) = self.noslip.filter(|&noslip| noslip > 1000) {
            return Err(at("noslip").wrong(format!("is {noslip}; it must be from 0 to 1000")));
        }
        if self.grasps_per_file == 0 {
            return Err(at("grasps_per_file").wrong("is 0; a file needs at least one row"));
        }
        if self.grasp.is_empty() {
            return Err(at("grasp").wrong("is missing; give at least one [[grasp]] with a name"));
        }
        if self.load.is_empty() {
            return Err(at("load").wrong("is missing; give at least one [[load]] that the grasps have to bear"));
        }
        let mut names = BTreeSet::new();
        for (i, family) in self.grasp.iter().enumerate() {
            family.check(path, i)?;
            distinct(&mut names, at(&format!("grasp[{i}].name")), &family.name, "[[grasp]]; ids")?;
        }
        names.clear();
        for (i, load) in self.load.iter().enumerate() {
            load.check(path, i)?;
            distinct(&mut names, at(&format!("load[{i}].name")), &load.name, "[[load]]; names")?;
        }
        Ok(())
    }

    /// What the spec asks of the scenario.
    pub(super) fn check_on(&self, plan: &Plan, path: &Path) -> Result<(), Error> {
        for (i, family) in self.grasp.iter().enumerate() {
            for (k, name) in family.keyframes.iter().enumerate() {
                let field = Field::new(path, &format!("grasp[{i}].keyframes[{k}]"));
                plan.model.keyframe(name).map_err(|e| field.unknown(e))?;
            }
        }
        let shake = self.load.iter().position(|load| load.acceleration != [0.0; 3]);
        match shake.filter(|_| !plan.model.has_gravity()) {
            Some(i) => Err(Field::new(path, &format!("load[{i}].acceleration"))
                .wrong("needs gravity, by which hand and target feel it, and the model has switched it off")),
            None => Ok(()),
        }
    }
}

/// Whether a parameter is one of those that are not below 0.
pub(super) fn is_factor(name: &str) -> bool {
    matches!(name, "friction" | "strength")
}

impl FamilyEntry {
    fn check(&self, path: &Path, index: usize) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, &format!("grasp[{index}].{field}"));
        file_name(at("name"), &self.name)?;
        for (name, values) in &self.set {
            let field = || at(&format!("set.\"{name}\""));
            let check =
                |value: &f64| if is_factor(name) { non_negative(field(), *value) } else { finite(field(), *value) };
            match values {
                Values::One(value) => check(value)?,
                Values::Each(values) if values.is_empty() => return Err(field().wrong("is an empty list; give values")),
                Values::Each(values) => values.iter().try_for_each(check)?,
                Values::Drawn(Range { min, max }) => {
                    [min, max].into_iter().try_for_each(check)?;
                    if min >= max {
                        return Err(field().wrong(format!("goes from {min:?} to {max:?}; min must be below max")));
                    }
                }
            }
        }
        let drawn = self.set.values().any(|values| matches!(values, Values::Drawn(_)));
        match self.samples {
            Some(0) => Err(at("samples").wrong("is 0; give at least 1")),
            Some(_) if !drawn => Err(at("samples").wrong("has a meaning only where a parameter is { min, max }")),
            _ => Ok(()),
        }
    }
}

impl LoadEntry {
    /// Share of the load at a time after its start \[s\].
    pub fn share(&self, time: f64) -> f64 {
        if self.frequency > 0.0 { (std::f64::consts::TAU * self.frequency * time).sin() } else { 1.0 }
    }

    fn check(&self, path: &Path, index: usize) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, &format!("load[{index}].{field}"));
        file_name(at("name"), &self.name)?;
        positive(at("duration"), self.duration)?;
        non_negative(at("frequency"), self.frequency)?;
        let parts = [("acceleration", self.acceleration), ("force", self.force), ("torque", self.torque)];
        for (name, vector) in parts {
            vector.iter().try_for_each(|value| finite(at(name), *value))?;
        }
        if parts.iter().all(|(_, vector)| *vector == [0.0; 3]) {
            return Err(
                at("force").wrong("is missing, and so are acceleration and torque; a load must have one of them")
            );
        }
        Ok(())
    }
}
