//! The generalised force of all latched grasps, in and out of the engine's own sums.

use super::error::Error;
use super::linalg;
use crate::mujoco::Simulation;

/// The force of the grasps, and what it replaces in the engine for the time of its solve.
#[derive(Clone, Debug, Default)]
pub(super) struct GraspForce {
    /// One entry for each degree of freedom \[N, N m\].
    pub generalised: Vec<f64>,
    acceleration: Vec<f64>,
    /// The engine's own, while the grasps' forces are among them.
    smooth_force: Vec<f64>,
    smooth_acceleration: Vec<f64>,
}

impl GraspForce {
    /// Zero, of `nv` entries; the memory is kept.
    pub fn clear(&mut self, nv: usize) {
        self.generalised.clear();
        self.generalised.resize(nv, 0.0);
        self.smooth_force.clear();
    }

    /// Adds all that is known so far to the engine's smooth forces, in the place of what was there of it before.
    pub fn apply(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        if self.smooth_force.is_empty() {
            self.smooth_force.extend_from_slice(sim.qfrc_smooth());
            self.smooth_acceleration.clear();
            self.smooth_acceleration.extend_from_slice(sim.qacc_smooth());
        } else {
            self.restore(sim);
        }
        self.acceleration.clone_from(&self.generalised);
        sim.solve_mass(&mut self.acceleration)?;
        linalg::axpy(1.0, &self.generalised, sim.qfrc_smooth_mut());
        linalg::axpy(1.0, &self.acceleration, sim.qacc_smooth_mut());
        Ok(())
    }

    /// After the engine's solve: the grasps' forces count as constraint forces, as the contacts' would.
    pub fn count_as_constraint(&self, sim: &mut Simulation) {
        self.restore(sim);
        linalg::axpy(1.0, &self.generalised, sim.qfrc_constraint_mut());
    }

    fn restore(&self, sim: &mut Simulation) {
        sim.qfrc_smooth_mut().copy_from_slice(&self.smooth_force);
        sim.qacc_smooth_mut().copy_from_slice(&self.smooth_acceleration);
    }
}
