//! The smallest push that a grasp does not withstand.

use super::error::Error;
use super::outcome::{Outcome, summarize};
use super::plan::{Plan, Push};
use super::run::Options;
use super::runner::{Mode, Runner};

/// Bisection ends when the bounds are this close, relative.
pub const ACCURACY: f64 = 0.03;
/// A size this many times as large, or as small, is as far as a search goes.
const FARTHEST: f64 = 1024.0;

/// Brings a scenario to `measure_from` in full mode, from where every trial can start.
///
/// # Errors
/// A scenario that cannot be set up or run so far.
pub fn full_at_measure(plan: &Plan, options: Options) -> Result<Runner, Error> {
    let mut runner = Runner::new(plan, Mode::Full, None)?;
    options.set_noslip(runner.sim_mut())?;
    runner.advance_to(plan.timeline.measure_from())?;
    Ok(runner)
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
/// `measure_from`.
///
/// # Errors
/// Why there is none: a push of no size, or held (or not held) as far as the search goes.
pub fn onset(start: &Runner, plan: &Plan, push: &Push) -> Result<f64, &'static str> {
    if push.force.norm().max(push.torque.norm()) == 0.0 {
        return Err("it has neither force nor torque");
    }
    let ends = |factor| outcome(start, plan, &push.scaled(factor));
    let found = smallest_not_held(Search::from(1.0), ACCURACY, |factor| ends(factor) == Outcome::Held);
    found.ok_or_else(|| match ends(0.0) {
        Outcome::Lost => "the target is lost even without a push",
        Outcome::Slid => "the target slides even without a push",
        Outcome::Held if ends(1.0) == Outcome::Held => "it is held up to 1024 times its size",
        Outcome::Held => "it is not held even at a 1024th of its size",
    })
}

/// Where a search begins, and how far its first stride goes.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Above 0.
    pub first: f64,
    /// The second size over the first, or the first over the second; each further stride is twice as long, up to a
    /// factor of 2.
    pub stride: f64,
}

impl Search {
    /// For a guess that may be far off.
    pub fn from(first: f64) -> Self {
        Self { first, stride: 2.0 }
    }
}

/// The smallest size that is not `held`, by bisection to `accuracy` (relative). `None`: held (or not held) up to
/// 1024 times the first size (or down to its 1024th part).
pub fn smallest_not_held(search: Search, accuracy: f64, mut held: impl FnMut(f64) -> bool) -> Option<f64> {
    let Search { first, mut stride } = search;
    let (mut low, mut high) = (first, first);
    if held(first) {
        loop {
            high *= stride;
            if high > FARTHEST * first {
                return None;
            }
            if !held(high) {
                break;
            }
            low = high;
            stride = (stride * stride).min(2.0);
        }
    } else {
        loop {
            low /= stride;
            if low < first / FARTHEST {
                return None;
            }
            if held(low) {
                break;
            }
            high = low;
            stride = (stride * stride).min(2.0);
        }
    }
    while high - low > accuracy * high {
        let middle = 0.5 * (low + high);
        if held(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_size_that_is_not_held_is_found_from_either_side() {
        for onset in [0.02, 0.4, 0.999, 1.0, 1.004, 7.0, 700.0] {
            for stride in [1.01, 2.0] {
                let mut runs = 0;
                let search = Search { first: 1.0, stride };
                let found = smallest_not_held(search, 0.01, |size| {
                    runs += 1;
                    size < onset
                });
                let found = found.expect("an onset");
                assert!(found >= onset && found - onset <= 0.01 * found, "{found} {onset}");
                assert!(runs < 30, "{runs}");
                if stride < 2.0 && onset == 0.999 {
                    assert_eq!(runs, 2, "a good guess costs two runs");
                }
            }
        }
    }

    #[test]
    fn what_always_or_never_holds_has_no_onset() {
        assert_eq!(smallest_not_held(Search::from(1.0), 0.03, |_| true), None);
        assert_eq!(smallest_not_held(Search::from(1.0), 0.03, |_| false), None);
    }
}
