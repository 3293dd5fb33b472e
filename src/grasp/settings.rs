//! The user's solver settings, while a merged grasp needs others.

use super::error::Error;
use super::spec::Limits;
use super::{Grasp, Grasps};
use crate::mujoco::{JacobianStorage, Simulation};
use serde::{Deserialize, Serialize};

/// What the user has set.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Settings {
    noslip_iterations: usize,
    jacobian: JacobianStorage,
}

impl Settings {
    /// Whether the engine knows such settings.
    pub fn are_known(&self) -> bool {
        !matches!(self.jacobian, JacobianStorage::Other(_)) && i32::try_from(self.noslip_iterations).is_ok()
    }

    fn of(sim: &Simulation) -> Settings {
        let model = sim.model();
        Settings { noslip_iterations: model.noslip_iterations(), jacobian: model.jacobian_storage() }
    }

    fn put(self, sim: &mut Simulation) -> Result<(), Error> {
        if sim.model().noslip_iterations() != self.noslip_iterations {
            sim.set_noslip_iterations(self.noslip_iterations)?;
        }
        if sim.model().jacobian_storage() != self.jacobian {
            sim.set_jacobian_storage(self.jacobian)?;
        }
        Ok(())
    }
}

impl Grasps {
    /// Before a step: while a merged grasp is latched the Jacobian is dense (a sparse weld row has no finger columns), and
    /// with bounded rows there is no noslip pass (it would solve them without their regularisation, which is part of their
    /// reference). The user's settings come back in the first step without such a grasp.
    pub(super) fn adapt_settings(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        if !self.iter().any(Grasp::is_merged) {
            return self.restore_settings(sim);
        }
        let bounded = self.iter().any(|g| g.is_merged() && g.limits() == Limits::Box);
        let user = *self.settings.get_or_insert_with(|| Settings::of(sim));
        let noslip_iterations = if bounded { 0 } else { user.noslip_iterations };
        let jacobian = if sim.model().is_sparse() { JacobianStorage::Dense } else { sim.model().jacobian_storage() };
        Settings { noslip_iterations, jacobian }.put(sim)
    }

    /// Gives the solver settings back that a latched grasp with [`Limits::Box`] or [`Limits::Rigid`] has changed (noslip
    /// iterations, storage of the Jacobian). A step after the release does it by itself; this is for a simulation that
    /// goes on without its grasps. The current contacts and constraint rows are dropped if there is something to restore.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn restore_settings(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        match self.settings.take() {
            Some(settings) => settings.put(sim),
            None => Ok(()),
        }
    }
}
