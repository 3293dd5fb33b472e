//! What the numbers of `run` do not show.

use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::run::{Pair, Run};
use mujoco_grasp::scenario::runner::Mode;
use mujoco_grasp::scenario::start::{SOON, starts_inside, thrown_by_pin};

use crate::output::significant;

/// Relative errors below this are no difference to explain.
const DIFFERENCE: f64 = 0.01;
/// Full mode creeps if it is this many times as fast as grasp mode in the last second.
const CREEPS: f64 = 3.0;

/// One line for each thing to say, with the runs that it is true of.
pub fn warnings(plan: &Plan, pairs: &[Pair]) -> Vec<String> {
    let mut said: Vec<(String, Vec<String>)> = Vec::new();
    for run in pairs.iter().flat_map(Pair::runs) {
        for message in of_run(plan, run) {
            match said.iter_mut().find(|(m, _)| *m == message) {
                Some((_, runs)) => runs.push(run.stem()),
                None => said.push((message, vec![run.stem()])),
            }
        }
    }
    let mut warnings: Vec<String> =
        said.into_iter().map(|(message, runs)| format!("{}: {message}", runs.join(", "))).collect();
    warnings.extend(all_vacuous(pairs));
    warnings
}

/// What never latched has been said by then.
fn all_vacuous(pairs: &[Pair]) -> Option<String> {
    let mut compared = pairs.iter().filter_map(|pair| pair.compare.as_ref()).peekable();
    compared.peek()?;
    let latched = |run: &Run| run.summary.latched_at_s.is_some();
    let vacuous = compared.all(|c| c.vacuous && c.others.iter().all(|other| other.vacuous));
    (vacuous && pairs.iter().flat_map(Pair::runs).any(latched)).then(|| {
        "grasp mode was latched for none of the compared time of any run: both modes were the same simulation there, and \
         all comparisons say nothing"
            .to_owned()
    })
}

fn of_run(plan: &Plan, run: &Run) -> Vec<String> {
    let mut messages = run.warnings.clone();
    if let Some(depth) = starts_inside(&run.trajectory) {
        messages.push(format!(
            "the target starts {:.1} mm inside the hand: contacts this deep throw it; start with open fingers, or move it",
            depth * 1e3
        ));
    }
    if let Some(thrown) = thrown_by_pin(&run.trajectory, plan.timeline.pin_until) {
        messages.push(format!(
            "within {SOON} s of pin_until = {} s the target moved {:.0} mm against the palm{}: fingers press on a pinned target \
             as on a wall, and what does not balance throws it; close them less or slower, or so that they bear its weight \
             (docs/wrapping.md)",
            plan.timeline.pin_until,
            thrown.moved * 1e3,
            if thrown.left { " and left the hand" } else { "" }
        ));
    }
    if run.mode == Mode::Grasp && run.error.is_none() {
        let contacts = plan.model.has_contacts();
        let latch_time = |grasp: usize| plan.grasps[grasp].latch_time;
        if run.summary.latched_at_s.is_none() {
            let own = (0..run.others.len()).find(|i| run.others[*i].index != *i).unwrap_or(run.others.len());
            let quality = [run.best_quality, run.latch_quality];
            messages.push(never_latched("the grasp", quality, latch_time(own), contacts));
        }
        for o in run.others.iter().filter(|o| o.summary.latched_at_s.is_none()) {
            let who = format!("grasp {} of {} by {}", o.index, o.target, o.palm);
            messages.push(never_latched(&who, [o.best_quality, o.latch_quality], latch_time(o.index), contacts));
        }
    }
    messages
}

fn never_latched(who: &str, [best, needed]: [f64; 2], latch_time: f64, contacts: bool) -> String {
    let why = if !contacts {
        ": the model's flags switch contacts or constraints off".to_owned()
    } else if best == 0.0 {
        ": no effector pressed on the target once it was free, or its contacts cannot hold it in every direction"
            .to_owned()
    } else if best >= needed {
        format!(": it was never good for {latch_time:?} s without a break (latch_time)")
    } else {
        String::new()
    };
    let [best, needed] = [best, needed].map(significant);
    format!("{who} never latched: its quality reached {best} N, and it takes {needed} N (latch_quality){why}")
}

/// What to say of pushes on which the modes differ because full mode, without noslip, creeps.
pub fn creep_notes(pairs: &[Pair], noslip: usize) -> Vec<String> {
    if noslip > 0 {
        return Vec::new();
    }
    pairs.iter().filter_map(creep_note).collect()
}

fn creep_note(pair: &Pair) -> Option<String> {
    let (full, grasp, compare) = (pair.full.as_ref()?, pair.grasp.as_ref()?, pair.compare.as_ref()?);
    let differ = !compare.same_outcome || compare.relative_error.is_some_and(|e| e > DIFFERENCE);
    if !differ || compare.vacuous || full.error.is_some() || grasp.error.is_some() {
        return None;
    }
    let how = match (full.summary.creep_m_per_s, grasp.summary.creep_m_per_s) {
        (Some(full), Some(grasp)) if full > CREEPS * grasp => {
            format!("it creeps at {:.2} um/s in the last second, grasp mode at {:.2}", full * 1e6, grasp * 1e6)
        }
        (None, _) => "what it holds creeps".to_owned(),
        _ => return None,
    };
    Some(format!("{}: full mode runs without noslip iterations: {how}; compare with --noslip 100", pair.push))
}
