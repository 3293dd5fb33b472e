//! One scenario in one mode with one push, step by step.

use std::time::Instant;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::control::Schedule;
use super::error::Error;
use super::length;
use super::pin::Pin;
use super::plan::{Plan, Push};
use super::stop::Stop;
use super::tracker::{Feel, Tracker};
use super::trajectory::{Sample, Trajectory};
use super::watch::{Now, Watch};
use crate::grasp::{self, Grasp, GraspId, Grasps, Phase};
use crate::mujoco::{BodyId, Simulation};

/// How contacts between hand and target are simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// MuJoCo's own contact solve, with the options that the MJCF sets.
    Full,
    /// The grasp controller.
    Grasp,
}

impl Mode {
    /// As in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Grasp => "grasp",
        }
    }
}

/// A simulation of a scenario under way.
#[derive(Clone, Debug)]
pub struct Runner {
    mode: Mode,
    sim: Simulation,
    /// Shows the poses of a step on frozen geometry, which `sim` has not; full mode makes none.
    poses: Option<Simulation>,
    grasps: Grasps,
    trackers: Vec<Tracker>,
    schedule: Schedule,
    ctrl: Vec<f64>,
    pins: Vec<Pin>,
    push: Option<Push>,
    pin_until: f64,
    measure_from: f64,
    timestep: f64,
    total_steps: u64,
    steps: u64,
    stop: Stop,
    /// One for each grasp.
    watches: Vec<Watch>,
    /// The last step's, one for each grasp.
    samples: Vec<Sample>,
    /// Index of the grasp that the run is about.
    watched: usize,
}

impl Runner {
    /// Sets the scenario up at its start.
    ///
    /// # Errors
    /// A grasp or fingertip goals that do not fit the model, a time step that makes no step, a run that is too long to be
    /// recorded.
    pub fn new(plan: &Plan, mode: Mode, push: Option<&Push>) -> Result<Self, Error> {
        Self::set_up(plan, mode, push, |_| ())
    }

