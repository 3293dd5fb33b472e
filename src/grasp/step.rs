//! One step of a simulation under grasp controllers.
//!
//! Contacts leave the engine's solve between its collision stage and its constraint making; the grasp is solved once
//! the smooth accelerations are known, and its forces take part in the engine's solve of everything else.

use super::controller::Grasp;
use super::dense;
use super::error::Error;
use super::phase::Phase;
use super::weld;
use crate::mujoco::{ENABLE_ENERGY, Simulation};
use std::time::{Duration, Instant};

/// A stopwatch over the parts of a step that exist because of contacts or grasps.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageClock {
    /// Time of the contact part since the clock was made.
    pub contact: Duration,
}

/// Measures contact stages, or nothing at no cost.
trait Clock {
    fn contact<T>(&mut self, stage: impl FnOnce() -> T) -> T;
}

impl Clock for StageClock {
    fn contact<T>(&mut self, stage: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = stage();
        self.contact += start.elapsed();
        out
    }
}

struct NoClock;

impl Clock for NoClock {
    #[inline]
    fn contact<T>(&mut self, stage: impl FnOnce() -> T) -> T {
        stage()
    }
}

/// Advances `sim` by one step under `grasps`: MuJoCo's step, with the contacts of each latched grasp replaced.
///
/// # Errors
/// What the engine reports, or a grasp solve that met numbers that are not finite.
pub fn step(sim: &mut Simulation, grasps: &mut [Grasp]) -> Result<(), Error> {
    advance(sim, grasps, &mut NoClock)
}

/// As [`step`], and adds the time of the contact part (collision, making and projecting constraints, solving, and all
/// work of the grasps) to `clock`.
///
/// # Errors
/// As [`step`].
pub fn step_timed(sim: &mut Simulation, grasps: &mut [Grasp], clock: &mut StageClock) -> Result<(), Error> {
    advance(sim, grasps, clock)
}

/// A step of the engine's own solve, stage by stage, with the contact part timed.
///
/// # Errors
/// What the engine reports.
pub fn engine_step_timed(sim: &mut Simulation, clock: &mut StageClock) -> Result<(), Error> {
    advance(sim, &mut [], clock)
}

fn advance(sim: &mut Simulation, grasps: &mut [Grasp], clock: &mut impl Clock) -> Result<(), Error> {
    weld::adapt_settings(sim, grasps)?;
    sim.check_pos()?;
    sim.check_vel()?;
    sim.kinematics()?;
    sim.inertia()?;
    clock.contact(|| -> Result<(), Error> {
        detect(sim, grasps)?;
        weld::make_constraint(sim, grasps)
    })?;
    sim.transmission()?;
    // what only the engine's dual solvers need waits until it is known that one has to run
    let may_be_complete = may_be_complete(grasps);
    if !may_be_complete {
        clock.contact(|| sim.project_constraint())?;
    }
    sim.sensor_pos()?;
    let energy = sim.model().enable_flags() & ENABLE_ENERGY != 0;
    if energy {
        sim.energy_pos()?;
    }
    sim.velocity()?;
    sim.sensor_vel()?;
    if energy {
        sim.energy_vel()?;
    }
    sim.actuation()?;
    sim.acceleration()?;
    clock.contact(|| solve(sim, grasps, may_be_complete))?;
    sim.sensor_acc()?;
    sim.check_acc()?;
    clock.contact(|| -> Result<(), Error> {
        for grasp in grasps.iter_mut() {
            match grasp.phase() {
                Phase::Grasped => grasp.observe_grasped(sim),
                Phase::Ungrasped => grasp.observe_ungrasped(sim)?,
            }
        }
        Ok(())
    })?;
    sim.integrate()?;
    Ok(())
}

/// Whether the grasps may leave the engine's solver nothing to do.
fn may_be_complete(grasps: &[Grasp]) -> bool {
    grasps.iter().any(Grasp::is_cones) && !grasps.iter().any(Grasp::is_merged)
}

/// Collision detection; the contacts of latched grasps do not go on to the engine's solve.
fn detect(sim: &mut Simulation, grasps: &mut [Grasp]) -> Result<(), Error> {
    if Grasp::detect_alone(sim, grasps)? {
        return Ok(());
    }
    sim.collision()?;
    for grasp in grasps.iter_mut().filter(|g| g.phase() == Phase::Grasped) {
        grasp.take_contacts(sim)?;
    }
    Ok(())
}

