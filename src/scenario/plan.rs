//! A scenario on its model: every name of the file looked up, everything ready to run.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::actuator;
use super::control::Entry;
use super::error::{Error, Field};
use super::file::{GoalEntry, GraspEntry, PushEntry, ScenarioFile, Timeline};
use super::source::Source;
use super::stop::Stop;
use crate::grasp::FROZEN_TOLERANCE;
use crate::grasp::{DEFAULT_LATCH_TIME, DEFAULT_RELEASE_TIME, GraspSpec, Limits, find_hand, weld_xml};
use crate::mujoco::{BodyId, CompiledModel, KeyframeId, Model, SiteId};

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
        Ok(plan)
    }

    /// The same plan with another frozen tolerance, if one is given \[rad\].
    ///
    /// # Errors
    /// One that is negative or not finite.
    pub fn with_frozen_tolerance(mut self, angle: Option<f64>) -> Result<Self, Error> {
        if let Some(angle) = angle {
            if !(angle.is_finite() && angle >= 0.0) {
                let (option, value) = ("--frozen-tolerance", angle.to_string());
                return Err(Error::Option { option, value, expected: "it must be an angle in radians, at least 0" });
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
            Err(Field::new(&self.file, "model").wrong(format!("has <option timestep=\"{step}\"/>; {rule}")))
        };
        if !(step.is_finite() && step > 0.0) {
            return wrong("a time step must be a finite number above 0 [s]".to_owned());
        }
        if step > duration {
            return wrong(format!("it must not be longer than the whole run, timeline.duration = {duration} s"));
        }
        Ok(())
    }

    /// The same plan, `duration` seconds long.
    ///
    /// # Errors
    /// A duration that does not reach beyond `measure_from` and the end of every push.
    pub fn lasting(mut self, duration: f64) -> Result<Self, Error> {
        let least = self.pushes.iter().map(|p| p.end).fold(self.timeline.measure_from(), f64::max);
        if !(duration.is_finite() && duration > least) {
            let (option, value) = ("--duration", duration.to_string());
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
            let (option, value) = ("--scale-push", factor.to_string());
            return Err(Error::Option {
                option,
                value,
                expected: "it must be a finite number, and so must each push times it",
            });
        }
        Ok(self)
    }
}

fn label(model: &CompiledModel, body: usize) -> String {
    match model.body_name(BodyId::from_index(body)) {
        Some(name) => format!("\"{name}\""),
        None => format!("body {body}"),
    }
}

/// Whether `ancestor` is `body` or above it.
fn is_above(model: &CompiledModel, ancestor: usize, mut body: usize) -> bool {
    while body > ancestor {
        body = model.body_parentid()[body] as usize;
    }
    body == ancestor
}

fn grasp(model: &CompiledModel, path: &Path, index: usize, entry: &GraspEntry) -> Result<GraspSpec, Error> {
    let at = |field: &str| Field::new(path, &format!("grasp[{index}].{field}"));
    let body = |field: &str, name: &str| model.body(name).map_err(|e| at(field).unknown(e));
    let target = body("target", &entry.target)?;
    if target == BodyId::WORLD {
        return Err(at("target").wrong("is the world; give a body that can move"));
    }
    if !moves(model, target.index()) {
        return Err(at("target").wrong(format!(
            "\"{}\" cannot move: no joint lies between it and the world; give it a <freejoint/>",
            entry.target
        )));
    }
    let mut effectors = Vec::new();
    for (i, name) in entry.effectors.iter().enumerate() {
        let field = format!("effectors[{i}]");
        let effector = body(&field, name)?;
        if is_above(model, target.index(), effector.index()) {
            return Err(
                at(&field).wrong(format!("\"{name}\" is a part of the target; effectors are links of the hand"))
            );
        }
        effectors.push(effector);
    }
    let palm = match &entry.palm {
        Some(name) => body("palm", name)?,
        None if effectors.is_empty() => {
            let palm;
            (palm, effectors) = find_hand(model, target).map_err(|e| at("palm").wrong(format!("is missing: {e}")))?;
            palm
        }
        None => common_ancestor(model, &effectors),
    };
    for (i, effector) in effectors.iter().enumerate() {
        if !is_above(model, palm.index(), effector.index()) {
            return Err(at("palm").wrong(format!(
                "{} is not above the effector \"{}\" in the kinematic tree; give a common ancestor of the effectors, as {}",
                label(model, palm.index()),
                entry.effectors[i], // only named ones can be elsewhere
                label(model, common_ancestor(model, &effectors).index()),
            )));
        }
    }
    if palm != BodyId::WORLD && is_above(model, palm.index(), target.index()) {
        return Err(at("palm").wrong(format!(
            "{} carries the target \"{}\"; the target must not be a part of the hand",
            label(model, palm.index()),
            entry.target
        )));
    }
    if is_above(model, target.index(), palm.index()) {
        return Err(at("palm").wrong(format!("{} is a part of the target", label(model, palm.index()))));
    }
    Ok(GraspSpec {
        effectors,
        latch_quality: entry.latch_quality,
        release_quality: entry.release_quality,
        latch_time: entry.latch_time.unwrap_or(DEFAULT_LATCH_TIME),
        release_time: entry.release_time.unwrap_or(DEFAULT_RELEASE_TIME),
        limits: entry.limits.unwrap_or(Limits::Cones),
        relaxed: entry.relaxed(),
        axes: entry.axes(),
        solref: entry.solref,
        solimp: entry.solimp,
        relaxed_solref: entry.relaxed_solref,
        relaxed_solimp: entry.relaxed_solimp,
        ..GraspSpec::new(target, palm)
    })
}

