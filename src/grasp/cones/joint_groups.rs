//! Which rows share joints: fingers, and whatever other constraints tie together.
//!
//! With the accelerations of palm and target as unknowns the fingers do not feel each other, unless a constraint
//! (a tendon over two of them, a contact between them) joins them. What is joined is eliminated together.

use crate::grasp::cones::arrow::{ROOT, RootVector};
use crate::grasp::cones::coupled::{CoupledConstraint, CoupledConstraints, Jacobian};
use crate::grasp::cones::inverse_inertia::{Dynamics, HandInverseInertia};
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::hand::topology::Topology;

/// Joints that are eliminated together, and the coupled that move them.
#[derive(Clone, Debug, Default)]
pub struct JointGroup {
    /// Fingers, and beyond their number trees of the rest of the model.
    pub nodes: Vec<usize>,
    /// CoupledConstraints in this group.
    pub coupled: Vec<usize>,
}

/// The partition of one step, and the coupled' rows in whitened coordinates.
#[derive(Clone, Debug, Default)]
pub struct JointGroups {
    /// Finger or tree of each degree of freedom.
    node_of_dof: Vec<usize>,
    /// Degrees of freedom of each node.
    dofs: Vec<Vec<usize>>,
    fingers: usize,
    groups: Vec<JointGroup>,
    used: usize,
    /// CoupledConstraints that move palm or target but no other joint.
    free: Vec<usize>,
    parent: Vec<usize>,
    has_contact: Vec<bool>,
    group_of: Vec<usize>,
    /// Where each node's joints begin among those of its group.
    offset: Vec<usize>,
    /// False if nothing moves the palm.
    palm_moves: bool,
    /// First whitened row of each constraint; no rows if it is [on one finger's joint](Self::on_finger).
    whitened: Vec<usize>,
    root_rows: Vec<RootVector>,
    own_rows: Vec<f64>,
}

/// No group.
const NONE: usize = usize::MAX;

impl JointGroups {
    /// For the hand and target of `topology`; everything else is parted into kinematic trees.
    pub fn new(topology: &Topology, dof_parent: &[i32]) -> Self {
        let fingers = topology.fingers().len();
        let mut node_of_dof = vec![NONE; dof_parent.len()];
        let mut dofs = topology.fingers().to_vec();
        for (node, finger) in dofs.iter().enumerate() {
            for &dof in finger {
                node_of_dof[dof] = node;
            }
        }
        let mut tree_of_dof = vec![NONE; dof_parent.len()];
        let mut trees = 0;
        for dof in 0..dof_parent.len() {
            // parents come before their children
            tree_of_dof[dof] = usize::try_from(dof_parent[dof]).map_or_else(
                |_| {
                    trees += 1;
                    trees - 1
                },
                |parent| tree_of_dof[parent],
            );
        }
        dofs.resize(fingers + trees, Vec::new());
        for dof in 0..dof_parent.len() {
            if node_of_dof[dof] == NONE {
                node_of_dof[dof] = fingers + tree_of_dof[dof];
                dofs[node_of_dof[dof]].push(dof);
            }
        }
        let nodes = dofs.len();
        JointGroups {
            node_of_dof,
            dofs,
            fingers,
            has_contact: vec![false; nodes],
            group_of: vec![NONE; nodes],
            offset: vec![0; nodes],
            ..JointGroups::default()
        }
    }

    /// Parts the fingers with contacts and the coupled that move with the grasp into groups.
    pub fn form(
        &mut self,
        dynamics: &Dynamics<'_>,
        inverse_inertia: &HandInverseInertia,
        contacts: &[GraspContact],
        coupled: &CoupledConstraints,
    ) {
        self.used = 0;
        self.free.clear();
        self.has_contact.fill(false);
        for finger in contacts.iter().filter_map(|c| c.finger) {
            self.has_contact[finger] = true;
        }
        if coupled.list().is_empty() {
            for finger in 0..self.fingers {
                if self.has_contact[finger] {
                    let group = self.open();
                    self.groups[group].nodes.push(finger);
                    self.offset[finger] = 0;
                }
            }
            return;
        }
        self.whiten(dynamics, inverse_inertia, coupled);
        self.join(coupled);
        self.gather(coupled);
    }

    /// Number of groups.
    pub fn count(&self) -> usize {
        self.used
    }

    /// JointGroup `k`.
    pub fn group(&self, k: usize) -> &JointGroup {
        &self.groups[k]
    }

    /// CoupledConstraints that move palm or target but no other joint.
    pub fn free(&self) -> &[usize] {
        &self.free
    }

    /// Number of joints of a group.
    pub fn joints(&self, group: &JointGroup) -> usize {
        group.nodes.iter().map(|&node| self.dofs[node].len()).sum()
    }

    /// Where a finger's joints begin among those of its group.
    pub fn offset(&self, finger: usize) -> usize {
        self.offset[finger]
    }

    /// Finger, degree of freedom and entry of a constraint that moves one finger's joint and nothing else; such rows are not
    /// whitened here.
    pub fn on_finger(&self, constraint: &CoupledConstraint) -> Option<(usize, usize, f64)> {
        match constraint.jacobian {
            Jacobian::Single(dof, value) if self.node_of_dof[dof] < self.fingers => {
                Some((self.node_of_dof[dof], dof, value))
            }
            _ => None,
        }
    }

    /// What of row `k` of constraint `i` moves palm and target.
    pub fn root_row(&self, i: usize, k: usize) -> &RootVector {
        &self.root_rows[self.whitened[i] + k]
    }

