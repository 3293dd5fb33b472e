//! One step of a simulation under its grasps.
//!
//! While nothing is latched it is MuJoCo's own step, after whose solve contacts and forces are read. While a grasp is
//! latched its contacts leave the engine's solve between the collision stage and the making of constraint rows; the grasp is
//! solved once the smooth accelerations are known, and its forces take part in the engine's solve of everything else.

use super::controller::{Grasp, Rows};
use super::error::Error;
use super::grasps::Grasps;
use super::monitor::phase::Phase;
use crate::mujoco::{EngineStages, Hooks, JointId, Simulation};
use std::time::{Duration, Instant};

impl Grasps {
    /// Advances `sim` by one step: MuJoCo's step, with the contacts of each latched grasp replaced. Where only the state is
    /// wanted after most steps, [`steps`](Self::steps) is several times quicker.
    ///
    /// While nothing is latched this is [`Simulation::step`] bit for bit. A step with a latched grasp has no islands and lets
    /// nothing sleep (MuJoCo 3): what sleeps is woken. The model keeps its flags.
    ///
    /// # Errors
    /// A simulation of another model; what the engine reports; a grasp solve that met numbers that are not finite. As
    /// with [`Simulation::step`], full buffers, bad controls and a reset after a bad number are reported after the step was
    /// made; any other error leaves the step unmade.
    pub fn step(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        self.check_model(sim)?;
        self.adapt_settings(sim)?;
        self.frozen.begin(sim);
        let made = sim.step_with(self);
        self.recover(made)?;
        self.frozen.refresh(sim);
        self.list.iter_mut().for_each(|grasp| grasp.remember(sim.stamp()));
        Ok(())
    }

    /// As [`step`](Self::step), stage by stage throughout, and adds the time of the contact part (collision, making and
    /// projecting constraints, solving, and all work of the grasps) to `clock`. A step without a latched grasp has neither
    /// islands nor sleeping here either, as its contact part could not be told from the rest.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn step_timed(&mut self, sim: &mut Simulation, clock: &mut StageClock) -> Result<(), Error> {
        self.check_model(sim)?;
        clock.time(|| self.adapt_settings(sim))?;
        self.frozen.forget();
        self.frozen.begin(sim);
        let made = sim.step_with(&mut Timed { hooks: self, clock });
        self.recover(made)
    }

    /// Where the grasps have not let a step be made, the next one has nothing of it to go on from: numbers that are not finite
    /// would stay for good.
    pub(super) fn recover(&mut self, made: Result<(), Error>) -> Result<(), Error> {
        if !matches!(made, Ok(()) | Err(Error::Engine(_))) {
            self.list.iter_mut().for_each(Grasp::unmake);
            self.frozen.forget();
        }
        made
    }
}

/// A step of the engine's own solve, stage by stage, with the contact part timed.
///
/// # Errors
/// As [`Simulation::step`].
pub fn engine_step_timed(sim: &mut Simulation, clock: &mut StageClock) -> Result<(), Error> {
    Ok(sim.step_with(&mut Timed { hooks: &mut EngineStages, clock })?)
}

impl Hooks for Grasps {
    type Error = Error;

    fn in_stages(&self) -> bool {
        self.latched().next().is_some()
    }

    fn keeps_inertia(&self) -> bool {
        self.frozen.keeps_inertia()
    }

    /// Collision detection; the contacts of latched grasps do not go on to the engine's solve.
    fn collision(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        if self.detect_alone(sim)? {
            return Ok(());
        }
        sim.collision()?;
        for grasp in self.list.iter_mut().filter(|g| g.phase() == Phase::Grasped) {
            grasp.take_contacts(sim)?;
        }
        Ok(())
    }

    fn make_constraint(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        Grasps::make_constraint(self, sim)
    }

    /// What only the engine's dual solvers need waits until it is known that one has to run.
    fn project_constraint(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        if self.may_be_complete() { Ok(()) } else { Ok(sim.project_constraint()?) }
    }

    fn velocity(&mut self, sim: &mut Simulation) {
        self.frozen.add_turn(sim);
    }

    /// The grasp forces join the smooth forces for the engine's solve and are counted as constraint forces after it, as
    /// the contacts that they stand for would be.
    fn constraint(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        if self.latched().next().is_none() {
            return Ok(sim.constraint()?);
        }
        check_acceleration(sim)?;
        self.force.clear(sim.model().nv());
        let merged = self.list.iter().any(Grasp::is_merged);
        if merged {
            for grasp in self.list.iter_mut().filter(|g| g.is_merged()) {
                grasp.load_merged(sim, self.frozen.is_now(), &mut self.force.generalised)?;
            }
        }
        if !self.solve_merged(sim)? {
            if merged {
                self.force.apply(sim)?;
            }
            let solved_rows = self.solve_cones(sim)?;
            if merged || solved_rows < sim.nefc() {
                if self.may_be_complete() {
                    sim.project_constraint()?;
                }
                self.force.apply(sim)?;
                sim.constraint()?;
                self.force.count_as_constraint(sim);
            }
            if solved_rows > 0 || !merged && sim.nefc() == 0 {
                // rows that were solved together with a grasp have the forces of that solve
                for grasp in &self.list {
                    grasp.write_row_forces(sim);
                }
                if self.frozen.wants_state_only() {
                    sim.impose_forces_to_integrate(&self.force.generalised)?;
                } else {
                    sim.impose_constraint_forces(&self.force.generalised)?;
                }
            }
        }
        for grasp in self.list.iter_mut().filter(|g| g.is_merged()) {
            grasp.read_merged(sim);
        }
        if self.frozen.wants_state_only() {
            return Ok(());
        }
        let mut offset = 0;
        for grasp in self.latched() {
            grasp.show_forces(sim, &mut offset)?;
        }
        Ok(())
    }

