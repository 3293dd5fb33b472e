//! A scenario on its model: every name of the file looked up, everything ready to run.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::actuator;
use super::control::Entry;
use super::error::{Error, Field};
use super::file::{GraspEntry, ScenarioFile, Timeline, wrong_frozen_tolerance};
use super::source::Source;
use super::stop::Stop;
use crate::grasp::{FROZEN_TOLERANCE, GraspSpec, Limits, weld_xml};
use crate::mujoco::{BodyId, KeyframeId, Model, SiteId};

mod names;

use names::{goal, grasp, push};

/// A scenario whose every name exists on its model.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The scenario's name.
    pub name: String,
    /// What it is about, in a line; empty where the file does not say.
    pub about: String,
    /// The scenario file, for messages.
    pub file: PathBuf,
    /// The compiled model.
    pub model: Model,
    /// Where the simulation starts.
    pub keyframe: Option<KeyframeId>,
    /// When things happen.
    pub timeline: Timeline,
    /// The grasps, in the order of the file, palms resolved.
    pub grasps: Vec<GraspSpec>,
    /// See [`Grasps::set_frozen_tolerance`](crate::grasp::Grasps::set_frozen_tolerance) \[rad\].
    pub frozen_tolerance: f64,
    /// Actuator targets.
    pub controls: Vec<Entry>,
    /// Fingertip goals.
    pub goals: Vec<Goal>,
    /// Perturbations.
    pub pushes: Vec<Push>,
    /// Ends every simulation of this plan, and of its clones, when it is asked.
    pub stop: Stop,
}

/// A fingertip goal.
#[derive(Clone, Copy, Debug)]
pub struct Goal {
    /// Index of the grasp that it belongs to.
    pub grasp: usize,
    /// Site on the hand.
    pub tip: SiteId,
    /// Site on the target.
    pub goal: SiteId,
    /// When tracking starts \[s\].
    pub start: f64,
}

/// A perturbation.
#[derive(Clone, Debug)]
pub struct Push {
    /// Its name.
    pub name: String,
    /// Index of the grasp whose target is pushed.
    pub grasp: usize,
    /// Body that is pushed, at its centre of mass.
    pub body: BodyId,
    /// \[s\]
    pub start: f64,
    /// \[s\]
    pub end: f64,
    /// \[N\], world axes.
    pub force: Vector3<f64>,
    /// \[N m\], world axes.
    pub torque: Vector3<f64>,
}

impl Push {
    /// The same push, `factor` times as large.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { force: self.force * factor, torque: self.torque * factor, ..self.clone() }
    }
}

impl Plan {
    /// Loads a built-in scenario by name, or a scenario file by path, with its model.
    ///
    /// # Errors
    /// Any [`Error`] that is bad input.
    pub fn load(scenario: &str) -> Result<Self, Error> {
        Self::load_with(scenario, None)
    }

    /// As [`load`](Self::load), with every grasp bounded by `limits`, if any are given, whatever the file says. A grasp
    /// that needs a weld gets one beside the user's MJCF, which stays as it is.
    ///
    /// # Errors
    /// Any [`Error`] that is bad input.
    pub fn load_with(scenario: &str, limits: Option<Limits>) -> Result<Self, Error> {
        Self::of_source(&Source::find(scenario)?, limits)
    }

    /// As [`load_with`](Self::load_with), of a scenario that is found.
    ///
    /// # Errors
    /// Any [`Error`] that is bad input.
    pub fn of_source(source: &Source, limits: Option<Limits>) -> Result<Self, Error> {
        let mut file = ScenarioFile::parse(&source.text, &source.path)?;
        for grasp in &mut file.grasp {
            grasp.limits = limits.or(grasp.limits);
        }
        let welds: String = file
            .grasp
            .iter()
            .filter(|g| g.limits.unwrap_or_default() != Limits::Cones)
            .map(|g| weld_xml(&g.target, g.palm.as_deref()))
            .collect();
        // a target or palm that does not exist is found with a better message on the model as it is
        let model = source.load_model(&file.model, "")?;
        let names = |g: &GraspEntry| model.body(&g.target).is_ok() && g.palm.iter().all(|p| model.body(p).is_ok());
        let model = if welds.is_empty() || !file.grasp.iter().all(names) {
            model
        } else {
            source.load_model(&file.model, &welds)?
        };
        Self::new(&file, &source.path, model)
    }

