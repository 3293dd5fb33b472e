//! Saving a grasp and going back to it.

use super::Grasp;
use crate::grasp::error::Error;
use crate::grasp::merged_solve::MergedState;
use crate::grasp::phase::{Phase, PhaseMachine};
use crate::grasp::quality::Gram;
use crate::grasp::solve::SolveStatus;
use crate::grasp::spec::Limits;
use crate::grasp::state::GraspState;
use nalgebra::Vector3;

impl Grasp {
    /// What the next step depends on, to be taken between two steps. A replay also needs the simulation's own
    /// [`save`](crate::mujoco::Simulation::save): [`Snapshot`](crate::grasp::Snapshot) has both.
    #[must_use]
    pub fn save(&self) -> GraspState {
        let mut state = GraspState::empty(self.identity.clone());
        self.save_into(&mut state);
        state
    }

    /// Writes the current state over `state`, reusing its memory.
    pub fn save_into(&self, state: &mut GraspState) {
        let latched = self.machine.phase() == Phase::Grasped;
        state.grasp.clone_from(&self.identity);
        state.phase = self.machine.phase();
        state.good_for = self.machine.good_for();
        state.may_latch = self.machine.is_allowed();
        state.settings = self.settings;
        state.warm_start = self.solver.warm_start();
        if latched && self.limits == Limits::Cones {
            self.set.save_into(&mut state.contacts);
            self.neighbours.save_into(&mut state.neighbours);
        } else {
            state.contacts.clear();
            state.neighbours.clear();
        }
        match &self.merged {
            Some((_, merged)) if latched => merged.save_into(state.merged.get_or_insert_with(MergedState::default)),
            _ => state.merged = None,
        }
    }

    /// Goes back to a saved state, of this grasp or of one that was made with the same spec in another simulation of the
    /// same model, be it in another process. [`contacts`](Self::contacts) are empty and [`quality`](Self::quality) is 0
    /// until the next step.
    ///
    /// Solver settings of the simulation that a merged grasp has changed stay as they are until that step, which sees to
    /// them.
    ///
    /// # Errors
    /// A state of another model or another spec, or one with numbers that no grasp can have; nothing is changed then.
    pub fn restore(&mut self, state: &GraspState) -> Result<(), Error> {
        self.check_state(state)?;
        let latch_time = self.machine.latch_time();
        self.machine = PhaseMachine::resumed(latch_time, state.phase, state.good_for, state.may_latch);
        // if this simulation's settings are changed now, what they were is known here
        self.settings = self.settings.or(state.settings);
        self.set.restore(&state.contacts);
        self.neighbours.restore(&state.neighbours);
        self.solver.set_warm_start(state.warm_start);
        if let (Some((_, merged)), Some(saved)) = (&mut self.merged, &state.merged) {
            merged.restore(saved);
        }
        self.status = SolveStatus::default();
        self.live.clear();
        self.gram = Gram::new(Vector3::zeros(), 0.0);
        Ok(())
    }

    /// That [`restore`](Self::restore) accepts `state`.
    pub(in crate::grasp) fn check_state(&self, state: &GraspState) -> Result<(), Error> {
        state.check(&self.identity)
    }
}
