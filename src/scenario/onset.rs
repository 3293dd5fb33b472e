//! The smallest push that a grasp does not withstand.

use super::error::Error;
use super::outcome::{Outcome, summarize};
use super::plan::{Plan, Push};
use super::run::Options;
use super::runner::{Mode, Runner};

/// Bisection ends when the bounds are this close, relative.
pub const ACCURACY: f64 = 0.03;
/// A push this many times as large, or as small, is as far as the search goes.
const FARTHEST: f64 = 1024.0;

/// Brings a scenario to `measure_from` in full mode, from where every trial can start.
///
/// # Errors
/// A scenario that cannot be set up or run so far.
pub fn full_at_measure(plan: &Plan, options: Options) -> Result<Runner, Error> {
    let mut runner = Runner::new(plan, Mode::Full, None)?;
    options.set_noslip(runner.sim_mut())?;
    advance(&mut runner, plan.timeline.measure_from())?;
    Ok(runner)
}

/// Runs up to `time`, without recording.
///
/// # Errors
/// [`Error::Step`].
pub fn advance(runner: &mut Runner, time: f64) -> Result<(), Error> {
    runner.advance_to(time).map_err(|source| Error::Step {
        what: format!("{} mode", runner.mode().name()),
        time: runner.time(),
        source,
    })
}

/// How `push` ends, from a runner at `measure_from`. A simulation that diverges has lost its target.
pub fn outcome(start: &Runner, plan: &Plan, push: &Push) -> Outcome {
    let mut runner = start.clone();
    runner.set_push(Some(push));
    let mut trajectory = runner.trajectory();
    while !runner.is_over() {
        match runner.step() {
            Ok(sample) => trajectory.push(sample, runner.normal_forces()),
            Err(_) => return Outcome::Lost,
        }
    }
    let summary = summarize(&trajectory, plan.timeline.measure_from(), Some(push.end));
    summary.outcome.unwrap_or(Outcome::Lost)
}

/// The smallest factor by which `push` is multiplied that is not held, by bisection to [`ACCURACY`], from a runner at
/// `measure_from`. `None`: a push of no size, or held (or not held) as far as the search goes.
pub fn onset(start: &Runner, plan: &Plan, push: &Push) -> Option<f64> {
    let size = push.force.norm().max(push.torque.norm());
    if size == 0.0 {
        return None;
    }
    let held = |factor: f64| outcome(start, plan, &push.scaled(factor)) == Outcome::Held;
    let (mut low, mut high) = (1.0, 1.0);
    if held(1.0) {
        while held(high) {
            low = high;
            high *= 2.0;
            if high > FARTHEST {
                return None;
            }
        }
    } else {
        while !held(low) {
            high = low;
            low *= 0.5;
            if low < 1.0 / FARTHEST {
                return None;
            }
        }
    }
    while high - low > ACCURACY * high {
        let middle = 0.5 * (low + high);
        if held(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(high)
}
