//! Larger time steps: how far the motion is from the full solve at 0.5 ms, what a second costs, and what the grasp saves
//! at the same error.
//!
//! All start from one state, held by a grasp at the scenario's own time step, with controls held. Each settles for a while
//! by its own rule, then the target is pushed and let go again; the error is that of the motion since the push
//! began, of target against palm, so that where each had settled to does not count.

use std::time::Instant;

use anyhow::Context;
use mujoco_grasp::grasp::{GraspId, Grasps, Phase};
use mujoco_grasp::mujoco::{BodyId, Simulation, State};
use mujoco_grasp::scenario::outcome::{LOSS_DISTANCE, median};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;

use super::table::{markdown, ratio};

/// Before the push \[s\].
const SETTLE: f64 = 0.4;
/// How long the push is on, and how long the target is watched after it \[s\].
const PUSH: f64 = 0.4;
/// Motions are compared at multiples of this \[s\], which all time steps divide.
const SAMPLE: f64 = 0.008;
/// Of the reference \[s\].
const FINE: f64 = 0.0005;
/// Of the reference that the noslip pass keeps from creeping.
const CONVERGED: usize = 100;
/// The full solve that creeps less.
const NOSLIP: Solve = Solve::Noslip(10);
/// Every variant runs so often, in turns.
const ROUNDS: usize = 6;

/// How contacts are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Solve {
    /// The model's own options.
    Full,
    /// With so many noslip iterations.
    Noslip(usize),
    Grasp,
}

impl Solve {
    fn name(self) -> String {
        match self {
            Self::Full => "full".into(),
            Self::Noslip(iterations) => format!("full, noslip {iterations}"),
            Self::Grasp => "grasp".into(),
        }
    }
}

/// One way of simulating the push.
#[derive(Debug)]
struct Variant {
    solve: Solve,
    timestep: f64,
    /// Of the last run, at multiples of [`SAMPLE`] \[m\].
    motion: Vec<Vector3<f64>>,
    /// Steps of the last run after which the grasp was not latched.
    unlatched: usize,
    /// Of all runs.
    step_ns: Vec<f64>,
}

/// A push and where it starts.
struct Scene<'a> {
    plan: &'a Plan,
    sim: Simulation,
    grasps: Grasps,
    state: State,
    force: Vector3<f64>,
}

/// The table of one scene, pushed by `force` \[N\].
///
/// # Errors
/// A simulation that fails.
pub fn table(plan: &Plan, force: Vector3<f64>) -> anyhow::Result<String> {
    let mut held = Runner::new(plan, Mode::Grasp, None)?;
    held.advance_to(plan.timeline.measure_from())?;
    let (sim, grasps) = held.into_parts();
    let scene = Scene { plan, state: sim.save(), sim, grasps, force };
    let variant = |solve, timestep| Variant { solve, timestep, motion: Vec::new(), unlatched: 0, step_ns: Vec::new() };
    let mut converged = variant(Solve::Noslip(CONVERGED), FINE);
    scene.run(&mut converged)?;
    let mut variants = vec![variant(Solve::Full, FINE)];
    for solve in [Solve::Full, NOSLIP, Solve::Grasp] {
        // the finest of the grasp has no place in a table of larger steps, those of full make the curves longer
        let finest = (solve != Solve::Grasp).then_some(0.001);
        variants.extend(finest.into_iter().chain([0.002, 0.004, 0.008]).map(|timestep| variant(solve, timestep)));
    }
    let n = variants.len();
    for round in 0..ROUNDS {
        for k in 0..n {
            scene.run(&mut variants[(k + round) % n])?;
        }
    }
    let peak = variants[0].motion.iter().map(|offset| offset.norm()).fold(0.0, f64::max);
    let rows = rows(&variants, &converged)?;
    let head = [
        "solve",
        "step [ms]",
        "from full [um]",
        "from converged [um]",
        "1 s costs [ms]",
        "full as near full / this",
        "noslip 10 as near converged / this",
    ];
    let title = format!("{}: the push moves the target by {:.2} mm.\n\n", plan.name, 1e3 * peak);
    Ok(title + &markdown(&head, rows.into_iter()))
}

/// Errors against both references, costs, and what full would cost at the same error.
fn rows(variants: &[Variant], converged: &Variant) -> anyhow::Result<Vec<Vec<String>>> {
    let references = [&variants[0].motion, &converged.motion];
    let measured = variants
        .iter()
        .map(|v| Ok((references.map(|r| rms_difference(&v.motion, r)), v.cost_of_a_second()?)))
        .collect::<anyhow::Result<Vec<_>>>()?;
    // against itself the reference has no error, and no place on the curve
    let curve = |solve: Solve, reference: usize| -> Vec<(f64, f64)> {
        let of_solve = variants.iter().zip(&measured).filter(|(v, _)| v.solve == solve && !v.is_lost());
        of_solve.map(|(_, (errors, cost))| (errors[reference], *cost)).filter(|(error, _)| *error > 0.0).collect()
    };
    let curves = [curve(Solve::Full, 0), curve(NOSLIP, 1)];
    let row = |(variant, (errors, cost)): (&Variant, &([f64; 2], f64))| {
        let mut cells = vec![variant.name(), format!("{}", 1e3 * variant.timestep)];
        cells.extend(errors.map(|error| if variant.is_lost() { "lost".into() } else { format!("{:.1}", 1e6 * error) }));
        cells.push(format!("{cost:.1}"));
        for (curve, error) in curves.iter().zip(errors) {
            let comparable = variant.solve == Solve::Grasp && !variant.is_lost();
            let full = if comparable { cost_at(curve, *error) } else { None };
            cells.push(full.map_or("-".into(), |full| full.over(*cost)));
        }
        cells
    };
    Ok(variants.iter().zip(&measured).map(row).collect())
}

