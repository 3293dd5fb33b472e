//! The scenario file as it is written: TOML, every field of `docs/reference.md`, checked for everything that can be
//! checked without the model. Names are looked up later, in [`super::plan`].

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use nalgebra::{Quaternion, UnitQuaternion};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::error::{Error, Field};
use crate::grasp::Limits;

mod check;

/// A scenario file. SI units, seconds, newtons, radians; quaternions are w, x, y, z.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioFile {
    /// The scenario's name; also the name of its folder of results.
    pub name: String,
    /// One line for `mujoco-grasp list`.
    #[serde(default)]
    pub about: Option<String>,
    /// The MJCF, relative to the scenario file.
    pub model: PathBuf,
    /// Keyframe to start from; without it, the model's `qpos0` with controls 0.
    #[serde(default)]
    pub keyframe: Option<String>,
    /// Angle by which anything may turn between two whole steps of a latched grasp \[rad\]; left out: 0.002, 0: every step is
    /// whole.
    #[serde(default)]
    pub frozen_tolerance: Option<f64>,
    /// The grasps, one or more.
    #[serde(default)]
    pub grasp: Vec<GraspEntry>,
    /// When things happen.
    pub timeline: Timeline,
    /// Actuator targets.
    #[serde(default)]
    pub control: Vec<ControlEntry>,
    /// Fingertip goals for inverse kinematics.
    #[serde(default)]
    pub goal: Vec<GoalEntry>,
    /// Perturbations; each run applies one of them, or none.
    #[serde(default)]
    pub push: Vec<PushEntry>,
}

/// One `[[grasp]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspEntry {
    /// Body that is grasped.
    pub target: String,
    /// Links that may hold it; left out: every link below the palm.
    #[serde(default)]
    pub effectors: Vec<String>,
    /// Base of the fingers; left out: the lowest common ancestor of the effectors, or the only hand that can touch the target.
    #[serde(default)]
    pub palm: Option<String>,
    /// Q_Th \[N\]: the grasp latches at this quality.
    #[serde(default)]
    pub latch_quality: Option<f64>,
    /// Q_M \[N\]: what the grasp must keep not to be given up; of the sum of normal forces with limits "cones", of the quality
    /// with the others.
    #[serde(default)]
    pub release_quality: Option<f64>,
    /// For how long the quality must be good before it latches \[s\].
    #[serde(default)]
    pub latch_time: Option<f64>,
    /// For how long its hold must be lost before it is given up \[s\].
    #[serde(default)]
    pub release_time: Option<f64>,
    /// How the grasp's constraint is bounded.
    #[serde(default)]
    pub limits: Option<Limits>,
    /// Box only: the axes that may slip; left out: all six.
    #[serde(default)]
    pub relaxed: Option<Vec<Axis>>,
    /// Box only: orientation of the axis frame in the target's frame; left out: the target's.
    #[serde(default)]
    pub axes: Option<[f64; 4]>,
    /// Box and rigid only: MuJoCo's `solref` of the weld's axes that may not slip; left out: from the contacts.
    #[serde(default)]
    pub solref: Option<[f64; 2]>,
    /// Box and rigid only: MuJoCo's `solimp` of those axes; left out: from the contacts.
    #[serde(default)]
    pub solimp: Option<[f64; 5]>,
    /// Box only: `solref` of the axes that may slip.
    #[serde(default)]
    pub relaxed_solref: Option<[f64; 2]>,
    /// Box only: `solimp` of the axes that may slip.
    #[serde(default)]
    pub relaxed_solimp: Option<[f64; 5]>,
}

/// One axis of the box form.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Translation along x.
    X,
    /// Translation along y.
    Y,
    /// Translation along z.
    Z,
    /// Rotation about x.
    Rx,
    /// Rotation about y.
    Ry,
    /// Rotation about z.
    Rz,
}

/// `[timeline]`, in seconds of simulation from the start.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timeline {
    /// Length of the simulation.
    pub duration: f64,
    /// The target is held at its starting pose in the world until then, and nothing latches before. Left out: 0.
    #[serde(default)]
    pub pin_until: f64,
    /// Motions and comparisons start here. Left out: when the pin goes.
    #[serde(default)]
    pub measure_from: Option<f64>,
}

impl Timeline {
    /// Where motions and comparisons start \[s\].
    pub fn measure_from(&self) -> f64 {
        self.measure_from.unwrap_or(self.pin_until)
    }
}

/// One `[[control]]`: the actuators' targets at a time.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlEntry {
    /// \[s\]
    pub time: f64,
    /// Sets every actuator, before `set`.
    #[serde(default)]
    pub all: Option<f64>,
    /// Actuator name (for an actuator without one, that of its joint or tendon) -> target, in the actuator's own unit.
    #[serde(default)]
    pub set: BTreeMap<String, f64>,
}

