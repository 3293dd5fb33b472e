//! The contacts of other latched grasps: two hands on one object, one hand on two, hands of one body.
//!
//! Grasps that move each other are one problem, however each of them has its own phase and quality. The first of them solves
//! it, with the contacts of the others as foreign among its coupled: with rows over all degrees of freedom, since another
//! grasp's fingers are not its own, but with their own softness and memory as in a grasp that is alone.

use super::{CoupledConstraint, CoupledConstraints, Jacobian, Owner};
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::contact::contacts::{GraspContact, Turning};
use crate::grasp::contact::cost::{ActiveSet, MAX_ROWS};
use crate::grasp::contact::softness::{Softness, SolverOptions, softness};
use nalgebra::Vector3;

impl CoupledConstraints {
    /// Adds the contacts of another grasp. After [`read`](Self::read).
    pub fn invite(&mut self, dynamics: &Dynamics<'_>, options: &SolverOptions, contacts: &[GraspContact]) {
        for contact in contacts {
            let rows = contact.parameters.condim;
            let (first, start, entries) = (self.bias.len(), self.support.len(), self.entries.len());
            self.support.extend(dynamics.chains(contact.leaves));
            let jacobian = Jacobian::Rows { support: (start, self.support.len()), entries };
            let soft = softness(&contact.parameters, options);
            self.add_rows(dynamics, contact, start);
            contact.subtract_reference(&soft, &contact.velocity(dynamics), &mut self.bias[first..]);
            let (main, active_sets) = contact
                .warm_start()
                .map_or(([0.0; MAX_ROWS], [ActiveSet::Stick; 2]), |memory| (memory.main, memory.active_sets));
            let owner = Owner::Foreign(self.foreign.len());
            self.list.push(CoupledConstraint {
                cost: soft.cost,
                first,
                jacobian,
                main,
                force: main,
                active_sets,
                ..CoupledConstraint::new(owner, rows)
            });
            self.foreign.push(contact.clone());
        }
    }

    /// The foreign, in the order of their invitation; those that move with this grasp are solved after the solve.
    pub fn foreign(&self) -> &[GraspContact] {
        &self.foreign
    }

    /// Foreign contact `number`, for the solver.
    pub fn foreign_mut(&mut self, number: usize) -> &mut GraspContact {
        &mut self.foreign[number]
    }

    /// Adds the generalised forces of the foreign that were solved to `out`, one entry for each degree of freedom.
    pub fn add_foreign_forces(&self, out: &mut [f64]) {
        for constraint in &self.list {
            let Some(foreign) =
                constraint.foreign().map(|number| &self.foreign[number]).filter(|foreign| foreign.solved)
            else {
                continue;
            };
            for (k, force) in foreign.force_rows[..constraint.rows].iter().enumerate() {
                let entries = self.support(constraint).iter().zip(self.row(constraint, k));
                entries.for_each(|(&dof, entry)| out[dof] += force * entry);
            }
        }
    }

    /// Rows of a contact's Jacobian, target minus link, over the support that begins at `support`; with its smooth acceleration
    /// as bias.
    fn add_rows(&mut self, dynamics: &Dynamics<'_>, contact: &GraspContact, support: usize) {
        let CoupledConstraints { support: all, entries, bias, .. } = self;
        let support = &all[support..];
        let (rows, n, at) = (contact.parameters.condim, support.len(), entries.len());
        let wrenches = contact.unit_wrenches(dynamics);
        let mut smooth = [0.0; MAX_ROWS];
        entries.resize(at + rows * n, 0.0);
        let mut before = contact.leaves;
        for (s, &dof) in support.iter().enumerate() {
            let axis = dynamics.axis(dof);
            for (body, before) in before.iter_mut().enumerate().filter(|(_, before)| **before == Some(dof)) {
                for (row, on_bodies) in wrenches[..rows].iter().enumerate() {
                    let entry = axis.dot(&on_bodies[body]);
                    entries[at + row * n + s] += entry;
                    smooth[row] += entry * dynamics.acceleration[dof];
                }
                *before = dynamics.parent(dof);
            }
        }
        bias.extend_from_slice(&smooth[..rows]);
    }
}

impl GraspContact {
    /// One step on frozen geometry later: the `bias` of each of the contact's rows, in which their smooth acceleration is.
    pub(super) fn resume_rows(
        &mut self,
        dynamics: &Dynamics<'_>,
        turning: &mut Turning,
        options: &SolverOptions,
        bias: &mut [f64],
    ) {
        let velocity = self.resume(dynamics, turning, options.timestep);
        self.subtract_reference(&softness(&self.parameters, options), &velocity, bias);
    }

    /// From the smooth acceleration of each of the contact's rows to its bias, `- aref`.
    fn subtract_reference(&self, soft: &Softness, velocity: &[Vector3<f64>; 2], bias: &mut [f64]) {
        for (i, bias) in bias.iter_mut().enumerate() {
            *bias += soft.damping * self.along_row(i, velocity);
        }
        bias[0] += soft.spring;
    }
}
