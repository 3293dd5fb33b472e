//! What happens to a simulation in a window, without the window.
//!
//! Everything that the mouse and the keys do to the simulation comes down to [`Action`]s, each of which takes effect before
//! a certain step. So what was done in a window is a list of [`Event`]s, which gives the same simulation bit for bit when it
//! is replayed, at whatever pace, with or without a window.

use nalgebra::{Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::digest::Digest;
use crate::grasp::Grasps;
use crate::mujoco::{BodyId, CompiledModel, Simulation};
use crate::scenario::Error;
use crate::scenario::plan::Plan;
use crate::scenario::runner::{Mode, Runner};

/// Something that changes what the next steps compute.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Action {
    /// A wrench at a body's centre of mass, world axes, from now on in the place of the one before.
    Push {
        /// Its name, or `body` and its number where it has none.
        body: String,
        /// \[N\]
        force: [f64; 3],
        /// \[N m\]
        torque: [f64; 3],
    },
    /// No wrench any more.
    Release,
    /// Full or grasp mode from now on.
    Mode(Mode),
    /// Back to the start of the scenario, in the present mode, without a wrench.
    Reset,
}

/// An action and the step before which it takes effect, counted from the beginning of the session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Steps made before it, resets notwithstanding.
    pub step: u64,
    /// What happens then.
    #[serde(rename = "do")]
    pub action: Action,
}

/// A scenario that is acted upon while it runs. It begins in grasp mode.
pub struct Session {
    plan: Plan,
    runner: Runner,
    pushed: Option<BodyId>,
    steps: u64,
    events: Vec<Event>,
    digest: Digest,
}

impl Session {
    /// At the start of the scenario.
    ///
    /// # Errors
    /// As [`Runner::new`].
    pub fn new(plan: &Plan) -> Result<Self, Error> {
        let runner = Runner::new(plan, Mode::Grasp, None)?;
        let (plan, digest) = (plan.clone(), Digest::default());
        Ok(Self { plan, runner, pushed: None, steps: 0, events: Vec::new(), digest })
    }

    /// Does something before the next step.
    ///
    /// # Errors
    /// [`Error::Engine`] for a body that the model does not have or a wrench that is not finite; as [`Runner::new`] and
    /// [`Runner::set_mode`].
    pub fn act(&mut self, action: Action) -> Result<(), Error> {
        match &action {
            Action::Push { body, force, torque } => {
                let body = body_named(self.runner.sim().model(), body)?;
                if let Some(value) = force.iter().chain(torque).find(|v| !v.is_finite()) {
                    let (what, rule) = ("a push of the session", "finite");
                    return Err(crate::mujoco::Error::Value { what, value: *value, rule }.into());
                }
                self.release()?;
                self.runner.sim_mut().set_body_wrench(body, &(*force).into(), &(*torque).into())?;
                self.pushed = Some(body);
            }
            Action::Release => self.release()?,
            Action::Mode(mode) => self.runner.set_mode(*mode)?,
            Action::Reset => {
                self.runner = Runner::new(&self.plan, self.runner.mode(), None)?;
                self.pushed = None;
            }
        }
        self.events.push(Event { step: self.steps, action });
        Ok(())
    }

    fn release(&mut self) -> Result<(), Error> {
        if let Some(body) = self.pushed.take() {
            self.runner.sim_mut().set_body_wrench(body, &Vector3::zeros(), &Vector3::zeros())?;
        }
        Ok(())
    }

    /// Makes one step.
    ///
    /// # Errors
    /// As [`Runner::step`]; a [`Reset`](Action::Reset) goes on from there.
    pub fn step(&mut self) -> Result<(), Error> {
        self.runner.step()?;
        self.steps += 1;
        self.digest.add(self.runner.sim().qpos());
        self.digest.add(self.runner.sim().qvel());
        Ok(())
    }

    /// Pushes at a body, or at none, from the next step on; nothing is noted if that changes nothing.
    ///
    /// # Errors
    /// As [`act`](Self::act).
    pub fn push(&mut self, push: Option<(BodyId, Vector6<f64>)>) -> Result<(), Error> {
        match push {
            Some((body, wrench)) => {
                if self.pushed == Some(body) && self.runner.sim().body_wrench(body)? == wrench {
                    return Ok(());
                }
                let [force, torque] = [0, 3].map(|k| [wrench[k], wrench[k + 1], wrench[k + 2]]);
                let body = self.runner.sim().model().body_column(body);
                self.act(Action::Push { body, force, torque })
            }
            None if self.pushed.is_some() => self.act(Action::Release),
            None => Ok(()),
        }
    }

    /// A simulation to [`show`](Self::show) this one in, of the model as it is loaded: a pinned target has the inertia of a wall
    /// in the session's own, and from MuJoCo 3 on a spring's stiffness follows from that.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn poses(&self) -> Result<Simulation, Error> {
        let mut poses = Simulation::new(&self.plan.model)?;
        self.show(&mut poses)?;
        Ok(poses)
    }

    /// Brings a simulation of the same model to the poses, velocities and pushes of this one, with everything that is
    /// needed to draw it and to pull at it: the simulation itself may have been stepped on frozen geometry.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn show(&self, shown: &mut Simulation) -> Result<(), Error> {
        let sim = self.runner.sim();
        shown.qpos_mut().copy_from_slice(sim.qpos());
        shown.qvel_mut().copy_from_slice(sim.qvel());
        shown.mocap_pos_mut().copy_from_slice(sim.mocap_pos());
        shown.mocap_quat_mut().copy_from_slice(sim.mocap_quat());
        shown.xfrc_applied_mut().copy_from_slice(sim.xfrc_applied());
        shown.kinematics()?;
        shown.inertia()?;
        Ok(shown.velocity()?)
    }

    /// The scenario.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// How contacts are simulated.
    pub fn mode(&self) -> Mode {
        self.runner.mode()
    }

    /// The simulation, as the last step has left it.
    pub fn sim(&self) -> &Simulation {
        self.runner.sim()
    }

    /// Its grasps, with the contacts and forces of the last step; in full mode they only watch.
    pub fn grasps(&self) -> &Grasps {
        self.runner.grasps()
    }

    /// Time of the next step, from the start of the scenario \[s\].
    pub fn time(&self) -> f64 {
        self.runner.time()
    }

    /// Steps since the beginning of the session, resets notwithstanding.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// What was done so far.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Of the positions and velocities after every step: the same for simulations that are the same bit for bit.
    pub fn digest(&self) -> Digest {
        self.digest
    }
}

/// The body of this [`body_column`](CompiledModel::body_column).
fn body_named(model: &CompiledModel, text: &str) -> Result<BodyId, crate::mujoco::Error> {
    model.body(text).or_else(|unknown| {
        let unnamed = |body: &BodyId| model.body_name(*body).is_none() && model.body_column(*body) == text;
        model.bodies().find(unnamed).ok_or(unknown)
    })
}