    /// Looks up every name of `file` on `model`; `path` is the file's, for messages.
    ///
    /// # Errors
    /// [`Error::Field`], with the close names that exist.
    pub fn new(file: &ScenarioFile, path: &Path, model: Model) -> Result<Self, Error> {
        let at = |field: String| Field::new(path, &field);
        let keyframe = match &file.keyframe {
            Some(name) => Some(model.keyframe(name).map_err(|e| at("keyframe".into()).unknown(e))?),
            None => None,
        };
        let grasps = file
            .grasp
            .iter()
            .enumerate()
            .map(|(i, entry)| grasp(&model, path, i, entry))
            .collect::<Result<Vec<_>, _>>()?;
        let mut controls = Vec::new();
        for (i, entry) in file.control.iter().enumerate() {
            let mut set = Vec::new();
            for (name, &value) in &entry.set {
                let id = actuator::named(&model, name).map_err(|e| at(format!("control[{i}].set")).unknown(e))?;
                set.push((id.index(), value));
            }
            controls.push(Entry { time: entry.time, all: entry.all, set });
        }
        let ready = controls.iter().map(|c| c.time).filter(|&t| t <= file.timeline.pin_until).fold(0.0, f64::max);
        let goals = file
            .goal
            .iter()
            .enumerate()
            .map(|(i, entry)| goal(&model, path, i, entry, &grasps, ready))
            .collect::<Result<Vec<_>, _>>()?;
        let pushes = file
            .push
            .iter()
            .enumerate()
            .map(|(i, entry)| push(&model, path, i, entry, &grasps))
            .collect::<Result<Vec<_>, _>>()?;
        let (name, about, timeline) = (file.name.clone(), file.about.clone().unwrap_or_default(), file.timeline);
        let frozen_tolerance = file.frozen_tolerance.unwrap_or(FROZEN_TOLERANCE);
        let (file, stop) = (path.to_path_buf(), Stop::default());
        let plan = Self {
            name,
            about,
            file,
            model,
            keyframe,
            timeline,
            grasps,
            frozen_tolerance,
            controls,
            goals,
            pushes,
            stop,
        };
        plan.check_timestep()?;
        plan.check_pushes()?;
        Ok(plan)
    }

    /// The same plan with another frozen tolerance, if one is given \[rad\].
    ///
    /// # Errors
    /// One that is negative, too large or not finite.
    pub fn with_frozen_tolerance(mut self, angle: Option<f64>) -> Result<Self, Error> {
        if let Some(angle) = angle {
            if let Some(expected) = wrong_frozen_tolerance(angle) {
                return Err(Error::Option { option: "--frozen-tolerance", value: format!("{angle:?}"), expected });
            }
            self.frozen_tolerance = angle;
        }
        Ok(self)
    }

    /// The pushes that `--push` selects: `all` each by itself, `none` (or a scenario without pushes) the run without one.
    ///
    /// # Errors
    /// A name that no push has, with those that exist.
    pub fn select_pushes(&self, selection: &str) -> Result<Vec<Option<&Push>>, Error> {
        match selection {
            "none" => Ok(vec![None]),
            "all" if self.pushes.is_empty() => Ok(vec![None]),
            "all" => Ok(self.pushes.iter().map(Some).collect()),
            name => match self.pushes.iter().find(|p| p.name == name) {
                Some(push) => Ok(vec![Some(push)]),
                None => {
                    let known: Vec<String> = self.pushes.iter().map(|p| format!("\"{}\"", p.name)).collect();
                    let known = if known.is_empty() { "it has no pushes".into() } else { known.join(", ") };
                    let field = Field::new(&self.file, "push");
                    Err(field.wrong(format!("has none called \"{name}\"; give all, none, or one of: {known}")))
                }
            },
        }
    }

    /// Refuses a time step with which no time passes.
    ///
    /// # Errors
    /// [`Error::Field`].
    pub(super) fn check_timestep(&self) -> Result<(), Error> {
        let (step, duration) = (self.model.timestep(), self.timeline.duration);
        let wrong = |rule: String| {
            Err(Field::new(&self.file, "model").wrong(format!("has <option timestep=\"{step:?}\"/>; {rule}")))
        };
        if !(step.is_finite() && step > 0.0) {
            return wrong("a time step must be a finite number above 0 [s]".to_owned());
        }
        if step > duration {
            return wrong(format!("it must not be longer than the whole run, timeline.duration = {duration:?} s"));
        }
        Ok(())
    }

    /// Refuses a push that no step feels.
    fn check_pushes(&self) -> Result<(), Error> {
        let step = self.model.timestep();
        // a push is felt by the steps whose middle is in it; up to rounding
        let is_seen = |push: &Push| (push.start / step - 0.5 - 1e-6).ceil() * step < push.end - 0.5 * step;
        match self.pushes.iter().position(|push| !is_seen(push)) {
            Some(i) => Err(Field::new(&self.file, &format!("push[{i}].duration")).wrong(format!(
                "is {:?} s, and the middle of no step is in it: the model's time step is {step:?} s",
                ((self.pushes[i].end - self.pushes[i].start) * 1e9).round() / 1e9
            ))),
            None => Ok(()),
        }
    }

    /// The same plan, `duration` seconds long.
    ///
    /// # Errors
    /// A duration that does not reach beyond `measure_from` and the end of every push.
    pub fn lasting(mut self, duration: f64) -> Result<Self, Error> {
        let least = self.pushes.iter().map(|p| p.end).fold(self.timeline.measure_from(), f64::max);
        if !(duration.is_finite() && duration > least) {
            let (option, value) = ("--duration", format!("{duration:?}"));
            let expected = "it must be a number of seconds beyond measure_from and the end of every push";
            return Err(Error::Option { option, value, expected });
        }
        self.timeline.duration = duration;
        Ok(self)
    }

    /// The same plan with every push `factor` times as large.
    ///
    /// # Errors
    /// A factor that is not finite.
    pub fn scale_pushes(mut self, factor: f64) -> Result<Self, Error> {
        for push in &mut self.pushes {
            *push = push.scaled(factor);
        }
        let finite = |p: &Push| p.force.iter().chain(&p.torque).all(|v| v.is_finite());
        if !(factor.is_finite() && self.pushes.iter().all(finite)) {
            let (option, value) = ("--scale-push", format!("{factor:?}"));
            return Err(Error::Option {
                option,
                value,
                expected: "it must be a finite number, and so must each push times it",
            });
        }
        Ok(self)
    }
}
