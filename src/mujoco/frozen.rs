//! A step on frozen geometry: all that follows from positions stays what it was in an earlier step.
//!
//! Poses, inertia, actuator moments, contacts and constraint Jacobians are those of that step. What is left is linear in
//! what has moved since: lengths of tendons and actuators and the position errors of constraint rows move with their
//! velocities. Joint springs, velocities, forces and the state are the engine's own and as exact as ever.

use super::error::Error;
use super::ffi;
use super::kinds::{Cone, Integrator, RowKind};
use super::simulation::Simulation;
use super::stages::Hooks;
use std::ffi::c_int;

unsafe extern "C-unwind" {
    // Exported by every version of the library, and declared in none of its headers: the integrators, with the factor of
    // `M + h D` (`qH`, `qLU`) that the last step has left, if `skipfactor` is not 0.
    fn mj_EulerSkip(m: *const ffi::mjModel, d: *mut ffi::mjData, skipfactor: c_int);
    fn mj_implicitSkip(m: *const ffi::mjModel, d: *mut ffi::mjData, skipfactor: c_int);
}

impl Simulation {
    /// One step on the geometry of the last one that was not so, with `hooks` in the place of the engine's solver. Sensors,
    /// energy and poses stay what they are. Errors and what they leave behind are those of
    /// [`step_with`](Self::step_with).
    pub(crate) fn step_frozen<H: Hooks>(&mut self, hooks: &mut H) -> Result<(), H::Error> {
        self.deferring(|sim| sim.without_islands(|sim| sim.frozen_stages(hooks)))
    }

    fn frozen_stages<H: Hooks>(&mut self, hooks: &mut H) -> Result<(), H::Error> {
        self.checked(hooks, Self::check_pos)?;
        self.checked(hooks, Self::check_vel)?;
        if self.has_diverged() {
            return self.all_stages(hooks);
        }
        self.velocity()?;
        self.advance_lengths()?;
        self.advance_rows()?;
        hooks.velocity(self);
        self.actuation()?;
        self.acceleration()?;
        hooks.constraint(self)?;
        self.checked(hooks, Self::check_acc)?;
        hooks.observe(self)?;
        Ok(self.integrate_again()?)
    }

    /// The model's integrator, with the factors that the last whole step has left.
    pub(super) fn integrate_again(&mut self) -> Result<(), Error> {
        let euler = !matches!(self.model().integrator(), Integrator::Implicit | Integrator::ImplicitFast);
        // SAFETY: model and data belong together, and the last whole step has left the factor.
        self.run("mj_EulerSkip, mj_implicitSkip", |m, d| unsafe {
            if euler { mj_EulerSkip(m, d, 1) } else { mj_implicitSkip(m, d, 1) }
        })
    }

    /// Lengths of tendons and actuators one step on, once their velocities are known; and the tendons' springs with them.
    fn advance_lengths(&mut self) -> Result<(), Error> {
        let step = self.model().timestep();
        let (nu, ntendon) = (self.model().nu(), self.model().ntendon());
        let (m, d) = (self.model_fields(), self.data());
        // SAFETY: arrays of these lengths, of which nothing is borrowed: `self` is exclusive.
        let springs = unsafe {
            for i in 0..nu {
                *d.actuator_length.add(i) += step * *d.actuator_velocity.add(i);
            }
            for i in 0..ntendon {
                *d.ten_length.add(i) += step * *d.ten_velocity.add(i);
            }
            (0..ntendon).any(|i| *m.tendon_stiffness.add(i) != 0.0)
        };
        if springs {
            // SAFETY: model and data belong together.
            self.run("mj_passive", |m, d| unsafe { ffi::mj_passive(m, d) })?;
        }
        Ok(())
    }

    /// Position errors of the constraint rows one step on, once their velocities are known, and the reference accelerations
    /// that follow: `aref = -B J qvel - K I (pos - margin)`.
    fn advance_rows(&mut self) -> Result<(), Error> {
        let step = self.model().timestep();
        let pyramidal = self.model().cone() == Cone::Pyramidal;
        let mut row = 0;
        while row < self.nefc() {
            let identity = self.constraint_row(row)?;
            // rows that share the position error, and those that have one
            let (rows, moved) = match identity.kind {
                RowKind::ContactElliptic => (self.contact(identity.id)?.condim, 1),
                RowKind::ContactPyramidal if pyramidal => {
                    let edges = 2 * (self.contact(identity.id)?.condim - 1);
                    (edges, edges)
                }
                _ => (1, 1),
            };
            // opposite edges of a pyramid move apart by as much as the surfaces do
            let pair = moved.min(2);
            let velocity = self.efc_vel()[row..row + pair].iter().sum::<f64>() / pair as f64;
            for row in row..row + moved {
                let [stiffness, _, impedance, _] = self.efc_KBIP()[4 * row..4 * row + 4] else { break };
                let d = self.data();
                // SAFETY: `row < nefc`, and nothing is borrowed.
                unsafe {
                    *d.efc_pos.add(row) += step * velocity;
                    *d.efc_aref.add(row) -= stiffness * impedance * step * velocity;
                }
            }
            row += rows;
        }
        Ok(())
    }
}
