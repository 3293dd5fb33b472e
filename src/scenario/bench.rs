//! What a held grasp costs: five variants of the same scene, interleaved, by one clock around the same stages.
//!
//! All start from the state of the grasp mode at `measure_from`, with the actuators' targets of that time:
//! - `full`: MuJoCo's own contact solve without noslip; `full_noslip`: with 10 iterations of it. Each with the cheapest
//!   of Newton, CG and PGS on dense and sparse matrices that keeps the outcome;
//! - `full_default`: the model's own solver and noslip, untouched;
//! - `grasp`: the grasp controller, latched;
//! - `floor`: no collision, no contacts, no grasp.
//!
//! The variants take turns of half a second of simulation, each turn from the saved state, in an order that rotates. The
//! clock runs over calls of several steps with loads and controls held, as a control loop makes them.

mod report;

use std::collections::BTreeMap;
use std::time::Instant;

use nalgebra::Vector3;

use super::error::Error;
use super::onset::{full_at_measure, onset, outcome};
use super::outcome::{LOSS_DISTANCE, median};
use super::plan::{Plan, Push};
use super::run::Options;
use super::runner::{Mode, Runner};
use crate::grasp::{self, Grasps, Phase, StageClock};
use crate::mujoco::{self, BodyId, JacobianStorage, Simulation, Solver, State};

pub use report::{Phases, Ratio, Report, Timing};

/// Simulated time of one turn \[s\]: both signs of the push.
const TURN: f64 = 0.5;
/// The push turns its sign this often \[s\].
const SIGN: f64 = 0.25;
/// The push over the size at which the target ceases to be held.
const SHARE_OF_ONSET: f64 = 0.5;
/// Turns with which candidates for the full solve are compared.
const TRIAL_TURNS: usize = 4;
/// A candidate that costs so many times the cheapest in the first of them needs no others: a clock that changes meanwhile does
/// not make up for it.
const HOPELESS: f64 = 3.0;
/// Noslip iterations of `full_noslip`.
const NOSLIP: usize = 10;
/// Solves that the cost of inverse kinematics is the median of.
const IK_SOLVES: usize = 2000;
/// How far their goals move from one to the next \[m\].
const IK_STEP: f64 = 0.001;

/// A wrench on the target whose sign turns.
#[derive(Clone, Copy, Debug)]
struct Load {
    body: BodyId,
    force: Vector3<f64>,
    torque: Vector3<f64>,
}

/// One way of stepping the scene.
struct Variant {
    sim: Simulation,
    /// The controllers as they are in the saved state, and at work; none in the engine's own solves.
    grasps: Option<(Grasps, Grasps)>,
    step_ns: Vec<f64>,
    contact_ns: Vec<f64>,
    unlatched: usize,
    frozen: u64,
    /// See [`Grasps::whole_steps`].
    whole: BTreeMap<&'static str, u64>,
    name: Option<(String, bool)>,
}

/// Times the holding phase, at least `steps` steps of each variant, in calls of `substeps` steps each. `progress` is told of
/// finished parts out of [`PARTS`].
///
/// # Errors
/// A scenario that cannot be set up, or a simulation that fails.
pub fn bench(plan: &Plan, steps: usize, substeps: usize, progress: &dyn Fn(u64)) -> Result<Report, Error> {
    let from = plan.timeline.measure_from();
    let mut held = Runner::new(plan, Mode::Grasp, None)?;
    held.advance_to(from)?;
    let ik_us = ik_cost(&held)?;
    let latched = held.grasp().phase() == Phase::Grasped;
    let reference = full_at_measure(plan, Options::default())?;
    let no_onset = |push: &Push, why| format!("push {} has no onset: {why}", push.name);
    let found = match plan.pushes.first() {
        Some(push) => onset(&reference, plan, push).map_err(|why| no_onset(push, why)),
        None => Err("the scenario has no push".to_owned()),
    };
    let onset_factor = found.as_ref().ok().copied();
    plan.stop.check()?;
    progress(1);
    let (sim, grasps) = held.into_parts();
    let state = sim.save();
    let bench = Bench { plan, reference, sim, grasps, state, steps, substeps: substeps.max(1) };
    let still = bench.phases(None)?;
    progress(1);
    let pushed = match (plan.pushes.first(), onset_factor) {
        (Some(push), Some(factor)) => Some(bench.phases(Some(&push.scaled(SHARE_OF_ONSET * factor)))?),
        _ => None,
    };
    progress(1);
    Ok(Report {
        scenario: plan.name.clone(),
        engine: mujoco::mujoco_version(),
        nv: plan.model.nv(),
        still,
        pushed,
        not_pushed: found.err(),
        ik_us,
        onset_factor,
        latched,
    })
}

