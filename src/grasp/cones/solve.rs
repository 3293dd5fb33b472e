//! The grasp solve: from contacts and the engine's state to the contact forces of this step.
//!
//! MuJoCo's own contact problem, reduced to the target's and the palm's few unknowns:
//!
//! 1. *Main*: the convex problem with MuJoCo's contact softness gives the normal forces.
//! 2. *Noslip*: with the normal forces fixed, friction is solved without softness, as MuJoCo's noslip pass does, but to
//!    convergence: a proximal step around the friction of the first pass, corrected as in the last step. A still grasp
//!    does not creep, and what the motion does not decide (several contacts on one link) is as the first pass has it.
//!
//! Other constraints that move with hand or target, the contacts of other grasps among them, are part of
//! both passes.

mod friction;

use crate::grasp::cones::arrow::{Arrow, ROOT, RootVector, Status};
use crate::grasp::cones::coupled::CoupledConstraints;
use crate::grasp::cones::inverse_inertia::{Dynamics, HandInverseInertia, Spatial};
use crate::grasp::cones::joint_groups::JointGroups;
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS};
use crate::grasp::contact::softness::{SolverOptions, softness};
use crate::grasp::hand::topology::Topology;

/// How often friction is centred anew in a step at the most, see [`friction`].
const MAX_RECENTRINGS: usize = 3;

/// The solver and its memory from step to step (warm start).
#[derive(Clone, Debug)]
pub struct GraspSolver {
    inverse_inertia: HandInverseInertia,
    groups: JointGroups,
    arrow: Arrow,
    /// What each of the arrow's blocks is.
    order: Vec<Member>,
    /// Whitened rows of one group, one entry for each of its joints.
    own_rows: Vec<f64>,
    main: RootVector,
    noslip: RootVector,
    kept: Vec<f64>,
    start: Vec<f64>,
    costs: Vec<(Cost, ActiveSet)>,
}

/// What a block of the arrow stands for.
#[derive(Clone, Copy, Debug)]
enum Member {
    Contact(usize),
    Coupled(usize),
    /// Another grasp's contact, by its number among the foreign.
    Foreign(usize),
}