/// The grasp forces join the smooth forces for the engine's solve and are counted as constraint forces after it, as the
/// contacts that they stand for would be. `unprojected`: the engine's rows have not been projected yet.
fn solve(sim: &mut Simulation, grasps: &mut [Grasp], unprojected: bool) -> Result<(), Error> {
    let Some(first) = grasps.iter().position(|g| g.phase() == Phase::Grasped) else {
        return Ok(sim.constraint()?);
    };
    let mut force = grasps[first].borrow_force(sim.model().nv());
    let merged = grasps.iter().any(|g| g.is_merged());
    if merged {
        for grasp in grasps.iter_mut().filter(|g| g.is_merged()) {
            grasp.load_merged(sim, &mut force.generalised)?;
        }
        force.apply(sim)?;
    }
    let solved_rows = solve_cones(sim, grasps, &mut force)?;
    if merged || solved_rows < sim.nefc() {
        if unprojected {
            sim.project_constraint()?;
        }
        force.apply(sim)?;
        sim.constraint()?;
        force.count_as_constraint(sim);
    }
    if solved_rows > 0 || !merged && sim.nefc() == 0 {
        // rows that were solved together with a grasp have the forces of that solve
        for grasp in grasps.iter() {
            grasp.write_row_forces(sim);
        }
        sim.impose_constraint_forces(&force.generalised)?;
    }
    for grasp in grasps.iter_mut().filter(|g| g.is_merged()) {
        grasp.read_merged(sim);
    }
    grasps[first].return_force(force);
    let mut offset = 0;
    for grasp in grasps.iter().filter(|g| g.phase() == Phase::Grasped) {
        grasp.show_forces(sim, &mut offset)?;
    }
    Ok(())
}

/// Solves the latched grasps with friction cones, those that move each other as one problem; returns how many of the
/// engine's rows were solved with them.
fn solve_cones(sim: &Simulation, grasps: &mut [Grasp], force: &mut GraspForce) -> Result<usize, Error> {
    let alone = grasps.iter().filter(|g| g.phase() == Phase::Grasped).count() == 1;
    let welds = weld::rows(sim, grasps);
    let mut rows = 0;
    for i in 0..grasps.len() {
        let Some((leader, others)) = grasps[i..].split_first_mut() else { break };
        if leader.awaits_solve() || alone && leader.is_cones() {
            leader.solve_cones(sim, others, &welds, &mut force.generalised)?;
            rows += leader.solved_rows();
        } else {
            leader.leave_neighbours();
        }
    }
    Ok(rows)
}

/// The generalised force of all latched grasps, and what it replaces for the time of the engine's solve.
#[derive(Clone, Debug, Default)]
pub(super) struct GraspForce {
    generalised: Vec<f64>,
    acceleration: Vec<f64>,
    /// The engine's own, while the grasps' forces are among them.
    smooth_force: Vec<f64>,
    smooth_acceleration: Vec<f64>,
}

impl GraspForce {
    /// Zero, of `nv` entries; the memory is kept.
    pub(super) fn cleared(mut self, nv: usize) -> Self {
        self.generalised.clear();
        self.generalised.resize(nv, 0.0);
        self.smooth_force.clear();
        self
    }

    /// Adds all that is known so far to the engine's smooth forces, in the place of what was there of it before.
    fn apply(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        if self.smooth_force.is_empty() {
            self.smooth_force.extend_from_slice(sim.qfrc_smooth());
            self.smooth_acceleration.clear();
            self.smooth_acceleration.extend_from_slice(sim.qacc_smooth());
        } else {
            self.restore(sim);
        }
        self.acceleration.clone_from(&self.generalised);
        sim.solve_mass(&mut self.acceleration)?;
        dense::axpy(1.0, &self.generalised, sim.qfrc_smooth_mut());
        dense::axpy(1.0, &self.acceleration, sim.qacc_smooth_mut());
        Ok(())
    }

    fn restore(&self, sim: &mut Simulation) {
        sim.qfrc_smooth_mut().copy_from_slice(&self.smooth_force);
        sim.qacc_smooth_mut().copy_from_slice(&self.smooth_acceleration);
    }

    fn count_as_constraint(&self, sim: &mut Simulation) {
        self.restore(sim);
        dense::axpy(1.0, &self.generalised, sim.qfrc_constraint_mut());
    }
}