/// Parts of [`bench()`] that progress is told of.
pub const PARTS: u64 = 3;

struct Bench<'a> {
    plan: &'a Plan,
    /// Full mode with the MJCF's options at `measure_from`.
    reference: Runner,
    sim: Simulation,
    grasps: Grasps,
    state: State,
    steps: usize,
    substeps: usize,
}

impl Bench<'_> {
    fn phases(&self, push: Option<&Push>) -> Result<Phases, Error> {
        let load = push.map(|p| Load { body: p.body, force: p.force, torque: p.torque });
        let mut floor = self.engine_variant(None)?;
        floor.sim.set_contacts_enabled(false);
        let mut variants = [
            self.cheapest(0, push, load)?,
            self.cheapest(NOSLIP, push, load)?,
            self.engine_variant(Some(("the model's own".into(), true)))?,
            self.grasp_variant(self.plan.frozen_tolerance)?,
            self.grasp_variant(0.0)?,
            floor,
        ];
        let turns = self.steps.div_ceil(self.turn());
        self.take_turns(&mut variants, turns, load)?;
        let calls = self.turn() / self.substeps;
        let mut timings = variants.map(|variant| variant.timing(calls));
        let floor_us = timings[5].step_us;
        for timing in &mut timings {
            timing.added_us = timing.step_us.zip(floor_us).map(|(step, floor)| step - floor);
        }
        let [full, full_noslip, full_default, grasp, exact, floor] = timings;
        let over = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a / b).filter(|r| r.is_finite());
        let added = grasp.added_us.filter(|added| *added > 0.0);
        let cheaper = |us: fn(&Timing) -> Option<f64>| us(&full).zip(us(&full_default)).map(|(a, b)| a.min(b));
        let ratio = Ratio {
            contact: over(full.contact_us, grasp.contact_us),
            contact_noslip: over(full_noslip.contact_us, grasp.contact_us),
            step: over(full.step_us, grasp.step_us),
            step_noslip: over(full_noslip.step_us, grasp.step_us),
            step_default: over(cheaper(|t| t.step_us), grasp.step_us),
            mean_noslip: over(full_noslip.step_mean_us, grasp.step_mean_us),
            mean_default: over(cheaper(|t| t.step_mean_us), grasp.step_mean_us),
            added: over(full.added_us, added),
            added_noslip: over(full_noslip.added_us, added),
            step_over_floor: over(grasp.step_us, floor.step_us),
        };
        Ok(Phases { steps: turns * self.turn(), full, full_noslip, full_default, grasp, exact, floor, ratio })
    }

    /// Steps of one turn, whole calls.
    fn turn(&self) -> usize {
        ((TURN / self.plan.model.timestep()).round() as usize).max(1).next_multiple_of(self.substeps)
    }

    /// The grasps, from the saved state.
    fn grasp_variant(&self, frozen_tolerance: f64) -> Result<Variant, Error> {
        let mut grasps = self.grasps.clone();
        grasps.set_frozen_tolerance(frozen_tolerance);
        Ok(Variant::new(self.sim.try_clone()?, Some((grasps.clone(), grasps)), None))
    }

    /// MuJoCo's own solve on the model as it was loaded.
    fn engine_variant(&self, name: Option<(String, bool)>) -> Result<Variant, Error> {
        Ok(Variant::new(Simulation::new(&self.plan.model)?, None, name))
    }

    /// The cheapest solver for the full solve with so many noslip iterations that keeps the outcome; if none does
    /// (without noslip a still hand creeps), of all that at least keep the target for a turn.
    fn cheapest(&self, noslip: usize, push: Option<&Push>, load: Option<Load>) -> Result<Variant, Error> {
        let still = Push {
            name: "none".into(),
            grasp: 0,
            body: self.reference.grasp().target(),
            start: 0.0,
            end: 0.0,
            force: Vector3::zeros(),
            torque: Vector3::zeros(),
        };
        let push = push.unwrap_or(&still);
        let wanted = outcome(&self.reference, self.plan, push);
        let mut candidates: Vec<Variant> = Vec::new();
        for solver in [Solver::Newton, Solver::Cg, Solver::Pgs] {
            for storage in [JacobianStorage::Dense, JacobianStorage::Sparse] {
                let mut trial = self.reference.clone();
                configure(trial.sim_mut(), solver, storage, noslip)?;
                let kept = outcome(&trial, self.plan, push) == wanted;
                let name = format!("{solver:?} {storage:?} noslip {noslip}").to_lowercase();
                let mut variant = self.engine_variant(Some((name, kept)))?;
                configure(&mut variant.sim, solver, storage, noslip)?;
                candidates.push(variant);
            }
        }
        if candidates.iter().any(Variant::kept_outcome) {
            candidates.retain(Variant::kept_outcome);
        } else {
            candidates.retain_mut(|v| self.turn_of(v, load).is_ok() && self.keeps_target(v, push.body));
            candidates.iter_mut().for_each(Variant::forget);
        }
        let cost = |v: &Variant| median(v.step_ns.clone()).unwrap_or(f64::INFINITY);
        self.take_turns(&mut candidates, 1, load)?;
        let least = candidates.iter().map(cost).fold(f64::INFINITY, f64::min);
        candidates.retain(|v| cost(v) <= HOPELESS * least);
        self.take_turns(&mut candidates, TRIAL_TURNS - 1, load)?;
        let best = candidates.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b)));
        let Some(mut best) = best else {
            let name = format!("the model's own, noslip {noslip}");
            let mut own = self.engine_variant(Some((name, false)))?;
            own.sim.set_noslip_iterations(noslip)?;
            return Ok(own);
        };
        best.forget();
        Ok(best)
    }

    /// Whether the target is still in the hand after a turn.
    fn keeps_target(&self, variant: &Variant, target: BodyId) -> bool {
        let moved = variant.sim.body_position(target) - self.sim.body_position(target);
        moved.norm() < LOSS_DISTANCE
    }

    /// Every variant runs `turns` turns, one variant after the other, from the saved state.
    fn take_turns(&self, variants: &mut [Variant], turns: usize, load: Option<Load>) -> Result<(), Error> {
        let n = variants.len();
        for turn in 0..turns {
            for k in 0..n {
                self.turn_of(&mut variants[(k + turn) % n], load)?;
            }
        }
        Ok(())
    }

    fn turn_of(&self, variant: &mut Variant, load: Option<Load>) -> Result<(), Error> {
        self.plan.stop.check()?;
        variant.sim.restore(&self.state)?;
        if let Some((saved, working)) = &mut variant.grasps {
            working.clone_from(saved);
        }
        let timestep = self.plan.model.timestep();
        for k in (0..self.turn()).step_by(self.substeps) {
            let time = k as f64 * timestep;
            if let Some(load) = load {
                load.apply(&mut variant.sim, time);
            }
            let failed = |source| Error::Step { what: "bench".into(), time: self.state.time + time, source };
            variant.advance(self.substeps).map_err(failed)?;
        }
        Ok(())
    }
}

