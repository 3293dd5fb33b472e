//! Saving and restoring the state of a simulation.

use super::arrays::{slice, slice_mut};
use super::compat;
use super::error::{Error, check_length};
use super::simulation::Simulation;

/// Everything that the next steps depend on, apart from parameters of the model: a replay from it is the same bit for
/// bit. Numbers are in the engine's order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct State {
    /// Simulation time, s.
    pub time: f64,
    /// Generalized positions.
    pub qpos: Vec<f64>,
    /// Generalized velocities.
    pub qvel: Vec<f64>,
    /// Actuator activations.
    pub act: Vec<f64>,
    /// Controls.
    pub ctrl: Vec<f64>,
    /// Applied generalized forces.
    pub qfrc_applied: Vec<f64>,
    /// Applied wrenches on bodies.
    pub xfrc_applied: Vec<f64>,
    /// Positions of mocap bodies.
    pub mocap_pos: Vec<f64>,
    /// Orientations of mocap bodies.
    pub mocap_quat: Vec<f64>,
    /// The solver's start.
    pub qacc_warmstart: Vec<f64>,
    /// Switches of the equality constraints.
    pub eq_active: Vec<u8>,
    /// Data of the equality constraints.
    pub eq_data: Vec<f64>,
}

impl Simulation {
    /// The current state.
    pub fn save(&self) -> State {
        let mut state = State::default();
        self.save_into(&mut state);
        state
    }

    /// Writes the current state over `state`, reusing its memory.
    pub fn save_into(&self, state: &mut State) {
        fn copy<T: Copy>(to: &mut Vec<T>, from: &[T]) {
            to.clear();
            to.extend_from_slice(from);
        }
        state.time = self.time();
        copy(&mut state.qpos, self.qpos());
        copy(&mut state.qvel, self.qvel());
        copy(&mut state.act, self.act());
        copy(&mut state.ctrl, self.ctrl());
        copy(&mut state.qfrc_applied, self.qfrc_applied());
        copy(&mut state.xfrc_applied, self.xfrc_applied());
        copy(&mut state.mocap_pos, self.mocap_pos());
        copy(&mut state.mocap_quat, self.mocap_quat());
        copy(&mut state.qacc_warmstart, self.qacc_warmstart());
        copy(&mut state.eq_active, self.eq_active());
        copy(&mut state.eq_data, self.model().eq_data());
    }

    /// Goes back to a saved state, also after a fault or a divergence. Positions of bodies, contacts and so on are
    /// those of before until the next [`forward`](Self::forward) or [`step`](Self::step).
    ///
    /// Fails, changing nothing, if the state is of a model with other sizes.
    pub fn restore(&mut self, state: &State) -> Result<(), Error> {
        check_length("qpos of the state", self.qpos().len(), state.qpos.len())?;
        check_length("qvel of the state", self.qvel().len(), state.qvel.len())?;
        check_length("act of the state", self.act().len(), state.act.len())?;
        check_length("ctrl of the state", self.ctrl().len(), state.ctrl.len())?;
        check_length("qfrc_applied of the state", self.qfrc_applied().len(), state.qfrc_applied.len())?;
        check_length("xfrc_applied of the state", self.xfrc_applied().len(), state.xfrc_applied.len())?;
        check_length("mocap_pos of the state", self.mocap_pos().len(), state.mocap_pos.len())?;
        check_length("mocap_quat of the state", self.mocap_quat().len(), state.mocap_quat.len())?;
        check_length("qacc_warmstart of the state", self.qacc_warmstart().len(), state.qacc_warmstart.len())?;
        check_length("eq_active of the state", self.eq_active().len(), state.eq_active.len())?;
        check_length("eq_data of the state", self.model().eq_data().len(), state.eq_data.len())?;
        if self.is_interrupted() {
            self.reset()?;
        }
        self.data_mut().time = state.time;
        self.qpos_mut().copy_from_slice(&state.qpos);
        self.qvel_mut().copy_from_slice(&state.qvel);
        self.act_mut().copy_from_slice(&state.act);
        self.ctrl_mut().copy_from_slice(&state.ctrl);
        self.qfrc_applied_mut().copy_from_slice(&state.qfrc_applied);
        self.xfrc_applied_mut().copy_from_slice(&state.xfrc_applied);
        self.mocap_pos_mut().copy_from_slice(&state.mocap_pos);
        self.mocap_quat_mut().copy_from_slice(&state.mocap_quat);
        self.qacc_warmstart_mut().copy_from_slice(&state.qacc_warmstart);
        self.eq_active_mut().copy_from_slice(&state.eq_active);
        self.eq_data_mut().copy_from_slice(&state.eq_data);
        Ok(())
    }

    fn eq_active(&self) -> &[u8] {
        let (model, data) = self.pointers();
        // SAFETY: `neq` switches that live as long as `self`.
        unsafe { slice(compat::eq_active(model, data), self.model().neq()) }
    }

    fn eq_active_mut(&mut self) -> &mut [u8] {
        let (model, data) = self.pointers();
        // SAFETY: as above, and `&mut self` makes the access exclusive.
        unsafe { slice_mut(compat::eq_active(model, data), self.model().neq()) }
    }
}