impl Variant {
    fn name(&self) -> String {
        match self.unlatched {
            0 => self.solve.name(),
            steps => format!("{}, {steps} steps unlatched", self.solve.name()),
        }
    }

    fn is_lost(&self) -> bool {
        self.motion.last().is_none_or(|offset| offset.norm() >= LOSS_DISTANCE)
    }

    /// Of wall clock for a second of simulation \[ms\].
    fn cost_of_a_second(&self) -> anyhow::Result<f64> {
        Ok(median(self.step_ns.clone()).context("nothing was timed")? * 1e-6 / self.timestep)
    }
}

impl Scene<'_> {
    /// Settles, pushes, lets go, and keeps motion and times.
    fn run(&self, variant: &mut Variant) -> anyhow::Result<()> {
        // a latched grasp has replaced settings of its simulation, which a full solve must not find
        let (mut sim, mut grasps) = match variant.solve {
            Solve::Grasp => (self.sim.try_clone()?, self.grasps.clone()),
            Solve::Full | Solve::Noslip(_) => (Simulation::new(&self.plan.model)?, Grasps::new()),
        };
        sim.restore(&self.state)?;
        sim.set_timestep(variant.timestep)?;
        if let Solve::Noslip(iterations) = variant.solve {
            sim.set_noslip_iterations(iterations)?;
        }
        let held = &self.grasps[GraspId::FIRST];
        let (target, palm) = (held.target(), held.palm());
        for _ in 0..(SETTLE / variant.timestep).round() as usize {
            grasps.step(&mut sim)?;
        }
        variant.motion.clear();
        variant.unlatched = 0;
        let mut start = None;
        let sampled = (SAMPLE / variant.timestep).round() as usize;
        for step in 0..(2.0 * PUSH / variant.timestep).round() as usize {
            self.push(&mut sim, target, (step as f64 + 0.5) * variant.timestep < PUSH);
            let clock = Instant::now();
            grasps.step(&mut sim)?;
            variant.step_ns.push(clock.elapsed().as_nanos() as f64);
            variant.unlatched += usize::from(grasps.iter().any(|grasp| grasp.phase() != Phase::Grasped));
            if step % sampled == 0 {
                // poses are those that the step started from
                let now = in_palm(&sim, target, palm);
                variant.motion.push(now - *start.get_or_insert(now));
            }
        }
        Ok(())
    }

    fn push(&self, sim: &mut Simulation, target: BodyId, on: bool) {
        let force = if on { self.force } else { Vector3::zeros() };
        sim.xfrc_applied_mut()[6 * target.index()..6 * target.index() + 3].copy_from_slice(force.as_slice());
    }
}

fn in_palm(sim: &Simulation, target: BodyId, palm: BodyId) -> Vector3<f64> {
    sim.body_rotation(palm).transpose() * (sim.body_position(target) - sim.body_position(palm))
}

fn rms_difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (squares / a.len().min(b.len()).max(1) as f64).sqrt()
}

/// What full costs at some error.
#[derive(Debug)]
enum CostAt {
    Between(f64),
    /// It is more exact than full at its smallest time step: no less than this.
    AtLeast(f64),
    /// Full at its largest time step is more exact than this: no more.
    AtMost(f64),
}

impl CostAt {
    fn over(self, cost: f64) -> String {
        match self {
            Self::Between(full) => ratio(full / cost),
            Self::AtLeast(full) => format!("> {}", ratio(full / cost)),
            Self::AtMost(full) => format!("< {}", ratio(full / cost)),
        }
    }
}

/// The cost at an error, on the (error, cost) curve of growing time steps: linear in the logarithms.
fn cost_at(curve: &[(f64, f64)], error: f64) -> Option<CostAt> {
    let (first, last) = (curve.first()?, curve.last()?);
    if error < first.0 {
        return Some(CostAt::AtLeast(first.1));
    }
    let between = curve.windows(2).find(|pair| (pair[0].0..=pair[1].0).contains(&error));
    Some(match between {
        Some(pair) => {
            let part = (error / pair[0].0).ln() / (pair[1].0 / pair[0].0).ln();
            CostAt::Between(pair[0].1 * (pair[1].1 / pair[0].1).powf(part))
        }
        None => CostAt::AtMost(last.1),
    })
}
