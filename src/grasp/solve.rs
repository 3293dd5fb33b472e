//! The grasp solve: from contacts and the engine's state to the contact forces of this step.
//!
//! MuJoCo's own contact problem, reduced to the target's and the palm's few unknowns (design note "form 1"):
//!
//! 1. *Main*: the convex problem with MuJoCo's contact softness gives the normal forces.
//! 2. *Noslip*: with the normal forces fixed, friction is solved without softness, as MuJoCo's noslip pass does, but to
//!    convergence: a proximal step around last step's friction force. A still grasp does not creep.

use super::arrow::{Arrow, Status};
use super::cone::{Bound, Law, Zone, pyramid_pairs};
use super::contacts::GraspContact;
use super::rows::{Direction, Dynamics, RowBuilder, RowState, directions};
use super::softness::{SolverOptions, softness};
use super::topology::Topology;

/// Proximal resistance of friction, relative to what the contact's own inertia resists. The error that it leaves in
/// one step is this fraction of the *change* of the friction force, and it is gone in the next.
const RESISTANCE: f64 = 1e-3;

/// The solver and its memory from step to step (warm start).
#[derive(Clone, Debug, Default)]
pub struct GraspSolver {
    arrow: Arrow,
    builder: RowBuilder,
    /// Order in which contacts are added: by finger, since a finger's contacts are eliminated together.
    order: Vec<usize>,
    laws: Vec<SoftRow>,
    main: Vec<f64>,
    noslip: Vec<f64>,
    centre: Vec<f64>,
    start: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct SoftRow {
    resistance: f64,
}

/// Iterations of the two passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolveStatus {
    /// Pass with soft contacts.
    pub main: Status,
    /// Friction pass.
    pub noslip: Status,
}

impl GraspSolver {
    /// Forgets the warm start (after a latch, a reset or a restored state).
    pub fn reset(&mut self) {
        self.main.clear();
        self.noslip.clear();
    }

    /// Computes `contacts[..].force_rows` and from them each contact's force and torque. Contacts that had a force in the
    /// last step carry it in `contact.friction_memory`.
    pub fn solve(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &mut [GraspContact],
    ) -> SolveStatus {
        self.build(dynamics, topology, options, contacts);
        let size = self.arrow.size();
        if self.main.len() != size {
            self.main.clear();
            self.main.resize(size, 0.0);
        }
        let main = self.arrow.solve(None, &mut self.main);
        self.fix_normals(contacts);
        if self.noslip.len() != size {
            self.noslip.clear();
            self.noslip.extend_from_slice(&self.main);
        }
        let noslip = self.arrow.solve(Some(&self.centre), &mut self.noslip);
        for (block, &i) in self.order.iter().enumerate() {
            let contact = &mut contacts[i];
            let friction = self.arrow.response(block).force;
            for j in 1..contact.parameters.condim {
                contact.force_rows[j] = friction[j - 1];
            }
            contact.update_force();
        }
        SolveStatus { main, noslip }
    }

    fn build(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
    ) {
        self.arrow.begin(topology.root());
        self.order.clear();
        self.laws.clear();
        self.add_contacts(dynamics, topology, options, contacts, None);
        for (finger, &dim) in topology.fingers().iter().enumerate() {
            self.arrow.begin_branch(dim);
            self.add_contacts(dynamics, topology, options, contacts, Some(finger));
        }
    }

    fn add_contacts(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
        finger: Option<usize>,
    ) {
        for (i, contact) in contacts.iter().enumerate() {
            if contact.finger != finger {
                continue;
            }
            let soft = softness(&contact.parameters, options);
            let (directions, rows) = directions(&contact.axes, contact.parameters.condim);
            let directions: &[Direction] = &directions[..rows];
            let mut state = RowState::default();
            let mut block = self.arrow.add_block(rows, soft.law);
            for (body, sign) in [(contact.link, -1.0), (contact.target, 1.0)] {
                self.builder.add_side(
                    dynamics,
                    topology,
                    body,
                    sign,
                    &contact.position,
                    directions,
                    &mut block,
                    &mut state,
                );
            }
            for j in 0..rows {
                block.bias[j] = state.acceleration[j] + soft.damping * state.velocity[j];
            }
            block.bias[0] += soft.spring;
            let mobility = block.row_norm_squared(rows.min(2) - 1);
            self.laws.push(SoftRow {
                resistance: (RESISTANCE * mobility).max(f64::MIN_POSITIVE),
            });
            self.order.push(i);
        }
    }

    /// Keeps the normal forces of the main pass and turns each block's law into friction under them.
    fn fix_normals(&mut self, contacts: &mut [GraspContact]) {
        self.centre.clear();
        self.centre.resize(self.arrow.size(), 0.0);
        for (block, &i) in self.order.iter().enumerate() {
            let contact = &mut contacts[i];
            let response = *self.arrow.response(block);
            let normal = response.force[0];
            contact.force_rows = [0.0; 6];
            contact.force_rows[0] = normal;
            contact.sliding = response.zone == Zone::Slide;
            self.arrow.add_transposed(block, &[normal], &mut self.centre);

            let friction = contact.parameters.friction;
            let bound = match *self.arrow.law_mut(block) {
                Law::Pyramidal { stiffness, friction } => {
                    Bound::Box(pyramid_pairs(self.arrow.residual(block), stiffness, &friction))
                }
                _ => Bound::Ellipsoid(normal),
            };
            let mut centre = [0.0; 5];
            match contact.remembered_friction() {
                Some(friction) => centre = friction,
                None => centre.copy_from_slice(&response.force[1..]),
            }
            *self.arrow.law_mut(block) = Law::Slip {
                centre,
                resistance: self.laws[block].resistance,
                friction,
                bound,
            };
        }
    }
}
