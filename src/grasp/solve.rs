//! The grasp solve: from contacts and the engine's state to the contact forces of this step.
//!
//! MuJoCo's own contact problem, reduced to the target's and the palm's few unknowns (design note "form 1"):
//!
//! 1. *Main*: the convex problem with MuJoCo's contact softness gives the normal forces.
//! 2. *Noslip*: with the normal forces fixed, friction is solved without softness, as MuJoCo's noslip pass does, but to
//!    convergence: a proximal step around last step's friction force. A still grasp does not creep.

use super::arrow::{Arrow, ROOT, RootVector, Status};
use super::cone::{Bound, Law, MAX_ROWS, Zone, pyramid_pairs};
use super::contacts::{GraspContact, Memory};
use super::mobility::{Dynamics, FingerRow, Mobility, Spatial};
use super::softness::{Softness, SolverOptions, softness};
use super::topology::Topology;

/// Proximal resistance of friction, relative to what the contact's own inertia resists. The error that it leaves in
/// one step is this fraction of the *change* of the friction force, and it is gone in the next.
const RESISTANCE: f64 = 1e-3;

/// The solver and its memory from step to step (warm start).
#[derive(Clone, Debug)]
pub struct GraspSolver {
    mobility: Mobility,
    arrow: Arrow,
    /// Contacts in the order of the arrow's blocks: by finger, since a finger's contacts are eliminated together.
    order: Vec<usize>,
    finger_rows: Vec<FingerRow>,
    main: RootVector,
    noslip: RootVector,
    kept: Vec<f64>,
    start: Vec<f64>,
    laws: Vec<(Law, Zone)>,
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
    /// For the hand and target of `topology`.
    pub fn new(topology: &Topology, dof_parent: &[i32]) -> Self {
        GraspSolver {
            mobility: Mobility::new(topology, dof_parent),
            arrow: Arrow::default(),
            order: Vec::new(),
            finger_rows: Vec::new(),
            main: [0.0; ROOT],
            noslip: [0.0; ROOT],
            kept: Vec::new(),
            start: Vec::new(),
            laws: Vec::new(),
        }
    }

    /// Forgets the warm start (after a latch, a reset or a restored state).
    pub fn reset(&mut self) {
        self.main = [0.0; ROOT];
        self.noslip = [0.0; ROOT];
    }

    /// Computes the force of each contact. What it was in the last step, its memory, is where the solve starts.
    pub fn solve(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &mut [GraspContact],
    ) -> SolveStatus {
        self.build(dynamics, topology, options, contacts);
        let main = self.arrow.solve(&mut self.main);
        self.fix_normals(contacts);
        let noslip = self.arrow.solve(&mut self.noslip);
        for (block, &i) in self.order.iter().enumerate() {
            let contact = &mut contacts[i];
            let response = self.arrow.response(block);
            for j in 1..contact.parameters.condim {
                contact.force_rows[j] = response.force[j - 1];
            }
            contact.zones[1] = response.zone;
            contact.update_force();
        }
        SolveStatus { main, noslip }
    }

    /// Adds the generalised forces of all contacts to `out`: on the target, and against it on the links.
    pub fn add_forces(&self, dynamics: &Dynamics<'_>, topology: &Topology, contacts: &[GraspContact], out: &mut [f64]) {
        let (mut on_palm, mut on_target) = (Spatial::zeros(), Spatial::zeros());
        let target = dynamics.reference_point(topology.target());
        for c in contacts {
            on_target += c.wrench_about(&target);
            let on_link = -c.wrench_about(&dynamics.reference_point(c.link));
            on_palm += on_link;
            if let (Some(finger), Some(leaf)) = (c.finger, topology.leaf(c.link)) {
                self.mobility.fingers[finger].add_force(leaf, &on_link, out);
            }
        }
        for (body, wrench) in [(&self.mobility.palm, on_palm), (&self.mobility.target, on_target)] {
            for &dof in body.chain() {
                out[dof] += dynamics.axis(dof).dot(&wrench);
            }
        }
    }

    fn build(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
    ) {
        let palm = if topology.palm() == 0 { None } else { topology.leaf(topology.palm()) };
        self.mobility.palm.update(dynamics, palm);
        self.mobility.target.update(dynamics, topology.leaf(topology.target()));
        self.arrow.begin();
        self.order.clear();
        self.add_branch(dynamics, topology, options, contacts, None);
        for finger in 0..self.mobility.fingers.len() {
            if contacts.iter().any(|c| c.finger == Some(finger)) {
                self.mobility.fingers[finger].update(dynamics);
                self.add_branch(dynamics, topology, options, contacts, Some(finger));
            }
        }
    }