/// One `[[goal]]`: a fingertip site that is brought to a site of the target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalEntry {
    /// Site on a link of the hand.
    pub effector_site: String,
    /// Site on the target.
    pub target_site: String,
    /// When the tracking starts \[s\]. Left out: at the last `[[control]]` entry that is not later than `pin_until`.
    #[serde(default)]
    pub start: Option<f64>,
}

/// One `[[push]]`: a constant wrench at the target's centre of mass, in world axes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PushEntry {
    /// Name for `--push` and for files.
    pub name: String,
    /// Body that is pushed: the target of a grasp. Optional with one grasp.
    #[serde(default)]
    pub target: Option<String>,
    /// \[s\]
    pub start: f64,
    /// \[s\]
    pub duration: f64,
    /// \[N\], world axes.
    #[serde(default)]
    pub force: [f64; 3],
    /// \[N m\], world axes.
    #[serde(default)]
    pub torque: [f64; 3],
}

impl ScenarioFile {
    /// Parses and checks a scenario; `path` is where the text comes from and appears in messages.
    ///
    /// # Errors
    /// [`Error::Parse`] for text that is no scenario (unknown keys included), [`Error::Field`] for a value that makes no sense.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let file: Self = toml(text, path)?;
        file.check(path)?;
        Ok(file)
    }
}

impl GraspEntry {
    /// Which of x, y, z, rx, ry, rz may slip in the box form.
    pub fn relaxed(&self) -> [bool; 6] {
        let Some(axes) = &self.relaxed else {
            return [true; 6];
        };
        let mut relaxed = [false; 6];
        for axis in axes {
            relaxed[*axis as usize] = true;
        }
        relaxed
    }

    /// Orientation of the axis frame in the target's frame.
    pub fn axes(&self) -> UnitQuaternion<f64> {
        let [w, x, y, z] = self.axes.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    }
}

impl PushEntry {
    /// End of the push \[s\].
    pub fn end(&self) -> f64 {
        self.start + self.duration
    }
}

/// The values in a text.
pub(super) fn toml<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, Error> {
    ::toml::from_str(text).map_err(|source| Error::Parse { file: path.to_path_buf(), source: Box::new(source) })
}

/// Takes a name among `names`, unless it is there; `of`: of what it is the name, and what must differ.
pub(super) fn distinct<'a>(names: &mut BTreeSet<&'a str>, field: Field, name: &'a str, of: &str) -> Result<(), Error> {
    let fresh = names.insert(name);
    if fresh { Ok(()) } else { Err(field.wrong(format!("\"{name}\" is the name of another {of} must differ"))) }
}

pub(super) fn finite(field: Field, value: f64) -> Result<(), Error> {
    if value.is_finite() { Ok(()) } else { Err(field.wrong(format!("is {value:?}; it must be a finite number"))) }
}

pub(super) fn positive(field: Field, value: f64) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(field.wrong(format!("is {value:?}; it must be a finite number above 0")))
    }
}

pub(super) fn non_negative(field: Field, value: f64) -> Result<(), Error> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(field.wrong(format!("is {value:?}; it must be a finite number, 0 or above")))
    }
}

/// A file's name has 255 bytes at most, and to some a program adds `contacts-`, `.grasp12.csv` and what marks it as unfinished.
const LONGEST_NAME: usize = 200;

/// Names of scenarios and pushes become names of folders and files.
pub(super) fn file_name(field: Field, name: &str) -> Result<(), Error> {
    let problem = match name {
        _ if name.trim().is_empty() => "so it must not be empty".to_owned(),
        "." | ".." => "and this one is a folder's own or its parent; give another".to_owned(),
        _ if name.contains(['/', '\\']) => "so it must hold no / or \\".to_owned(),
        _ if name.contains(char::is_control) => "so it must hold no line break or other control character".to_owned(),
        _ if name.len() > LONGEST_NAME => {
            let length = name.len();
            return Err(field.wrong(format!("is {length} bytes long; it names files, so {LONGEST_NAME} is the most")));
        }
        _ => return Ok(()),
    };
    Err(field.wrong(format!("is {name:?}; it names files, {problem}")))
}

/// Beyond this the contacts of the last whole step say little of where anything is now \[rad\].
const LARGEST_FROZEN_TOLERANCE: f64 = 0.1;

/// What is wrong with a frozen tolerance \[rad\], and what would be right; `None` of one that is right.
pub fn wrong_frozen_tolerance(angle: f64) -> Option<&'static str> {
    (!(0.0..=LARGEST_FROZEN_TOLERANCE).contains(&angle)).then_some(
        "it must be from 0 to 0.1 rad: what turns further between two whole steps has left the contacts that are held still",
    )
}
