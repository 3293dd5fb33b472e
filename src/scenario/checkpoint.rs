//! A scenario just before its push, from where each of many pushes goes on as if it had been simulated from the start.
//!
//! The copy is of everything, engine and controllers: contacts, forces, warm start, and what the grasp remembers. What was
//! recorded from `measure_from` on is kept too, so that outcomes and comparisons are those of a whole run.

use serde::Serialize;

use super::error::Error;
use super::outcome::{LOSS_DISTANCE, Motion, Outcome, Summary, summarize};
use super::plan::{Plan, Push};
use super::run::Options;
use super::runner::{Mode, Runner};
use super::trajectory::Trajectory;
use crate::grasp::Phase;

/// Noslip iterations of the stricter full solve that a disagreement is tried with, over full mode's own.
pub const STRICTER: usize = 10;

/// A simulation at the start of a push.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    runner: Runner,
    /// From `measure_from` until now.
    recorded: Trajectory,
    measure_from: f64,
}

/// What became of one push.
#[derive(Clone, Debug)]
pub struct Pushed {
    /// From `measure_from` to the end, or until the target had moved 5 cm and was lost for certain.
    pub trajectory: Trajectory,
    /// Its numbers; no outcome if the simulation failed.
    pub summary: Summary,
    /// Why it failed.
    pub error: Option<String>,
}

/// How one run of a trial ended.
#[derive(Clone, Debug, Serialize)]
pub struct Ending {
    /// `None` if the simulation failed.
    pub outcome: Option<Outcome>,
    /// \[m\]
    pub peak_motion_m: Option<f64>,
    /// Of a lost target where it was when it was lost \[m\].
    pub final_offset_m: Option<f64>,
    /// \[rad\]
    pub peak_rotation_rad: Option<f64>,
    /// \[s\]
    pub slip_onset_s: Option<f64>,
    /// As in [`Summary`].
    pub latched_share: Option<f64>,
    /// As in [`Summary`].
    pub substructured_share: Option<f64>,
    /// Why the simulation failed.
    pub error: Option<String>,
}

impl Checkpoint {
    /// Simulates `plan` without any push until `push` would start.
    ///
    /// # Errors
    /// A scenario that cannot be set up or run so far.
    pub fn new(plan: &Plan, mode: Mode, push: &Push, options: Options) -> Result<Self, Error> {
        // The run is about the grasp whose target is pushed.
        let mut runner = Runner::new(plan, mode, Some(push))?;
        runner.set_push(None);
        options.set_noslip(runner.sim_mut())?;
        let measure_from = plan.timeline.measure_from();
        runner.advance_to(measure_from)?;
        let mut recorded = runner.trajectory();
        let half = 0.5 * plan.model.timestep();
        while runner.time() < push.start - half {
            let sample = runner.step()?;
            recorded.push(sample, runner.normal_forces());
        }
        Ok(Self { runner, recorded, measure_from })
    }

    /// The simulation as it is.
    pub fn runner(&self) -> &Runner {
        &self.runner
    }

    /// Whether the grasp is latched.
    pub fn is_latched(&self) -> bool {
        self.runner.grasp().phase() == Phase::Grasped
    }

    /// Goes on from here with `push` to the end of the scenario.
    pub fn push(&self, push: &Push) -> Pushed {
        let mut runner = self.runner.clone();
        runner.set_push(Some(push));
        let mut trajectory = self.recorded.clone();
        let mut error = None;
        while !runner.is_over() {
            match runner.step() {
                Ok(sample) => trajectory.push(sample, runner.normal_forces()),
                Err(e) => {
                    error = Some(e.to_string());
                    break;
                }
            }
            if moved_away(&trajectory) {
                break;
            }
        }
        let mut summary = summarize(&trajectory, self.measure_from, Some(push.end));
        if error.is_some() {
            summary.forget_the_end();
        }
        if runner.mode() == Mode::Full {
            summary.forget_the_latch();
        }
        Pushed { trajectory, summary, error }
    }

    /// Whether `push` has another outcome than `outcome` with [`STRICTER`] times the noslip iterations from here on: then
    /// the reference does not know it either. `None` without any noslip iterations, and if the engine refuses.
    pub(super) fn is_chaotic(&self, push: &Push, outcome: Option<Outcome>) -> Option<bool> {
        let noslip = self.runner.sim().model().noslip_iterations();
        let mut stricter = self.clone();
        stricter.runner.sim_mut().set_noslip_iterations(STRICTER * noslip).ok()?;
        (noslip > 0).then(|| stricter.push(push).summary.outcome != outcome)
    }

    /// Whether `push` is held. A simulation that fails under it holds nothing.
    pub fn holds(&self, push: &Push) -> bool {
        self.push(push).summary.outcome == Some(Outcome::Held)
    }
}

impl Pushed {
    /// In short.
    pub fn ending(&self) -> Ending {
        let s = &self.summary;
        Ending {
            outcome: s.outcome,
            peak_motion_m: s.peak_motion_m,
            final_offset_m: s.final_offset_m,
            peak_rotation_rad: s.peak_rotation_rad,
            slip_onset_s: s.slip_onset_s,
            latched_share: s.latched_share,
            substructured_share: s.substructured_share,
            error: self.error.clone(),
        }
    }
}

/// Whether the target has moved so far that it is lost whatever follows.
fn moved_away(trajectory: &Trajectory) -> bool {
    match trajectory.samples() {
        [start, .., now] => Motion::between(start, now).offset.norm() >= LOSS_DISTANCE,
        _ => false,
    }
}