impl Load {
    fn apply(&self, sim: &mut Simulation, time: f64) {
        // A sample of the sign in the middle of the step would also do: k * h / 0.25 is only off by rounding.
        let sign = if ((time / SIGN + 1e-9).floor() as i64) % 2 == 0 { 1.0 } else { -1.0 };
        let wrench = &mut sim.xfrc_applied_mut()[6 * self.body.index()..6 * self.body.index() + 6];
        wrench[..3].copy_from_slice((self.force * sign).as_slice());
        wrench[3..].copy_from_slice((self.torque * sign).as_slice());
    }
}

impl Variant {
    fn new(sim: Simulation, grasps: Option<(Grasps, Grasps)>, name: Option<(String, bool)>) -> Self {
        Self {
            sim,
            grasps,
            step_ns: Vec::new(),
            contact_ns: Vec::new(),
            unlatched: 0,
            frozen: 0,
            whole: BTreeMap::new(),
            name,
        }
    }

    /// One call of so many steps.
    fn advance(&mut self, steps: usize) -> Result<(), grasp::Error> {
        let mut clock = StageClock::default();
        let whole = self.is_whole();
        let before = self.frozen_and_whole();
        let start = Instant::now();
        for k in 1..=steps {
            match &mut self.grasps {
                Some((_, grasps)) => {
                    if !whole {
                        grasps.step_timed(&mut self.sim, &mut clock)?;
                    } else if k < steps {
                        grasps.substep(&mut self.sim)?;
                    } else {
                        grasps.step(&mut self.sim)?;
                    }
                    self.unlatched += usize::from(grasps.iter().any(|g| g.phase() != Phase::Grasped));
                }
                None if whole => self.sim.step()?,
                None => grasp::engine_step_timed(&mut self.sim, &mut clock)?,
            }
        }
        self.step_ns.push(start.elapsed().as_nanos() as f64 / steps as f64);
        // the grasps' own counts begin anew with each turn
        let (frozen, reasons) = self.frozen_and_whole();
        self.frozen += frozen - before.0;
        for (why, count) in reasons {
            *self.whole.entry(why).or_default() += count - before.1.get(why).unwrap_or(&0);
        }
        if !whole {
            self.contact_ns.push(clock.contact.as_nanos() as f64 / steps as f64);
        }
        Ok(())
    }