    /// Without a push, from the scenario's start as `change` leaves it.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn starting(plan: &Plan, mode: Mode, change: impl FnOnce(&mut Simulation)) -> Result<Self, Error> {
        Self::set_up(plan, mode, None, change)
    }

    fn set_up(
        plan: &Plan,
        mode: Mode,
        push: Option<&Push>,
        change: impl FnOnce(&mut Simulation),
    ) -> Result<Self, Error> {
        plan.stop.check()?;
        plan.check_timestep()?;
        let mut sim = Simulation::new(&plan.model)?;
        if let Some(key) = plan.keyframe {
            sim.reset_to_keyframe(key)?;
        }
        change(&mut sim);
        // Poses and weights for the first step; the solver is not touched.
        sim.kinematics()?;
        sim.inertia()?;
        sim.transmission()?;
        sim.velocity()?;
        let mut grasps = Grasps::new();
        grasps.set_frozen_tolerance(plan.frozen_tolerance);
        let mut trackers = Vec::new();
        for (index, spec) in plan.grasps.iter().enumerate() {
            let id =
                grasps.add(&sim, spec).map_err(|source| Error::Grasp { file: plan.file.clone(), index, source })?;
            let grasp = &grasps[id];
            let tracker = Tracker::new(&sim, &plan.goals, index, grasp.palm(), grasp.target());
            trackers.extend(tracker.map_err(|source| Error::Goal { file: plan.file.clone(), source })?);
        }
        let targets: Vec<BodyId> = grasps.iter().map(Grasp::target).collect();
        let pins = if plan.timeline.pin_until > 0.0 { Pin::all(&mut sim, &targets) } else { Vec::new() };
        let watched = push.map_or(0, |p| p.grasp);
        let runner = Self {
            mode,
            schedule: Schedule::new(sim.ctrl(), &plan.controls),
            ctrl: sim.ctrl().to_vec(),
            watches: grasps.iter().map(|grasp| Watch::new(&sim, grasp)).collect(),
            samples: Vec::with_capacity(grasps.len()),
            watched,
            grasps,
            trackers,
            pins,
            push: push.cloned(),
            pin_until: plan.timeline.pin_until,
            measure_from: plan.timeline.measure_from(),
            timestep: sim.model().timestep(),
            total_steps: length::steps(plan) as u64,
            steps: 0,
            stop: plan.stop.clone(),
            poses: if mode == Mode::Grasp { Some(sim.try_clone()?) } else { None },
            sim,
        };
        runner.check_memory(plan, 1)?;
        Ok(runner)
    }

    /// Time of the next step, from the start of the scenario \[s\], rounded to the nanosecond: k * h is no round number in
    /// binary, and is read by people.
    pub fn time(&self) -> f64 {
        (self.steps as f64 * self.timestep * 1e9).round() / 1e9
    }

    /// Steps of the whole run: one for each multiple of the time step from 0 to the duration.
    pub fn total_steps(&self) -> u64 {
        self.total_steps
    }

    /// Refuses `runs` such runs at once, if what they record cannot fit in memory.
    ///
    /// # Errors
    /// [`Error::Field`], with steps and bytes.
    pub fn check_memory(&self, plan: &Plan, runs: usize) -> Result<(), Error> {
        length::check_memory(plan, length::bytes(plan, self.grasps.iter().map(|g| g.links().len())), runs)
    }

    /// Whether the run is over.
    pub fn is_over(&self) -> bool {
        self.steps >= self.total_steps()
    }

    /// How contacts are simulated.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Goes on in another mode. To full mode every grasp gives its contacts back; in grasp mode a grasp latches once its
    /// quality has been good enough for its latch time from now on, or in full mode before.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn set_mode(&mut self, mode: Mode) -> Result<(), Error> {
        if mode == self.mode {
            return Ok(());
        }
        match mode {
            Mode::Full => {
                let latched = |grasp: &&mut Grasp| grasp.phase() == Phase::Grasped;
                self.grasps.iter_mut().filter(latched).for_each(Grasp::release);
                let restored = self.grasps.restore_settings(&mut self.sim);
                restored.map_err(|source| Error::Step { what: "full mode".into(), time: self.time(), source })?;
                self.poses = None;
            }
            Mode::Grasp => self.poses = Some(self.sim.try_clone()?),
        }
        self.mode = mode;
        Ok(())
    }

    /// Pushes in another way, or not at all, from now on.
    pub fn set_push(&mut self, push: Option<&Push>) {
        if let Some(old) = &self.push {
            self.sim.xfrc_applied_mut()[6 * old.body.index()..6 * old.body.index() + 6].fill(0.0);
        }
        self.push = push.cloned();
    }

    /// The simulation.
    pub fn sim(&self) -> &Simulation {
        &self.sim
    }

    /// The simulation, to change its solver's settings.
    pub fn sim_mut(&mut self) -> &mut Simulation {
        &mut self.sim
    }

    /// The grasp that the run is about.
    pub fn grasp(&self) -> &Grasp {
        &self.grasps[GraspId::nth(self.watched)]
    }

    /// Index of the grasp that the run is about: the first whose target is pushed, or the first.
    pub fn watched(&self) -> usize {
        self.watched
    }

    /// All grasps.
    pub fn grasps(&self) -> &Grasps {
        &self.grasps
    }

    /// Trackers of fingertip goals.
    pub fn trackers(&self) -> &[Tracker] {
        &self.trackers
    }

    /// The simulation and its controllers, as they are.
    pub fn into_parts(self) -> (Simulation, Grasps) {
        (self.sim, self.grasps)
    }

    /// An empty trajectory with the links of the run's grasp and room for the whole run.
    pub fn trajectory(&self) -> Trajectory {
        self.trajectory_of(&self.grasps[GraspId::nth(self.watched)])
    }

    /// An empty trajectory for each grasp, to [`record`](Self::record) in.
    pub fn trajectories(&self) -> Vec<Trajectory> {
        self.grasps.iter().map(|grasp| self.trajectory_of(grasp)).collect()
    }

    fn trajectory_of(&self, grasp: &Grasp) -> Trajectory {
        let model = self.sim.model();
        let names = grasp.links().iter().map(|&link| model.body_column(link));
        Trajectory::new(names.collect(), self.total_steps() as usize)
    }

    /// Appends the last step to `trajectories`, one for each grasp.
    pub fn record(&self, trajectories: &mut [Trajectory]) {
        for ((trajectory, sample), watch) in trajectories.iter_mut().zip(&self.samples).zip(&self.watches) {
            trajectory.push(*sample, watch.normal_forces());
        }
    }

    /// Runs up to `time` without recording.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn advance_to(&mut self, time: f64) -> Result<(), Error> {
        while self.time() < time - 0.5 * self.timestep {
            self.step()?;
        }
        Ok(())
    }

    /// One step; the sample is of the run's grasp in the state that it starts from, with the contacts and forces found
    /// there.
    ///
    /// # Errors
    /// [`Error::Step`]: a simulation that diverged, full buffers, faults of the engine. [`Error::Interrupted`] once the
    /// plan's [`Stop`] was asked.
    pub fn step(&mut self) -> Result<Sample, Error> {
        self.stop.check()?;
        let time = self.time();
        self.step_at(time).map_err(|source| {
            let what = format!("{} mode, push {}", self.mode.name(), self.push.as_ref().map_or("none", |p| &p.name));
            Error::Step { what, time, source }
        })
    }

    fn step_at(&mut self, time: f64) -> Result<Sample, grasp::Error> {
        let half = 0.5 * self.timestep;
        let pinned = time < self.pin_until - half;
        if pinned {
            self.pins.iter().for_each(|pin| pin.hold(&mut self.sim));
        } else {
            self.pins.drain(..).for_each(|pin| pin.let_go(&mut self.sim));
        }
        self.control(time)?;
        self.apply_push(time);
        for grasp in self.grasps.iter_mut() {
            grasp.allow_latch(!pinned);
        }
        for (watch, grasp) in self.watches.iter_mut().zip(&self.grasps) {
            watch.begin(grasp);
        }
        let frozen_before = self.grasps.frozen_steps();
        if let Some(poses) = &mut self.poses {
            poses.qpos_mut().copy_from_slice(self.sim.qpos());
        }
        let clock = Instant::now();
        match self.mode {
            Mode::Full => self.sim.step()?,
            Mode::Grasp => self.grasps.substep(&mut self.sim)?,
        }
        let step_ns = clock.elapsed().as_nanos() as u64;
        if self.mode == Mode::Full {
            self.grasps.monitor(&self.sim)?;
        }
        self.steps += 1;
        let frozen = self.grasps.frozen_steps() > frozen_before;
        let poses = match &mut self.poses {
            Some(poses) if frozen => {
                poses.kinematics()?;
                &*poses
            }
            _ => &self.sim,
        };
        let now = Now { time, step_ns, slipping: (time >= self.measure_from - half).then_some(self.timestep), frozen };
        self.samples.clear();
        for (watch, grasp) in self.watches.iter_mut().zip(self.grasps.iter_mut()) {
            grasp.read_slip(&self.sim);
            self.samples.push(watch.sample(poses, grasp, &now));
        }
        let sample = self.samples[self.watched];
        self.settle();
        Ok(sample)
    }

    /// Normal force of each link of the run's grasp in the last step \[N\].
    pub fn normal_forces(&self) -> &[f64] {
        self.watches[self.watched].normal_forces()
    }

    fn control(&mut self, time: f64) -> Result<(), grasp::Error> {
        self.schedule.apply(time, &mut self.ctrl);
        for tracker in &mut self.trackers {
            let feel = feel(&self.sim, &self.grasps[GraspId::nth(tracker.grasp)], !self.pins.is_empty());
            tracker.drive(&self.sim, time, self.timestep, feel, &mut self.ctrl)?;
        }
        self.sim.ctrl_mut().copy_from_slice(&self.ctrl);
        Ok(())
    }

    fn apply_push(&mut self, time: f64) {
        let Some(push) = &self.push else { return };
        let half = 0.5 * self.timestep;
        let on = time >= push.start - half && time < push.end - half;
        let wrench = &mut self.sim.xfrc_applied_mut()[6 * push.body.index()..6 * push.body.index() + 6];
        wrench.fill(0.0);
        if on {
            wrench[..3].copy_from_slice(push.force.as_slice());
            wrench[3..].copy_from_slice(push.torque.as_slice());
        }
    }

    /// Once a grasp latches, or in full mode would, its fingers keep their targets.
    fn settle(&mut self) {
        let time = self.time();
        for tracker in &mut self.trackers {
            let grasp = &self.grasps[GraspId::nth(tracker.grasp)];
            if (grasp.phase() == Phase::Grasped || grasp.would_latch()) && tracker.finish() {
                for (actuator, target) in tracker.targets() {
                    self.schedule.continue_from(time, actuator, target);
                }
            }
        }
    }
}

/// What the fingers of a grasp felt of their target in the last step.
fn feel(sim: &Simulation, grasp: &Grasp, pinned: bool) -> Feel {
    let model = sim.model();
    let mut load = Vector3::zeros();
    if model.has_gravity() {
        load += model.gravity() * model.body_subtreemass()[grasp.target().index()];
    }
    let mut squeeze = 0.0;
    for contact in grasp.contacts() {
        load += contact.force;
        squeeze += contact.normal_force();
    }
    Feel { weak: grasp.quality() < grasp.latch_quality(), pinned, load, squeeze }
}