/// Lowest body above all effectors that is none of them.
fn common_ancestor(model: &CompiledModel, effectors: &[BodyId]) -> BodyId {
    let mut ancestor = effectors.first().map_or(0, |e| e.index());
    while ancestor != 0 && !effectors.iter().all(|e| ancestor != e.index() && is_above(model, ancestor, e.index())) {
        ancestor = model.body_parentid()[ancestor] as usize;
    }
    BodyId::from_index(ancestor)
}

/// Whether any joint lies between the body and the world.
fn moves(model: &CompiledModel, mut body: usize) -> bool {
    while body != 0 {
        if model.body_dofnum()[body] > 0 {
            return true;
        }
        body = model.body_parentid()[body] as usize;
    }
    false
}

fn goal(
    model: &CompiledModel,
    path: &Path,
    index: usize,
    entry: &GoalEntry,
    grasps: &[GraspSpec],
    ready: f64,
) -> Result<Goal, Error> {
    let at = |field: &str| Field::new(path, &format!("goal[{index}].{field}"));
    let tip = model.site(&entry.effector_site).map_err(|e| at("effector_site").unknown(e))?;
    let goal = model.site(&entry.target_site).map_err(|e| at("target_site").unknown(e))?;
    let body_of = |site: SiteId| model.site_bodyid()[site.index()] as usize;
    let on_target = |g: &GraspSpec| is_above(model, g.target.index(), body_of(goal));
    let on_hand = |g: &GraspSpec| {
        let palm = g.palm.unwrap_or(BodyId::WORLD).index();
        palm != body_of(tip) && is_above(model, palm, body_of(tip))
    };
    if !grasps.iter().any(on_target) {
        return Err(at("target_site").wrong(format!(
            "\"{}\" is on {}, which is no target of a grasp",
            entry.target_site,
            label(model, body_of(goal))
        )));
    }
    match grasps.iter().position(|g| on_target(g) && on_hand(g)) {
        Some(grasp) => Ok(Goal { grasp, tip, goal, start: entry.start.unwrap_or(ready) }),
        None => Err(at("effector_site").wrong(format!(
            "\"{}\" is on {}, which is not below the palm of the grasp; give a site on a finger",
            entry.effector_site,
            label(model, body_of(tip))
        ))),
    }
}

fn push(
    model: &CompiledModel,
    path: &Path,
    index: usize,
    entry: &PushEntry,
    grasps: &[GraspSpec],
) -> Result<Push, Error> {
    let at = |field: &str| Field::new(path, &format!("push[{index}].{field}"));
    let grasp = match &entry.target {
        None => 0,
        Some(name) => {
            let body = model.body(name).map_err(|e| at("target").unknown(e))?;
            grasps.iter().position(|g| g.target == body).ok_or_else(|| {
                let known: Vec<String> = grasps.iter().map(|g| label(model, g.target.index())).collect();
                at("target").wrong(format!("\"{name}\" is no target of a grasp; give one of: {}", known.join(", ")))
            })?
        }
    };
    let body = grasps[grasp].target;
    Ok(Push {
        name: entry.name.clone(),
        grasp,
        body,
        start: entry.start,
        end: entry.end(),
        force: Vector3::from(entry.force),
        torque: Vector3::from(entry.torque),
    })
}
