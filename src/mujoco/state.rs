//! Saving and restoring the state of a simulation.

use super::arrays::{slice, slice_mut};
use super::compat;
use super::error::{Error, check_length, check_value};
use super::simulation::Simulation;

/// Everything that the next steps depend on, apart from parameters of the model: a replay from it is the same bit for
/// bit. Numbers are in the engine's order. What sleeps (MuJoCo 3, where the model lets it) is not part of it, so that a
/// replay may then wake or put to sleep something at another step.
///
/// It can be written with any serde format that keeps all bits of an `f64` (for JSON, with serde_json's feature
/// `float_roundtrip`). Grasps have a state of their own: see [`Snapshot`](crate::grasp::Snapshot).
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
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
    #[must_use]
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
    /// Fails, changing nothing, if the state is of a model with other sizes, or if a number in it is not finite.
    pub fn restore(&mut self, state: &State) -> Result<(), Error> {
        self.check_state(state)?;
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
        for (switch, saved) in self.eq_active_mut().iter_mut().zip(&state.eq_active) {
            *switch = u8::from(*saved != 0);
        }
        self.eq_data_mut().copy_from_slice(&state.eq_data);
        Ok(())
    }

    /// Sizes as the model's, and numbers that are numbers.
    fn check_state(&self, state: &State) -> Result<(), Error> {
        let check = |what: &'static str, here: &[f64], saved: &[f64]| {
            check_length(what, here.len(), saved.len())?;
            let bad = saved.iter().copied().find(|x| !x.is_finite());
            bad.map_or(Ok(()), |value| check_value(what, value, "finite", |_| true))
        };
        check_value("the time of the state", state.time, "finite", |_| true)?;
        check("qpos of the state", self.qpos(), &state.qpos)?;
        check("qvel of the state", self.qvel(), &state.qvel)?;
        check("act of the state", self.act(), &state.act)?;
        check("ctrl of the state", self.ctrl(), &state.ctrl)?;
        check("qfrc_applied of the state", self.qfrc_applied(), &state.qfrc_applied)?;
        check("xfrc_applied of the state", self.xfrc_applied(), &state.xfrc_applied)?;
        check("mocap_pos of the state", self.mocap_pos(), &state.mocap_pos)?;
        check("mocap_quat of the state", self.mocap_quat(), &state.mocap_quat)?;
        check("qacc_warmstart of the state", self.qacc_warmstart(), &state.qacc_warmstart)?;
        check_length("eq_active of the state", self.eq_active().len(), state.eq_active.len())?;
        check("eq_data of the state", self.model().eq_data(), &state.eq_data)
    }

    fn eq_active(&self) -> &[u8] {
        let (model, data) = self.pointers();
        // SAFETY: `neq` switches that live as long as `self`.
        unsafe { slice(compat::eq_active(model, data), self.model().neq()) }
    }

    fn eq_active_mut(&mut self) -> &mut [u8] {
        self.note_change();
        let (model, data) = self.pointers();
        // SAFETY: as above, and `&mut self` makes the access exclusive.
        unsafe { slice_mut(compat::eq_active(model, data), self.model().neq()) }
    }
}
