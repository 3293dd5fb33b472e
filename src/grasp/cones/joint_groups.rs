//! Which rows share joints: fingers, and whatever other constraints tie together.
//!
//! With the accelerations of palm and target as unknowns the fingers do not feel each other, unless a constraint
//! (a tendon over two of them, a contact between them) joins them. What is joined is eliminated together.

mod rows;

use crate::grasp::cones::arrow::ROOT;
use crate::grasp::cones::coupled::{CoupledConstraint, CoupledConstraints, Jacobian};
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::cones::inverse_inertia::HandInverseInertia;
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::hand::topology::Topology;
use crate::grasp::linalg::{LANES, Lanes};

/// Joints that are eliminated together, and the coupled that move them.
#[derive(Clone, Debug, Default)]
pub struct JointGroup {
    /// Trees of the rest of the model, whose numbers are beyond the fingers', then fingers.
    pub nodes: Vec<usize>,
    /// Number of those trees.
    pub trees: usize,
    /// CoupledConstraints in this group.
    pub coupled: Vec<usize>,
    /// Number of joints of its trees, which come first; they count in whitened coordinates, those of fingers as they are.
    pub whitened: usize,
    /// Number of all its joints.
    pub joints: usize,
}

/// The partition of one step, and the coupled' rows in the coordinates of the solve.
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
    /// What each constraint moves.
    moved: Vec<Moved>,
    /// The rows that are whitened, by their constraint and which of its rows they are.
    rows: Vec<(usize, usize)>,
    /// Degrees of freedom that some of them move, and all before them, from the last to the first.
    support: Vec<usize>,
    /// [`LANES`] of these rows at a time, side by side: their entries for the root, and for each degree of freedom.
    root_rows: Vec<[Lanes; ROOT]>,
    own_rows: Vec<Lanes>,
    /// `D^-1/2` of the mass matrix' factor.
    scale: Vec<f64>,
}

/// What a constraint moves.
#[derive(Clone, Copy, Debug)]
struct Moved {
    /// One of the nodes.
    node: Option<usize>,
    /// Palm or target.
    root: bool,
    /// Its first row among those that are whitened; none if it is [on one finger's joint](JointGroups::on_finger).
    first: usize,
}

/// Most constraints elsewhere that are solved with a grasp: one at a time they cost little, but what is dense is the engine's.
const MAX_ELSEWHERE: usize = 64;

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
                    self.add_node(group, finger);
                }
            }
            return;
        }
        self.read(dynamics, inverse_inertia, coupled);
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

    /// What of row `k` of constraint `i` moves palm and target, in their own coordinates, into one entry for each.
    pub fn root_row(&self, i: usize, k: usize, out: &mut [f64]) {
        let row = self.moved[i].first + k;
        out.iter_mut().zip(&self.root_rows[row / LANES]).for_each(|(out, rows)| *out = rows[row % LANES]);
    }

    /// What of row `k` of constraint `i` moves the joints of `nodes`, into one entry for each.
    pub fn own_row(&self, nodes: &[usize], i: usize, k: usize, out: &mut [f64]) {
        let nv = self.node_of_dof.len();
        let row = self.moved[i].first + k;
        let at = row / LANES * nv;
        let own = &self.own_rows[at..at + nv];
        let mut rest = out;
        for &node in nodes {
            let (out, others) = rest.split_at_mut(self.dofs[node].len());
            out.iter_mut().zip(&self.dofs[node]).for_each(|(out, &dof)| *out = own[dof][row % LANES]);
            rest = others;
        }
    }

    fn open(&mut self) -> usize {
        if self.groups.len() == self.used {
            self.groups.push(JointGroup::default());
        }
        let group = &mut self.groups[self.used];
        group.nodes.clear();
        group.coupled.clear();
        (group.trees, group.whitened, group.joints) = (0, 0, 0);
        self.used += 1;
        self.used - 1
    }

    /// Makes a group of each set of joined nodes that moves with the grasp.
    fn gather(&mut self, coupled: &CoupledConstraints) {
        self.group_of.fill(NONE);
        for finger in 0..self.fingers {
            if self.has_contact[finger] {
                self.group_at(finger);
            }
        }
        for i in 0..self.moved.len() {
            match self.moved[i] {
                Moved { root: true, node: None, .. } => self.free.push(i),
                Moved { root: true, node: Some(node), .. } => {
                    self.group_at(node);
                }
                _ => {}
            }
        }
        self.gather_elsewhere(coupled);
        for i in 0..self.moved.len() {
            if let Some(node) = self.moved[i].node {
                let set = find(&mut self.parent, node);
                if self.group_of[set] != NONE {
                    self.groups[self.group_of[set]].coupled.push(i);
                }
            }
        }
        for node in (self.fingers..self.dofs.len()).chain(0..self.fingers) {
            let set = find(&mut self.parent, node);
            if self.group_of[set] != NONE {
                self.add_node(self.group_of[set], node);
            }
        }
    }

    /// And of those that do not, if they are taken.
    fn gather_elsewhere(&mut self, coupled: &CoupledConstraints) {
        let mut elsewhere = 0;
        for (i, moved) in self.moved.iter().enumerate() {
            let grouped = match moved.node {
                Some(node) => self.group_of[find(&mut self.parent, node)] != NONE,
                None => moved.root,
            };
            elsewhere += usize::from(!grouped);
            if elsewhere > MAX_ELSEWHERE || !grouped && !coupled.takes(i) {
                return;
            }
        }
        for i in 0..self.moved.len() {
            match self.moved[i] {
                Moved { node: Some(node), .. } => {
                    self.group_at(node);
                }
                Moved { root: false, .. } => self.free.push(i),
                _ => {}
            }
        }
    }

    fn add_node(&mut self, group: usize, node: usize) {
        let group = &mut self.groups[group];
        self.offset[node] = group.joints;
        group.nodes.push(node);
        group.joints += self.dofs[node].len();
        if node >= self.fingers {
            (group.trees, group.whitened) = (group.nodes.len(), group.joints);
        }
    }

    fn group_at(&mut self, node: usize) -> usize {
        let set = find(&mut self.parent, node);
        if self.group_of[set] == NONE {
            self.group_of[set] = self.open();
        }
        self.group_of[set]
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