    /// What of row `k` of constraint `i` moves the joints of `group`, into `out`.
    pub fn own_row(&self, group: &JointGroup, i: usize, k: usize, out: &mut [f64]) {
        let nv = self.node_of_dof.len();
        let row = self.whitened[i] + k;
        let own = &self.own_rows[row * nv..(row + 1) * nv];
        let dofs = group.nodes.iter().flat_map(|&node| &self.dofs[node]);
        for (out, &dof) in out.iter_mut().zip(dofs) {
            *out = own[dof];
        }
    }

    fn open(&mut self) -> usize {
        if self.groups.len() == self.used {
            self.groups.push(JointGroup::default());
        }
        let group = &mut self.groups[self.used];
        group.nodes.clear();
        group.coupled.clear();
        self.used += 1;
        self.used - 1
    }

    /// The coupled' rows in whitened coordinates, parted into the root's and the rest.
    fn whiten(&mut self, dynamics: &Dynamics<'_>, inverse_inertia: &HandInverseInertia, coupled: &CoupledConstraints) {
        let nv = self.node_of_dof.len();
        self.palm_moves = !inverse_inertia.palm.chain().is_empty();
        self.root_rows.clear();
        self.own_rows.clear();
        self.whitened.clear();
        for constraint in coupled.list() {
            self.whitened.push(self.root_rows.len());
            if self.on_finger(constraint).is_some() {
                continue;
            }
            for k in 0..constraint.rows {
                let at = self.own_rows.len();
                match constraint.jacobian {
                    Jacobian::Single(dof, value) => {
                        self.own_rows.resize(at + nv, 0.0);
                        self.own_rows[at + dof] = value;
                    }
                    Jacobian::Dense(row) => self.own_rows.extend_from_slice(coupled.jacobian(row + k, nv)),
                }
                let own = &mut self.own_rows[at..];
                dynamics.whiten(own);
                let mut root = [0.0; ROOT];
                for (half, body) in root.chunks_exact_mut(6).zip([&inverse_inertia.palm, &inverse_inertia.target]) {
                    half.copy_from_slice(body.take(own).as_slice());
                }
                self.root_rows.push(root);
            }
        }
    }

    /// Joins the nodes that a constraint moves at once.
    fn join(&mut self, coupled: &CoupledConstraints) {
        let nv = self.node_of_dof.len();
        self.parent.clear();
        self.parent.extend(0..self.dofs.len());
        for (i, constraint) in coupled.list().iter().enumerate() {
            if self.on_finger(constraint).is_some() {
                continue;
            }
            let mut first = None;
            for row in self.whitened[i]..self.whitened[i] + constraint.rows {
                for dof in 0..nv {
                    if self.own_rows[row * nv + dof] != 0.0 {
                        let node = find(&mut self.parent, self.node_of_dof[dof]);
                        let with = *first.get_or_insert(node);
                        let with = find(&mut self.parent, with);
                        self.parent[node] = with;
                    }
                }
            }
        }
    }

    /// Makes a group of each set of joined nodes that moves with the grasp.
    fn gather(&mut self, coupled: &CoupledConstraints) {
        self.group_of.fill(NONE);
        for finger in 0..self.fingers {
            if self.has_contact[finger] {
                self.group_at(finger);
            }
        }
        for (i, constraint) in coupled.list().iter().enumerate() {
            let moves_root = self.moves_root(i, constraint);
            match self.node_of(i, constraint) {
                None if moves_root => self.free.push(i),
                Some(node) if moves_root => {
                    self.group_at(node);
                }
                _ => {}
            }
        }
        for (i, constraint) in coupled.list().iter().enumerate() {
            if let Some(node) = self.node_of(i, constraint) {
                let set = find(&mut self.parent, node);
                if self.group_of[set] != NONE {
                    self.groups[self.group_of[set]].coupled.push(i);
                }
            }
        }
        for node in 0..self.dofs.len() {
            let set = find(&mut self.parent, node);
            if self.group_of[set] != NONE {
                let group = &self.groups[self.group_of[set]];
                self.offset[node] = self.joints(group);
                self.groups[self.group_of[set]].nodes.push(node);
            }
        }
    }

    fn group_at(&mut self, node: usize) -> usize {
        let set = find(&mut self.parent, node);
        if self.group_of[set] == NONE {
            self.group_of[set] = self.open();
        }
        self.group_of[set]
    }

    fn moves_root(&self, i: usize, constraint: &CoupledConstraint) -> bool {
        let rows = self.whitened[i]..self.whitened[i] + constraint.rows;
        match self.on_finger(constraint) {
            Some(_) => self.palm_moves,
            None => self.root_rows[rows].iter().flatten().any(|&y| y != 0.0),
        }
    }

    /// A node that the rows move.
    fn node_of(&self, i: usize, constraint: &CoupledConstraint) -> Option<usize> {
        if let Some((finger, ..)) = self.on_finger(constraint) {
            return Some(finger);
        }
        let nv = self.node_of_dof.len();
        let first = self.whitened[i];
        let moved = self.own_rows[first * nv..(first + constraint.rows) * nv].iter().position(|&x| x != 0.0)?;
        Some(self.node_of_dof[moved % nv])
    }
}

/// The representative of a set, with path halving.
fn find(parent: &mut [usize], mut node: usize) -> usize {
    while parent[node] != node {
        parent[node] = parent[parent[node]];
        node = parent[node];
    }
    node
}