/// Iterations of the two passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
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
            inverse_inertia: HandInverseInertia::new(topology, dof_parent),
            groups: JointGroups::new(topology, dof_parent),
            arrow: Arrow::default(),
            order: Vec::new(),
            own_rows: Vec::new(),
            main: [0.0; ROOT],
            noslip: [0.0; ROOT],
            kept: Vec::new(),
            start: Vec::new(),
            costs: Vec::new(),
        }
    }

    /// Forgets the warm start (after a latch, a reset or a restored state).
    pub fn reset(&mut self) {
        self.main = [0.0; ROOT];
        self.noslip = [0.0; ROOT];
    }

    /// Where the two passes start in the next step.
    pub(in crate::grasp) fn warm_start(&self) -> [RootVector; 2] {
        [self.main, self.noslip]
    }

    /// Sets where the two passes start in the next step.
    pub(in crate::grasp) fn set_warm_start(&mut self, [main, noslip]: [RootVector; 2]) {
        (self.main, self.noslip) = (main, noslip);
    }

    /// Computes the force of each contact, together with `coupled`. What it was in the last step, its memory, is where
    /// the solve starts.
    pub fn solve(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &mut [GraspContact],
        coupled: &mut CoupledConstraints,
    ) -> SolveStatus {
        self.build(dynamics, topology, options, contacts, coupled);
        let main = self.arrow.solve(&mut self.main);
        self.fix_normals(contacts, coupled);
        let mut noslip = self.arrow.solve(&mut self.noslip);
        for _ in 0..MAX_RECENTRINGS {
            if !self.recentre(coupled) {
                break;
            }
            let again = self.arrow.solve(&mut self.noslip);
            noslip.iterations += again.iterations;
            noslip.converged &= again.converged;
        }
        for (block, member) in self.order.iter().enumerate() {
            let response = self.arrow.response(block);
            let contact = match *member {
                Member::Contact(i) => &mut contacts[i],
                Member::Foreign(i) => coupled.foreign_mut(i),
                Member::Coupled(i) => {
                    if let Some(first) = self.arrow.cost(block).first_friction_row() {
                        coupled.end_friction_pass(i, first, &response.force, response.active_set);
                    }
                    continue;
                }
            };
            for j in 1..contact.parameters.condim {
                contact.force_rows[j] = response.force[j - 1];
            }
            contact.active_sets[1] = response.active_set;
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
                self.inverse_inertia.fingers[finger].add_force(leaf, &on_link, out);
            }
        }
        for (body, wrench) in [(&self.inverse_inertia.palm, on_palm), (&self.inverse_inertia.target, on_target)] {
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
        coupled: &CoupledConstraints,
    ) {
        let palm = if topology.palm() == 0 { None } else { topology.leaf(topology.palm()) };
        self.inverse_inertia.palm.update(dynamics, palm);
        self.inverse_inertia.target.update(dynamics, topology.leaf(topology.target()));
        self.groups.form(dynamics, &self.inverse_inertia, contacts, coupled);
        self.arrow.begin();
        self.order.clear();
        // without joints of their own blocks share nothing but the root
        for (i, contact) in contacts.iter().enumerate().filter(|(_, c)| c.finger.is_none()) {
            self.arrow.begin_branch();
            self.add_contact(dynamics, topology, options, (i, contact), None);
            self.arrow.end_branch(0, &[]);
        }
        for k in 0..self.groups.free().len() {
            self.arrow.begin_branch();
            self.add_dense(coupled, self.groups.free()[k]);
            self.arrow.end_branch(0, &[]);
        }
        for k in 0..self.groups.count() {
            self.add_group(dynamics, topology, options, contacts, coupled, k);
        }
    }

    /// All contacts and coupled of the joints that are eliminated together.
    fn add_group(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
        coupled: &CoupledConstraints,
        k: usize,
    ) {
        self.arrow.begin_branch();
        let joints = self.groups.joints(self.groups.group(k));
        self.own_rows.clear();
        for n in 0..self.groups.group(k).nodes.len() {
            let finger = self.groups.group(k).nodes[n];
            if finger >= self.inverse_inertia.fingers.len() {
                continue;
            }
            self.inverse_inertia.fingers[finger].update(dynamics);
            let own = Own { finger, offset: self.groups.offset(finger), joints };
            for (i, contact) in contacts.iter().enumerate().filter(|(_, c)| c.finger == Some(finger)) {
                self.add_contact(dynamics, topology, options, (i, contact), Some(own));
            }
        }
        for n in 0..self.groups.group(k).coupled.len() {
            let group = self.groups.group(k);
            let i = group.coupled[n];
            let constraint = &coupled.list()[i];
            let at = self.own_rows.len();
            self.own_rows.resize(at + joints * constraint.rows, 0.0);
            if let Some((finger, dof, entry)) = self.groups.on_finger(constraint) {
                let start = at + self.groups.offset(finger);
                let HandInverseInertia { palm, fingers, .. } = &self.inverse_inertia;
                let own = &mut self.own_rows[start..start + fingers[finger].len()];
                let on_palm = palm.factor.tr_mul(&fingers[finger].joint_row(dynamics, dof, entry, own));
                let mut root_row = [0.0; ROOT];
                root_row[..6].copy_from_slice(on_palm.as_slice());
                self.add_coupled(coupled, i, &[root_row]);
                continue;
            }
            for (row, own) in self.own_rows[at..].chunks_exact_mut(joints.max(1)).enumerate() {
                self.groups.own_row(group, i, row, own);
            }
            self.add_dense(coupled, i);
        }
        self.arrow.end_branch(joints, &self.own_rows);
    }

    fn add_dense(&mut self, coupled: &CoupledConstraints, i: usize) {
        let rows = coupled.list()[i].rows;
        let mut root_rows = [[0.0; ROOT]; MAX_ROWS];
        for (k, row) in root_rows.iter_mut().take(rows).enumerate() {
            *row = *self.groups.root_row(i, k);
        }
        self.add_coupled(coupled, i, &root_rows[..rows]);
    }

    fn add_coupled(&mut self, coupled: &CoupledConstraints, i: usize, root_rows: &[RootVector]) {
        let constraint = &coupled.list()[i];
        let n = constraint.rows;
        let bias = &coupled.bias()[constraint.first..constraint.first + n];
        self.arrow.add_block(constraint.cost, constraint.active_sets[0], root_rows, bias, &constraint.main[..n]);
        self.order.push(constraint.foreign().map_or(Member::Coupled(i), Member::Foreign));
    }

    fn add_contact(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        (index, contact): (usize, &GraspContact),
        own: Option<Own>,
    ) {
        let soft = softness(&contact.parameters, options);
        let HandInverseInertia { palm, target, fingers } = &self.inverse_inertia;
        let rows = contact.parameters.condim;
        let row0 = self.own_rows.len();
        if let Some(own) = own {
            self.own_rows.resize(row0 + rows * own.joints, 0.0);
        }
        let hand_point = dynamics.reference_point(contact.link);
        let target_point = dynamics.reference_point(topology.target());
        let hand_velocity = dynamics.velocity(contact.link);
        let target_velocity = dynamics.velocity(topology.target());
        let finger = own.zip(topology.leaf(contact.link)).map(|(own, leaf)| (&fingers[own.finger], own, leaf));
        let hand_acceleration =
            palm.smooth + finger.map_or_else(Spatial::zeros, |(f, _, leaf)| f.smooth_acceleration(dynamics, leaf));

        let mut root_rows = [[0.0; ROOT]; MAX_ROWS];
        let mut bias = [0.0; MAX_ROWS];
        for i in 0..rows {
            let on_hand = -contact.unit_wrench(i, &hand_point);
            let on_target = contact.unit_wrench(i, &target_point);
            let velocity = on_target.dot(&target_velocity) + on_hand.dot(&hand_velocity);
            let acceleration = on_target.dot(&target.smooth) + on_hand.dot(&hand_acceleration);
            bias[i] = acceleration + soft.damping * velocity;
            let on_palm = match finger {
                Some((finger, own, leaf)) => {
                    let start = row0 + i * own.joints + own.offset;
                    finger.row(dynamics, leaf, &on_hand, &mut self.own_rows[start..start + finger.len()])
                }
                None => on_hand,
            };
            let (y_palm, y_target) = (palm.factor.tr_mul(&on_palm), target.factor.tr_mul(&on_target));
            for k in 0..6 {
                root_rows[i][k] = y_palm[k];
                root_rows[i][k + 6] = y_target[k];
            }
        }
        bias[0] += soft.spring;
        let memory = contact.warm_start();
        let start = memory.map_or([0.0; MAX_ROWS], |m| m.main);
        let active_set = memory.map_or(ActiveSet::Stick, |m| m.active_sets[0]);
        self.arrow.add_block(soft.cost, active_set, &root_rows[..rows], &bias[..rows], &start[..rows]);
        self.order.push(Member::Contact(index));
    }
}

/// Where a contact's finger stands among the joints of its group.
#[derive(Clone, Copy)]
struct Own {
    finger: usize,
    offset: usize,
    joints: usize,
}
