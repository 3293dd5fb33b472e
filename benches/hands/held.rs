//! Whether a generated hand holds its can as it was asked to.

use anyhow::ensure;
use mujoco_grasp::scenario::outcome::{Outcome, Summary, summarize};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};

use super::hand::Hand;

/// What a run of the scenario in grasp mode has shown.
#[derive(Debug)]
pub struct Held {
    /// Contacts that press on the can at the end.
    pub contacts: usize,
    /// The run's numbers.
    pub summary: Summary,
}

/// Runs the scenario in grasp mode.
///
/// # Errors
/// A scenario that cannot be set up, or a simulation that fails.
pub fn run(plan: &Plan) -> anyhow::Result<Held> {
    let mut runner = Runner::new(plan, Mode::Grasp, None)?;
    let mut trajectory = runner.trajectory();
    while !runner.is_over() {
        let sample = runner.step()?;
        trajectory.push(sample, runner.normal_forces());
    }
    let contacts = runner.grasp().contacts().iter().filter(|contact| contact.normal_force() > 0.0).count();
    Ok(Held { contacts, summary: summarize(&trajectory, plan.timeline.measure_from(), None) })
}

/// As [`run`], where anything else than what was asked for is an error.
///
/// # Errors
/// Another number of contacts, a can that is not held, a step that is not latched.
pub fn check(hand: &Hand, plan: &Plan) -> anyhow::Result<Held> {
    let held = run(plan)?;
    let (name, wanted) = (hand.name(), hand.contacts());
    let Held { contacts, summary } = &held;
    ensure!(plan.model.nv() == hand.nv(), "{name}: {} degrees of freedom, not {}", plan.model.nv(), hand.nv());
    ensure!(*contacts == wanted, "{name}: {contacts} contacts press on the can, not {wanted}");
    ensure!(summary.outcome == Some(Outcome::Held), "{name}: the can is not held: {:?}", summary.outcome);
    ensure!(summary.latched_share == Some(1.0), "{name}: latched in {:?} of the steps", summary.latched_share);
    Ok(held)
}