    /// All contacts of one finger, or of the palm.
    fn add_branch(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
        finger: Option<usize>,
    ) {
        self.arrow.begin_branch();
        let mut rows = 0;
        for (i, contact) in contacts.iter().enumerate().filter(|(_, c)| c.finger == finger) {
            self.add_contact(dynamics, topology, contact, &softness(&contact.parameters, options), rows);
            rows += contact.parameters.condim;
            self.order.push(i);
        }
        let finger_rows = &self.finger_rows;
        self.arrow.end_branch(
            finger.map(|_| |i: usize, j: usize| super::dense::dot(&finger_rows[i].whitened, &finger_rows[j].whitened)),
        );
    }

    /// `row0`: rows of this finger before this contact's.
    fn add_contact(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        contact: &GraspContact,
        soft: &Softness,
        row0: usize,
    ) {
        let Mobility { palm, target, fingers } = &self.mobility;
        let rows = contact.parameters.condim;
        if self.finger_rows.len() < row0 + rows {
            self.finger_rows.resize(row0 + rows, FingerRow::default());
        }
        let hand_point = dynamics.reference_point(contact.link);
        let target_point = dynamics.reference_point(topology.target());
        let hand_velocity = dynamics.velocity(contact.link);
        let target_velocity = dynamics.velocity(topology.target());
        let finger = contact.finger.zip(topology.leaf(contact.link)).map(|(f, leaf)| (&fingers[f], leaf));
        let hand_acceleration =
            palm.smooth + finger.map_or_else(Spatial::zeros, |(f, leaf)| f.smooth_acceleration(dynamics, leaf));

        let mut root_rows = [[0.0; ROOT]; MAX_ROWS];
        let mut bias = [0.0; MAX_ROWS];
        for i in 0..rows {
            let on_hand = contact.unit_wrench(i, &hand_point);
            let on_target = contact.unit_wrench(i, &target_point);
            let velocity = on_target.dot(&target_velocity) - on_hand.dot(&hand_velocity);
            let acceleration = on_target.dot(&target.smooth) - on_hand.dot(&hand_acceleration);
            bias[i] = acceleration + soft.damping * velocity;
            let row = &mut self.finger_rows[row0 + i];
            let on_palm = match finger {
                Some((finger, leaf)) => {
                    finger.row(dynamics, leaf, &on_hand, row);
                    row.palm
                }
                None => on_hand,
            };
            let (y_palm, y_target) = (palm.factor.tr_mul(&on_palm), target.factor.tr_mul(&on_target));
            for k in 0..6 {
                root_rows[i][k] = -y_palm[k];
                root_rows[i][k + 6] = y_target[k];
            }
        }
        bias[0] += soft.spring;
        let memory = contact.memory();
        let start = memory.map_or([0.0; MAX_ROWS], |m| m.main);
        let zone = memory.map_or(Zone::Stick, |m| m.zones[0]);
        self.arrow.add_block(soft.law, zone, &root_rows[..rows], &bias[..rows], &start[..rows]);
    }

    /// Keeps the normal forces of the main pass and turns each block's law into friction under them.
    fn fix_normals(&mut self, contacts: &mut [GraspContact]) {
        self.kept.clear();
        self.start.clear();
        self.laws.clear();
        for (block, &i) in self.order.iter().enumerate() {
            let contact = &mut contacts[i];
            let rows = contact.parameters.condim;
            let response = *self.arrow.response(block);
            contact.force_rows = [0.0; MAX_ROWS];
            contact.force_rows[0] = response.force[0];
            contact.main = response.force;
            contact.zones[0] = response.zone;

            let bound = match *self.arrow.law(block) {
                Law::Pyramidal { stiffness, friction } => {
                    Bound::Box(pyramid_pairs(self.arrow.residual(block), stiffness, &friction))
                }
                _ => Bound::Ellipsoid(response.force[0]),
            };
            let (centre, zone) = match contact.memory() {
                Some(Memory { friction, zones, .. }) => (*friction, zones[1]),
                None => {
                    let mut centre = [0.0; 5];
                    centre.copy_from_slice(&response.force[1..]);
                    (centre, Zone::Stick)
                }
            };
            let mobility = self.arrow.row_mobility(block, rows.min(2) - 1);
            self.kept.push(response.force[0]);
            self.start.push(0.0);
            for force in &centre[..rows - 1] {
                self.kept.push(0.0);
                self.start.push(*force);
            }
            let law = Law::Slip {
                centre,
                resistance: (RESISTANCE * mobility).max(f64::MIN_POSITIVE),
                friction: contact.parameters.friction,
                bound,
            };
            self.laws.push((law, zone));
        }
        let laws = &self.laws;
        self.arrow.continue_with(&self.kept, &self.start, |block| laws[block]);
    }
}
