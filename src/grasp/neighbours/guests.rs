//! The contacts of other latched grasps: two hands on one object, one hand on two, hands of one body.
//!
//! Grasps that move each other are one problem, however each of them has its own phase and quality. The first of them solves
//! it, with the contacts of the others as guests among its neighbours: with rows over all degrees of freedom, since another
//! grasp's fingers are not its own, but with their own softness and memory as in a grasp that is alone.

use super::{Neighbour, Neighbours, Owner};
use crate::grasp::cone::{MAX_ROWS, Zone};
use crate::grasp::contacts::GraspContact;
use crate::grasp::dense;
use crate::grasp::mobility::{Dynamics, Spatial};
use crate::grasp::softness::{SolverOptions, softness};
use crate::grasp::topology::Topology;

impl Neighbours {
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
            let soft = softness(&contact.parameters, options);
            for i in 0..rows {
                let velocity = self.add_row(dynamics, topology, contact, i);
                self.bias[first + i] += soft.damping * velocity;
            }
            self.bias[first] += soft.spring;
            let (main, zones) =
                contact.memory().map_or(([0.0; MAX_ROWS], [Zone::Stick; 2]), |memory| (memory.main, memory.zones));
            self.list.push(Neighbour {
                law: soft.law,
                rows,
                first,
                main,
                force: main,
                zones,
                pairs: [0.0; 5],
                gives: false,
                solved: false,
                row: 0,
                owner: Owner::Guest(self.guests.len()),
            });
            self.guests.push(contact.clone());
        }
    }

    /// The guests, in the order of their invitation; those that move with this grasp are solved after the solve.
    pub fn guests(&self) -> &[GraspContact] {
        &self.guests
    }

    /// Guest `number`, for the solver.
    pub fn guest_mut(&mut self, number: usize) -> &mut GraspContact {
        &mut self.guests[number]
    }

    /// Adds the generalised forces of the guests that were solved to `out`, one entry for each degree of freedom.
    pub fn add_guest_forces(&self, out: &mut [f64]) {
        for neighbour in &self.list {
            let Some(guest) = neighbour.guest().map(|number| &self.guests[number]).filter(|guest| guest.solved) else {
                continue;
            };
            for (k, force) in guest.force_rows[..neighbour.rows].iter().enumerate() {
                dense::axpy(*force, self.jacobian(neighbour.first + k, out.len()), out);
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
            let mut next = topology.leaf(body);
            while let Some(dof) = next {
                row[dof] += dynamics.axis(dof).dot(&wrench);
                next = dynamics.parent(dof);
            }
        }
        let smooth = dense::dot(row, dynamics.acceleration);
        self.bias.push(smooth);
        velocity
    }
}