    /// Whether the step has parts that are not made in stages: islands and sleeping of the engine's own solve; or is not made
    /// in the same stages as others, on frozen geometry.
    fn is_whole(&self) -> bool {
        match &self.grasps {
            Some((_, grasps)) => grasps.frozen_tolerance() > 0.0,
            None => self.sim.model().has_islands() || self.sim.model().has_sleeping(),
        }
    }

    /// Steps so far on frozen geometry, and why others were not.
    fn frozen_and_whole(&self) -> (u64, BTreeMap<&'static str, u64>) {
        let grasps = self.grasps.as_ref().map(|(_, grasps)| grasps);
        grasps.map_or_else(Default::default, |grasps| (grasps.frozen_steps(), grasps.whole_steps().collect()))
    }

    fn kept_outcome(&self) -> bool {
        self.name.as_ref().is_some_and(|(_, kept)| *kept)
    }

    fn forget(&mut self) {
        self.step_ns.clear();
        self.contact_ns.clear();
    }

    /// Of turns of so many calls.
    fn timing(self, calls: usize) -> Timing {
        let (solver, kept_outcome) = self.name.unzip();
        Timing {
            step_mean_us: mean_of_turns(&self.step_ns, calls).map(|ns| ns * 1e-3),
            step_us: median(self.step_ns).map(|ns| ns * 1e-3),
            contact_us: median(self.contact_ns).map(|ns| ns * 1e-3),
            added_us: None,
            solver,
            kept_outcome,
            unlatched_steps: self.grasps.as_ref().map(|_| self.unlatched),
            substructured_steps: self.grasps.map(|_| self.frozen),
            whole_steps: self.whole.into_iter().filter(|(_, count)| *count > 0).collect(),
        }
    }
}

/// Mean over a turn of so many calls, each the median of its times in all turns: what was called costs more or less, and the
/// machine's own noise does not count.
fn mean_of_turns(times: &[f64], calls: usize) -> Option<f64> {
    let of_call = |call: usize| median(times.iter().skip(call).step_by(calls).copied().collect());
    let sum: Option<f64> = (0..calls).map(of_call).sum();
    sum.map(|sum| sum / calls as f64)
}

fn configure(sim: &mut Simulation, solver: Solver, storage: JacobianStorage, noslip: usize) -> Result<(), Error> {
    sim.set_solver(solver)?;
    sim.set_jacobian_storage(storage)?;
    sim.set_noslip_iterations(noslip)?;
    Ok(())
}

/// Median time of a solve whose goals moved by [`IK_STEP`] since the last one, all trackers together.
fn ik_cost(runner: &Runner) -> Result<Option<f64>, Error> {
    let mut problems: Vec<_> =
        runner.trackers().iter().map(|t| (t.solver().clone(), t.problem(runner.sim()))).collect();
    if problems.is_empty() {
        return Ok(None);
    }
    let mut times = Vec::with_capacity(IK_SOLVES);
    for k in 0..IK_SOLVES {
        let move_by = Vector3::z() * if k % 2 == 0 { IK_STEP } else { -IK_STEP };
        for (_, (_, goals)) in &mut problems {
            goals.iter_mut().for_each(|g| *g += move_by);
        }
        let start = Instant::now();
        for (solver, (palm, goals)) in &mut problems {
            solver.solve(palm, goals)?;
        }
        times.push(start.elapsed().as_nanos() as f64 * 1e-3);
    }
    Ok(median(times))
}

#[cfg(test)]
mod tests {
    use super::mean_of_turns;

    #[test]
    fn a_call_that_costs_more_counts_and_one_slow_turn_does_not() {
        // two turns in three calls, and the second is slow once
        let times = [1.0, 9.0, 1.0, 9.0, 100.0, 9.0];
        assert_eq!(mean_of_turns(&times, 2), Some(5.0));
        assert_eq!(mean_of_turns(&[], 2), None);
    }
}
