//! Both quality thresholds of a scenario, from the full contact solve.
//!
//! `Q_Th` is as in the thesis (section 4.3): the least quality at which the target stays at rest under gravity without
//! slipping. The hand presses with many strengths ([`Press`]), the pin goes, and the target is watched to the end of the
//! scenario, without a push: it is *held* if it is not lost and no contact slips by 1 mm from then on. The border between
//! what is held and what is not is then bisected.
//!
//! `Q_M` is no more than [`RELEASE_SHARE`] of `Q_Th`, so that a quality which hovers about one threshold never meets the
//! other, and no more than that share of the quality which a firm hand that opens slowly has when the target starts to
//! slip: what it holds is not given up.

use rayon::prelude::*;
use serde::Serialize;

use super::control::Entry;
use super::error::Error;
use super::outcome::{Outcome, SLIP_ONSET, median, summarize};
use super::plan::Plan;
use super::press::{Press, finger_actuators};
use super::runner::{Mode, Runner};
use super::trajectory::{Sample, Trajectory};
use crate::grasp::spec::weight;
use crate::grasp::{DEFAULT_LATCH_TIME, RELEASE_PER_LATCH};

/// Halvings of the border between two neighbouring strengths: half powers of two are then 1 % apart.
pub const BISECTIONS: usize = 5;
/// See the module.
pub const RELEASE_SHARE: f64 = RELEASE_PER_LATCH;
/// A quality below this share of the target's weight holds nothing: it is 0 but for rounding.
const NO_QUALITY: f64 = 1e-6;
/// Quality at rest is the median over the end of a run \[s\].
const AT_REST: f64 = 0.5;
/// A hand opens in this time \[s\].
const OPENING: f64 = 4.0;

/// The JSON object of `calibrate`. A threshold that does not exist is `None`.
#[derive(Clone, Debug, Serialize)]
pub struct Calibration {
    /// `Q_Th` \[N\].
    pub latch_quality: Option<f64>,
    /// `Q_M` \[N\].
    pub release_quality: Option<f64>,
    /// Quality when the target slipped from a firm hand that opened slowly \[N\].
    pub slip_quality: Option<f64>,
    /// Whether the target was held with quality 0: something else carries it, and there is no threshold.
    #[serde(skip)]
    pub carried: bool,
    /// What the hand's strength is given in.
    pub press: &'static str,
    /// Every strength, from the weakest.
    pub tried: Vec<Try>,
}

/// One strength.
#[derive(Clone, Debug, Serialize)]
pub struct Try {
    /// Quality at rest; of a target that was not held, the best that lasted for as long as latching takes, from when it
    /// was free until it slipped \[N\].
    pub quality: f64,
    /// At rest, without slipping.
    pub held: bool,
    /// The strength, in the unit of [`Calibration::press`].
    pub strength: f64,
    /// Largest slip of any contact once the target was free \[m\].
    pub slip_m: f64,
    /// Why the simulation failed, if it did; it holds nothing then.
    pub error: Option<String>,
}

/// Finds both thresholds of the first grasp. `progress` is told of each simulation, [`simulations`] at most.
///
/// # Errors
/// A scenario that cannot be set up, or that has nothing to press with.
pub fn calibrate(plan: &Plan, progress: &(dyn Fn() + Sync)) -> Result<Calibration, Error> {
    let press = Press::of(plan)?;
    let at_rest = at_rest(plan);
    let attempt = |strength: f64| {
        let tried = attempt(&press.apply(&at_rest, strength), strength);
        progress();
        tried
    };
    let mut tried: Vec<Try> = press.strengths().par_iter().map(|&s| attempt(s)).collect::<Result<_, _>>()?;
    let mut calibration = Calibration {
        latch_quality: None,
        release_quality: None,
        slip_quality: None,
        carried: false,
        press: press.unit(),
        tried: Vec::new(),
    };
    if let Some((first, last)) = longest_held(&tried) {
        let no_quality = NO_QUALITY * weight(&plan.model, plan.grasps[0].target);
        let reached = (first..=last).rev().find(|&i| press.is_done(tried[i].strength, tried[i].quality));
        let firm = tried[reached.unwrap_or(first)].strength;
        let mut least = tried[first].clone();
        let mut below = first.checked_sub(1).map(|i| tried[i].clone());
        for _ in 0..BISECTIONS {
            let Some(weak) = &below else { break };
            let middle = attempt(press.between(weak.strength, least.strength))?;
            tried.push(middle.clone());
            if middle.held { least = middle } else { below = Some(middle) }
        }
        calibration.carried = least.quality <= no_quality;
        if !calibration.carried {
            calibration.slip_quality = slip_while_opening(&press.apply(&at_rest, firm))?;
            let firm_enough = calibration.slip_quality.map_or(least.quality, |slip| slip.min(least.quality));
            calibration.latch_quality = Some(least.quality);
            calibration.release_quality = Some(RELEASE_SHARE * firm_enough);
        }
        progress();
    }
    tried.sort_by(|a, b| a.strength.total_cmp(&b.strength));
    calibration.tried = tried;
    Ok(calibration)
}

