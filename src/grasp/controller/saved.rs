//! Saving a grasp and going back to it.

use super::Grasp;
use crate::grasp::error::Error;
use crate::grasp::monitor::phase::Phase;
use crate::grasp::spec::Limits;
use crate::grasp::state::GraspState;
use crate::grasp::weld::solve::MergedState;

impl Grasp {
    /// What the next step depends on; see [`Grasps::save`](crate::grasp::Grasps::save).
    pub(in crate::grasp) fn save(&self) -> GraspState {
        let mut state = GraspState::empty(self.identity.clone());
        self.save_into(&mut state);
        state
    }

    /// Writes the current state over `state`, reusing its memory.
    pub(in crate::grasp) fn save_into(&self, state: &mut GraspState) {
        let latched = self.machine.phase() == Phase::Grasped;
        state.grasp.clone_from(&self.identity);
        state.phase = self.machine.phase();
        state.counted = self.machine.counted();
        state.may_latch = self.machine.is_allowed();
        state.warm_start = self.solver.warm_start();
        if latched && self.limits == Limits::Cones {
            self.set.save_into(&mut state.contacts);
            self.coupled.save_into(&mut state.coupled);
        } else {
            state.contacts.clear();
            state.coupled.clear();
        }
        match &self.merged {
            Some((_, merged)) if latched => merged.save_into(state.merged.get_or_insert_with(MergedState::default)),
            _ => state.merged = None,
        }
    }

    /// Goes back to a state that [`check_state`](Self::check_state) accepts.
    pub(in crate::grasp) fn restore(&mut self, state: &GraspState) {
        self.machine = self.machine.resumed(state.phase, state.counted, state.may_latch);
        self.set.restore(&state.contacts);
        self.coupled.restore(&state.coupled);
        self.solver.set_warm_start(state.warm_start);
        if let (Some((_, merged)), Some(saved)) = (&mut self.merged, &state.merged) {
            merged.restore(saved);
        }
        self.forget_results();
    }

    /// That `state` is a sound one of this grasp.
    pub(in crate::grasp) fn check_state(&self, state: &GraspState) -> Result<(), Error> {
        state.check(&self.identity)
    }
}