    /// Reads quality, and latches or releases.
    fn observe(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        if self.frozen.is_now() {
            self.list.iter_mut().filter(|g| g.phase() == Phase::Grasped).for_each(|grasp| grasp.observe_frozen(sim));
            return Ok(());
        }
        self.list.iter_mut().try_for_each(|grasp| match grasp.phase() {
            Phase::Grasped => {
                grasp.observe_grasped(sim);
                Ok(())
            }
            Phase::Ungrasped => grasp.observe_ungrasped(sim),
        })
    }

    fn forget(&mut self) {
        self.list.iter_mut().for_each(Grasp::release);
        self.frozen.forget();
    }
}

impl Grasps {
    pub(super) fn latched(&self) -> impl Iterator<Item = &Grasp> {
        self.list.iter().filter(|g| g.phase() == Phase::Grasped)
    }

    /// Finds the contacts of all latched grasps in the place of the engine's collision stage; false if the engine has to look
    /// itself, because something else might touch something.
    fn detect_alone(&mut self, sim: &mut Simulation) -> Result<bool, Error> {
        let latched = self.list.iter().enumerate().filter(|(_, grasp)| grasp.phase() == Phase::Grasped);
        let alone = self.detector.replaces_collision(sim, latched.map(|(number, grasp)| (number, grasp.topology())))?;
        if alone {
            for grasp in self.list.iter_mut().filter(|g| g.phase() == Phase::Grasped) {
                grasp.read_found(sim, self.detector.found())?;
            }
        }
        Ok(alone)
    }

    /// Whether the grasps may leave the engine's solver nothing to do.
    fn may_be_complete(&self) -> bool {
        self.list.iter().any(Grasp::is_cones) != self.list.iter().any(Grasp::is_merged)
    }

    /// Solves all rows of a step whose latched grasps are all merged; false if that is not so, or if there are rows for the
    /// engine's own solver.
    fn solve_merged(&mut self, sim: &mut Simulation) -> Result<bool, Error> {
        if self.list.iter().any(Grasp::is_cones) {
            // none of its rows is this step's
            self.bounded_rows.forget();
            return Ok(false);
        }
        if self.frozen.is_now() {
            return self.bounded_rows.resume(sim, &self.force.generalised);
        }
        let welds = self.weld_rows(sim);
        self.bounded_rows.solve(sim, &welds, &self.force.generalised)
    }

    /// Solves the latched grasps with friction cones, those that move each other as one problem; returns how many of the
    /// engine's rows were solved with them.
    fn solve_cones(&mut self, sim: &Simulation) -> Result<usize, Error> {
        let alone = self.latched().count() == 1;
        let made_from = if self.frozen.is_now() {
            self.list.iter_mut().for_each(Grasp::unsolve);
            Rows::Frozen
        } else {
            Rows::Made { welds: self.weld_rows(sim), alone }
        };
        let mut rows = 0;
        for i in 0..self.list.len() {
            let Some((leader, others)) = self.list[i..].split_first_mut() else { break };
            if leader.awaits_solve() || alone && leader.is_cones() {
                leader.solve_cones(sim, others, &made_from, &mut self.force.generalised)?;
                rows += leader.solved_rows();
            } else {
                leader.forget_coupled();
            }
        }
        Ok(rows)
    }
}

/// That everything would accelerate by finite numbers without constraints.
fn check_acceleration(sim: &Simulation) -> Result<(), Error> {
    let Some(dof) = sim.qacc_smooth().iter().position(|a| !a.is_finite()) else { return Ok(()) };
    let model = sim.model();
    let gravity = model.gravity();
    let inputs = [
        ("xfrc_applied", sim.xfrc_applied()),
        ("qfrc_applied", sim.qfrc_applied()),
        ("act", sim.act()),
        ("gravity", gravity.as_slice()),
    ];
    let bad = |(name, values): (&str, &[f64])| {
        let i = values.iter().position(|x| !x.is_finite())?;
        Some(format!("{name}[{i}] is {}", values[i]))
    };
    let cause = inputs.into_iter().find_map(bad).unwrap_or_else(|| "look for a number in the model that is not".into());
    let joint = model.label(JointId::from_index(model.dof_jntid()[dof] as usize));
    Err(Error::BadAcceleration { time: sim.time(), joint, cause })
}

/// A stopwatch over the parts of a step that exist because of contacts or grasps.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageClock {
    /// Time of the contact part since the clock was made.
    pub contact: Duration,
}

impl StageClock {
    fn time<T>(&mut self, stage: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = stage();
        self.contact += start.elapsed();
        out
    }
}

/// Hooks by the clock.
struct Timed<'a, H> {
    hooks: &'a mut H,
    clock: &'a mut StageClock,
}

impl<H: Hooks> Hooks for Timed<'_, H> {
    type Error = H::Error;

    fn collision(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        self.clock.time(|| self.hooks.collision(sim))
    }

    fn make_constraint(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        self.clock.time(|| self.hooks.make_constraint(sim))
    }

    fn project_constraint(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        self.clock.time(|| self.hooks.project_constraint(sim))
    }

    fn constraint(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        self.clock.time(|| self.hooks.constraint(sim))
    }

    fn observe(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        self.clock.time(|| self.hooks.observe(sim))
    }

    fn forget(&mut self) {
        self.hooks.forget();
    }
}