/// How many simulations a calibration takes at most.
pub fn simulations(plan: &Plan) -> Result<usize, Error> {
    Ok(Press::of(plan)?.strengths().len() + BISECTIONS + 1)
}

/// First and last of the longest unbroken row of what is held, the weaker of two equal ones: a single lucky hold among
/// strengths that do not hold is no threshold.
fn longest_held(tried: &[Try]) -> Option<(usize, usize)> {
    let mut longest: Option<(usize, usize)> = None;
    let mut start = None;
    for (i, t) in tried.iter().enumerate() {
        start = if t.held { start.or(Some(i)) } else { None };
        if let Some(start) = start
            && longest.is_none_or(|(a, b)| i - start > b - a)
        {
            longest = Some((start, i));
        }
    }
    longest
}

/// The scenario without its pushes and without what the hand does once measuring has begun.
fn at_rest(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    plan.pushes.clear();
    let from = plan.timeline.measure_from();
    plan.controls.retain(|entry| entry.time <= from);
    plan
}

/// When the target is on its own: where the pin goes. Without a pin, when measuring begins.
fn free_from(plan: &Plan) -> f64 {
    if plan.timeline.pin_until > 0.0 { plan.timeline.pin_until } else { plan.timeline.measure_from() }
}

fn attempt(plan: &Plan, strength: f64) -> Result<Try, Error> {
    let from = free_from(plan);
    let (trajectory, error) = watch(plan, from)?;
    let summary = summarize(&trajectory, from, None);
    let samples = trajectory.samples();
    let slip_m = samples.iter().map(|s| s.slip).fold(0.0, f64::max);
    let held = summary.outcome.is_some_and(|o| o != Outcome::Lost) && summary.slip_onset_s.is_none() && error.is_none();
    let quality = if held { rest(samples, plan.timeline.duration) } else { lasting(samples, plan.model.timestep()) };
    Ok(Try { quality, held, strength, slip_m, error })
}

/// Full mode to the end, recorded from `from` on; slip counts from then on.
fn watch(plan: &Plan, from: f64) -> Result<(Trajectory, Option<String>), Error> {
    let mut plan = plan.clone();
    plan.timeline.measure_from = Some(from);
    let mut runner = Runner::new(&plan, Mode::Full, None)?;
    let mut trajectory = runner.trajectory();
    while !runner.is_over() {
        let time = runner.time();
        match runner.step() {
            Ok(_) if time < from - 0.5 * plan.model.timestep() => {}
            Ok(sample) => trajectory.push(sample, runner.normal_forces()),
            Err(Error::Interrupted) => return Err(Error::Interrupted),
            Err(e) => return Ok((trajectory, Some(e.to_string()))),
        }
    }
    Ok((trajectory, None))
}

/// Quality at the end of a run.
fn rest(samples: &[Sample], end: f64) -> f64 {
    median(samples.iter().filter(|s| s.time >= end - AT_REST).map(|s| s.quality).collect()).unwrap_or(0.0)
}

/// The best quality that the target had, in contact and before it slipped, for as long as latching takes: with a lower
/// threshold a grasp that does not hold would have latched.
fn lasting(samples: &[Sample], step: f64) -> f64 {
    let length = ((DEFAULT_LATCH_TIME / step).round() as usize).max(1);
    let quality = |s: &Sample| if s.touching { s.quality } else { 0.0 };
    // What has slipped may come to rest elsewhere, with a quality that says nothing of this grasp.
    let slipped = samples.iter().position(|s| s.slip > SLIP_ONSET).unwrap_or(samples.len());
    samples[..slipped].windows(length).map(|w| w.iter().map(quality).fold(f64::INFINITY, f64::min)).fold(0.0, f64::max)
}

/// Quality when the target starts to slip from a hand that holds it and then opens slowly. `None` if it does not slip.
fn slip_while_opening(plan: &Plan) -> Result<Option<f64>, Error> {
    let mut plan = plan.clone();
    let from = plan.timeline.measure_from();
    let start = Runner::new(&plan, Mode::Full, None)?;
    let set = finger_actuators(start.sim(), start.grasp().palm())
        .into_iter()
        .map(|actuator| (actuator, start.sim().ctrl()[actuator]))
        .collect();
    // An entry that sets nothing: the fingers go from wherever they are then.
    plan.controls.push(Entry { time: from, all: None, set: Vec::new() });
    plan.controls.push(Entry { time: from + OPENING, all: None, set });
    plan.timeline.duration = from + OPENING;
    let (trajectory, _) = watch(&plan, from)?;
    let samples = trajectory.samples();
    let slipped = samples.iter().position(|s| s.slip > SLIP_ONSET);
    let window = ((DEFAULT_LATCH_TIME / plan.model.timestep()).round() as usize).max(1);
    Ok(slipped.and_then(|i| median(samples[(i + 1).saturating_sub(window)..=i].iter().map(|s| s.quality).collect())))
}
