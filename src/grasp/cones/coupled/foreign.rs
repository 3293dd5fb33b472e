//! The contacts of other latched grasps: two hands on one object, one hand on two, hands of one body.
//!
//! Grasps that move each other are one problem, however each of them has its own phase and quality. The first of them solves
//! it, with the contacts of the others as foreign among its coupled: with rows over all degrees of freedom, since another
//! grasp's fingers are not its own, but with their own softness and memory as in a grasp that is alone.

use super::{CoupledConstraint, CoupledConstraints, Jacobian, Owner};
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::cost::{ActiveSet, MAX_ROWS};
use crate::grasp::contact::softness::{SolverOptions, softness};
use crate::grasp::hand::topology::Topology;
use crate::grasp::linalg;
use crate::grasp::linalg::Spatial;

impl CoupledConstraints {
    /// Adds the contacts of another grasp, whose hand and target are in `topology`. After [`read`](Self::read).
    pub fn invite(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
    ) {
        for contact in contacts {
            let rows = contact.parameters.condim;
            let first = self.bias.len();
            let jacobian = Jacobian::Dense(self.jacobian.len() / dynamics.acceleration.len().max(1));
            let soft = softness(&contact.parameters, options);
            for i in 0..rows {
                let velocity = self.add_row(dynamics, topology, contact, i);
                self.bias[first + i] += soft.damping * velocity;
            }
            self.bias[first] += soft.spring;
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
            let Jacobian::Dense(row) = constraint.jacobian else { continue };
            for (k, force) in foreign.force_rows[..constraint.rows].iter().enumerate() {
                linalg::axpy(*force, self.jacobian(row + k, out.len()), out);
            }
        }
    }

    /// Row `i` of a contact's Jacobian, target minus link, with its smooth acceleration as bias; returns its velocity.
    fn add_row(&mut self, dynamics: &Dynamics<'_>, topology: &Topology, contact: &GraspContact, i: usize) -> f64 {
        let nv = dynamics.acceleration.len();
        let at = self.jacobian.len();
        self.jacobian.resize(at + nv, 0.0);
        let row = &mut self.jacobian[at..];
        let mut velocity = 0.0;
        for (body, sign) in [(contact.target, 1.0), (contact.link, -1.0)] {
            let wrench: Spatial = sign * contact.unit_wrench(i, &dynamics.reference_point(body));
            velocity += wrench.dot(&dynamics.velocity(body));
            dynamics.add_wrench(topology.leaf(body), &wrench, row);
        }
        let smooth = linalg::dot(row, dynamics.acceleration);
        self.bias.push(smooth);
        velocity
    }
}

impl GraspContact {
    /// One step on frozen geometry later: `bias` of each of the contact's rows.
    pub(super) fn resume_rows<'a>(
        &mut self,
        dynamics: &Dynamics<'_>,
        options: &SolverOptions,
        rows: impl Iterator<Item = &'a [f64]>,
        bias: &mut [f64],
    ) {
        self.resume(dynamics, options.timestep);
        let soft = softness(&self.parameters, options);
        let velocities = self.velocity(dynamics);
        for (i, (bias, row)) in bias.iter_mut().zip(rows).enumerate() {
            let velocity = self.axes[i % 3].dot(&velocities[usize::from(i < 3)]);
            *bias = linalg::dot(row, dynamics.acceleration) + soft.damping * velocity;
        }
        bias[0] += soft.spring;
    }
}
