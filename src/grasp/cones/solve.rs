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
//! both passes; and those that do not, where the engine's solver then has nothing left to do.

mod friction;
mod resume;

use crate::grasp::cones::arrow::{Arrow, ROOT, RootVector, Status};
use crate::grasp::cones::coupled::{CoupledConstraint, CoupledConstraints};
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::cones::inverse_inertia::{HandInverseInertia, Spatial};
use crate::grasp::cones::joint_groups::JointGroups;
use crate::grasp::contact::contacts::{GraspContact, Turning};
use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS};
use crate::grasp::contact::softness::{Softness, SolverOptions, softness};
use crate::grasp::hand::topology::Topology;
use crate::grasp::linalg;
use nalgebra::Vector3;

/// The solver and its memory from step to step (warm start).
#[derive(Clone, Debug)]
pub struct GraspSolver {
    inverse_inertia: HandInverseInertia,
    groups: JointGroups,
    arrow: Arrow,
    /// What each of the arrow's blocks is, and its cost with the engine's softness.
    order: Vec<Member>,
    soft: Vec<Cost>,
    /// Which of the coupled each of the arrow's singles is.
    singles: Vec<usize>,
    /// Whitened rows of one group's trees, and fewer combinations of them.
    tree_rows: Vec<f64>,
    combined: Vec<f64>,
    main: RootVector,
    noslip: RootVector,
    /// In a frozen step.
    turning: Turning,
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
            soft: Vec::new(),
            singles: Vec::new(),
            tree_rows: Vec::new(),
            combined: Vec::new(),
            main: [0.0; ROOT],
            noslip: [0.0; ROOT],
            turning: Turning::default(),
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
        self.two_passes(contacts, coupled)
    }

    fn two_passes(&mut self, contacts: &mut [GraspContact], coupled: &mut CoupledConstraints) -> SolveStatus {
        let main = self.arrow.solve(&mut self.main);
        self.fix_normals(contacts, coupled);
        let mut noslip = self.arrow.solve(&mut self.noslip);
        if self.recentre(coupled) {
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
            let residual = &self.arrow.residual(block)[1..];
            contact.residual[..residual.len()].copy_from_slice(residual);
            contact.update_force();
        }
        for (single, &i) in self.singles.iter().enumerate() {
            let single = self.arrow.single(single);
            coupled.end_single_friction_pass(i, single.force, single.active_set());
        }
        SolveStatus { main, noslip }
    }

    /// Adds the generalised forces of all contacts to `out`: on the target, and against it on the links.
    pub fn add_forces(&self, dynamics: &Dynamics<'_>, topology: &Topology, contacts: &[GraspContact], out: &mut [f64]) {
        let (mut on_palm, mut on_target) = (Spatial::zeros(), Spatial::zeros());
        let target = dynamics.reference_point(topology.target());
        // contacts of one link follow each other, as a rule
        for same_link in contacts.chunk_by(|a, b| a.link == b.link) {
            let GraspContact { link, finger, leaves: [leaf, _], .. } = same_link[0];
            let point = dynamics.reference_point(link);
            let mut on_link = Spatial::zeros();
            for contact in same_link {
                on_target += contact.wrench_about(&target);
                on_link -= contact.wrench_about(&point);
            }
            on_palm += on_link;
            if let (Some(finger), Some(leaf)) = (finger, leaf) {
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
        self.inverse_inertia.palm.find_accelerations(dynamics);
        self.inverse_inertia.target.update(dynamics, topology.leaf(topology.target()));
        self.groups.form(dynamics, &self.inverse_inertia, contacts, coupled);
        self.arrow.begin(self.inverse_inertia.palm.rank() + self.inverse_inertia.target.rank());
        self.order.clear();
        self.soft.clear();
        self.singles.clear();
        // without joints of their own blocks share nothing but the root
        self.arrow.begin_branch(0);
        for (i, contact) in contacts.iter().enumerate().filter(|(_, c)| c.finger.is_none()) {
            self.add_contact(dynamics, options, (i, contact), None);
        }
        for k in 0..self.groups.free().len() {
            self.add_dense(coupled, self.groups.free()[k]);
        }
        self.arrow.end_branch();
        for k in 0..self.groups.count() {
            self.add_group(dynamics, options, contacts, coupled, k);
        }
    }

    /// All contacts and coupled of the joints that are eliminated together.
    fn add_group(
        &mut self,
        dynamics: &Dynamics<'_>,
        options: &SolverOptions,
        contacts: &[GraspContact],
        coupled: &CoupledConstraints,
        k: usize,
    ) {
        let combinations = self.combine_trees(coupled, k);
        let group = self.groups.group(k);
        let fingers = group.joints - group.whitened;
        self.arrow.begin_branch(combinations + fingers);
        for n in 0..self.groups.group(k).nodes.len() {
            let finger = self.groups.group(k).nodes[n];
            let HandInverseInertia { palm, fingers, .. } = &mut self.inverse_inertia;
            let Some(joints) = fingers.get_mut(finger) else { continue };
            joints.update(dynamics);
            let offset = self.groups.offset(finger) - self.groups.group(k).whitened + combinations;
            joints.set_inertia(dynamics, palm, &mut self.arrow, offset);
            for (i, contact) in contacts.iter().enumerate().filter(|(_, c)| c.finger == Some(finger)) {
                self.add_contact(dynamics, options, (i, contact), Some((finger, offset)));
            }
        }
        let mut at = 0;
        for n in 0..self.groups.group(k).coupled.len() {
            let group = self.groups.group(k);
            let i = group.coupled[n];
            let constraint = &coupled.list()[i];
            if let Some((finger, dof, entry)) = self.groups.on_finger(constraint) {
                let Some(joint) = self.inverse_inertia.fingers[finger].position(dof) else { continue };
                let joint = self.groups.offset(finger) - group.whitened + combinations + joint;
                let (bias, start) = (coupled.bias()[constraint.first], constraint.main[0]);
                self.arrow.add_single(constraint.cost, constraint.active_sets[0], (joint, entry), bias, start);
                self.singles.push(i);
                continue;
            }
            let block = self.add_dense(coupled, i);
            let group = self.groups.group(k);
            for row in 0..constraint.rows {
                let (_, own) = self.arrow.row(block, row);
                let (of_trees, of_fingers) = own.split_at_mut(combinations);
                of_trees.copy_from_slice(&self.combined[at..at + combinations]);
                at += combinations;
                self.groups.own_row(&group.nodes[group.trees..], i, row, of_fingers);
            }
        }
        self.arrow.end_branch();
    }

    /// The rows of a group's trees into `combined`, one after the other, in as many unknowns as are returned: where the trees
    /// have more joints than rows, as many combinations of them as there are rows give the same, `X X'` being the same.
    fn combine_trees(&mut self, coupled: &CoupledConstraints, k: usize) -> usize {
        let group = self.groups.group(k);
        self.tree_rows.clear();
        self.combined.clear();
        if group.whitened == 0 {
            return 0;
        }
        let mut rows = 0;
        for &i in &group.coupled {
            let constraint = &coupled.list()[i];
            if self.groups.on_finger(constraint).is_none() {
                for row in 0..constraint.rows {
                    let at = self.tree_rows.len();
                    self.tree_rows.resize(at + group.whitened, 0.0);
                    self.groups.own_row(&group.nodes[..group.trees], i, row, &mut self.tree_rows[at..]);
                }
                rows += constraint.rows;
            }
        }
        if group.whitened <= rows {
            std::mem::swap(&mut self.combined, &mut self.tree_rows);
            return group.whitened;
        }
        let row = |i: usize| &self.tree_rows[i * group.whitened..(i + 1) * group.whitened];
        self.combined.resize(rows * rows, 0.0);
        linalg::semidefinite_factor(rows, |i, j| linalg::dot(row(i), row(j)), &mut self.combined);
        rows
    }

    /// A constraint on several joints, but for their entries in its rows.
    fn add_dense(&mut self, coupled: &CoupledConstraints, i: usize) -> usize {
        let constraint: &CoupledConstraint = &coupled.list()[i];
        let n = constraint.rows;
        let bias = &coupled.bias()[constraint.first..constraint.first + n];
        let block = self.arrow.add_block(constraint.cost, constraint.active_sets[0], bias, &constraint.main[..n]);
        self.order.push(constraint.foreign().map_or(Member::Coupled(i), Member::Foreign));
        self.soft.push(constraint.cost);
        for row in 0..n {
            let (root, _) = self.arrow.row(block, row);
            self.groups.root_row(i, row, root);
        }
        block
    }

    /// A contact; `own` is its finger and where that begins among the branch's own unknowns.
    fn add_contact(
        &mut self,
        dynamics: &Dynamics<'_>,
        options: &SolverOptions,
        (index, contact): (usize, &GraspContact),
        own: Option<(usize, usize)>,
    ) {
        let soft = softness(&contact.parameters, options);
        let rows = contact.parameters.condim;
        let wrenches = contact.unit_wrenches(dynamics);
        let bias = self.contact_bias(dynamics, contact, &soft, &contact.velocity(dynamics));
        let HandInverseInertia { palm, target, fingers } = &self.inverse_inertia;
        let memory = contact.warm_start();
        let start = memory.map_or([0.0; MAX_ROWS], |m| m.main);
        let active_set = memory.map_or(ActiveSet::Stick, |m| m.active_sets[0]);
        let block = self.arrow.add_block(soft.cost, active_set, &bias[..rows], &start[..rows]);
        self.order.push(Member::Contact(index));
        self.soft.push(soft.cost);
        let finger = own.zip(contact.leaves[0]).map(|((finger, offset), leaf)| (&fingers[finger], offset, leaf));
        for (i, [on_hand, on_target]) in wrenches.iter().take(rows).enumerate() {
            let (root, own) = self.arrow.row(block, i);
            let (of_palm, of_target) = root.split_at_mut(palm.rank());
            palm.own(on_hand, of_palm);
            target.own(on_target, of_target);
            if let Some((finger, offset, leaf)) = finger {
                finger.row(leaf, on_hand, &mut own[offset..]);
            }
        }
    }

    /// `J qacc_smooth - aref` of each row of a contact with this relative velocity.
    fn contact_bias(
        &self,
        dynamics: &Dynamics<'_>,
        contact: &GraspContact,
        soft: &Softness,
        velocity: &[Vector3<f64>; 2],
    ) -> [f64; MAX_ROWS] {
        let HandInverseInertia { palm, target, fingers } = &self.inverse_inertia;
        let finger = contact.finger.zip(contact.leaves[0]);
        let hand = finger.map_or(palm.smooth, |(finger, leaf)| palm.smooth + fingers[finger].smooth_acceleration(leaf));
        let acceleration = contact.relative(dynamics, [&hand, &target.smooth]);
        let damped = [0, 1].map(|k| acceleration[k] + velocity[k] * soft.damping);
        let mut bias = [0.0; MAX_ROWS];
        for (i, bias) in bias.iter_mut().take(contact.parameters.condim).enumerate() {
            *bias = contact.along_row(i, &damped);
        }
        bias[0] += soft.spring;
        bias
    }
}
