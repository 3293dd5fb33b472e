//! Which rows share joints: fingers, and whatever other constraints tie together.
//!
//! With the accelerations of palm and target as unknowns the fingers do not feel each other, unless a constraint
//! (a tendon over two of them, a contact between them) joins them. What is joined is eliminated together.

use super::arrow::{ROOT, RootVector};
use super::contacts::GraspContact;
use super::mobility::{Dynamics, Mobility};
use super::neighbours::Neighbours;
use super::topology::Topology;

/// Joints that are eliminated together, and the neighbours that move them.
#[derive(Clone, Debug, Default)]
pub struct Branch {
    /// Fingers, and beyond their number trees of the rest of the model.
    pub nodes: Vec<usize>,
    /// Neighbours in this branch.
    pub neighbours: Vec<usize>,
}

/// The partition of one step, and the neighbours' rows in whitened coordinates.
#[derive(Clone, Debug, Default)]
pub struct Branches {
    /// Finger or tree of each degree of freedom.
    node_of_dof: Vec<usize>,
    /// Degrees of freedom of each node.
    dofs: Vec<Vec<usize>>,
    fingers: usize,
    branches: Vec<Branch>,
    used: usize,
    /// Neighbours that move palm or target but no other joint.
    free: Vec<usize>,
    parent: Vec<usize>,
    has_contact: Vec<bool>,
    branch_of: Vec<usize>,
    /// Where each node's joints begin among those of its branch.
    offset: Vec<usize>,
    root_rows: Vec<RootVector>,
    own_rows: Vec<f64>,
}

/// No branch.
const NONE: usize = usize::MAX;

impl Branches {
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
        Branches {
            node_of_dof,
            dofs,
            fingers,
            has_contact: vec![false; nodes],
            branch_of: vec![NONE; nodes],
            offset: vec![0; nodes],
            ..Branches::default()
        }
    }

    /// Parts the fingers with contacts and the neighbours that move with the grasp into branches.
    pub fn form(
        &mut self,
        dynamics: &Dynamics<'_>,
        mobility: &Mobility,
        contacts: &[GraspContact],
        neighbours: &Neighbours,
    ) {
        self.used = 0;
        self.free.clear();
        self.has_contact.fill(false);
        for finger in contacts.iter().filter_map(|c| c.finger) {
            self.has_contact[finger] = true;
        }
        if neighbours.list().is_empty() {
            for finger in 0..self.fingers {
                if self.has_contact[finger] {
                    let branch = self.open();
                    self.branches[branch].nodes.push(finger);
                    self.offset[finger] = 0;
                }
            }
            return;
        }
        self.whiten(dynamics, mobility, neighbours);
        self.join(neighbours);
        self.gather(neighbours);
    }

    /// Number of branches.
    pub fn count(&self) -> usize {
        self.used
    }

    /// Branch `k`.
    pub fn branch(&self, k: usize) -> &Branch {
        &self.branches[k]
    }

    /// Neighbours that move palm or target but no other joint.
    pub fn free(&self) -> &[usize] {
        &self.free
    }

    /// Number of joints of a branch.
    pub fn joints(&self, branch: &Branch) -> usize {
        branch.nodes.iter().map(|&node| self.dofs[node].len()).sum()
    }

    /// Where a finger's joints begin among those of its branch.
    pub fn offset(&self, finger: usize) -> usize {
        self.offset[finger]
    }

    /// What of a neighbour's row moves palm and target.
    pub fn root_row(&self, row: usize) -> &RootVector {
        &self.root_rows[row]
    }

    /// What of a neighbour's row moves the joints of `branch`, into `out`.
    pub fn own_row(&self, branch: &Branch, row: usize, out: &mut [f64]) {
        let nv = self.node_of_dof.len();
        let own = &self.own_rows[row * nv..(row + 1) * nv];
        let dofs = branch.nodes.iter().flat_map(|&node| &self.dofs[node]);
        for (out, &dof) in out.iter_mut().zip(dofs) {
            *out = own[dof];
        }
    }

    fn open(&mut self) -> usize {
        if self.branches.len() == self.used {
            self.branches.push(Branch::default());
        }
        let branch = &mut self.branches[self.used];
        branch.nodes.clear();
        branch.neighbours.clear();
        self.used += 1;
        self.used - 1
    }

    /// The neighbours' rows in whitened coordinates, parted into the root's and the rest.
    fn whiten(&mut self, dynamics: &Dynamics<'_>, mobility: &Mobility, neighbours: &Neighbours) {
        let nv = self.node_of_dof.len();
        let rows = neighbours.bias().len();
        self.root_rows.clear();
        self.own_rows.clear();
        self.own_rows.reserve(rows * nv);
        for row in 0..rows {
            self.own_rows.extend_from_slice(neighbours.jacobian(row, nv));
            let own = &mut self.own_rows[row * nv..];
            dynamics.whiten(own);
            let mut root = [0.0; ROOT];
            for (half, body) in root.chunks_exact_mut(6).zip([&mobility.palm, &mobility.target]) {
                half.copy_from_slice(body.take(own).as_slice());
            }
            self.root_rows.push(root);
        }
    }

    /// Joins the nodes that a neighbour moves at once.
    fn join(&mut self, neighbours: &Neighbours) {
        let nv = self.node_of_dof.len();
        self.parent.clear();
        self.parent.extend(0..self.dofs.len());
        for neighbour in neighbours.list() {
            let mut first = None;
            for row in neighbour.first..neighbour.first + neighbour.rows {
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

    /// Makes a branch of each set of joined nodes that moves with the grasp.
    fn gather(&mut self, neighbours: &Neighbours) {
        self.branch_of.fill(NONE);
        for finger in 0..self.fingers {
            if self.has_contact[finger] {
                self.branch_at(finger);
            }
        }
        for (i, neighbour) in neighbours.list().iter().enumerate() {
            let moves_root = self.moves_root(neighbour.first, neighbour.rows);
            match self.node_of(neighbour.first, neighbour.rows) {
                None if moves_root => self.free.push(i),
                Some(node) if moves_root => {
                    self.branch_at(node);
                }
                _ => {}
            }
        }
        for (i, neighbour) in neighbours.list().iter().enumerate() {
            if let Some(node) = self.node_of(neighbour.first, neighbour.rows) {
                let set = find(&mut self.parent, node);
                if self.branch_of[set] != NONE {
                    self.branches[self.branch_of[set]].neighbours.push(i);
                }
            }
        }
        for node in 0..self.dofs.len() {
            let set = find(&mut self.parent, node);
            if self.branch_of[set] != NONE {
                let branch = &self.branches[self.branch_of[set]];
                self.offset[node] = self.joints(branch);
                self.branches[self.branch_of[set]].nodes.push(node);
            }
        }
    }

    fn branch_at(&mut self, node: usize) -> usize {
        let set = find(&mut self.parent, node);
        if self.branch_of[set] == NONE {
            self.branch_of[set] = self.open();
        }
        self.branch_of[set]
    }

    fn moves_root(&self, first: usize, rows: usize) -> bool {
        self.root_rows[first..first + rows].iter().flatten().any(|&y| y != 0.0)
    }

    /// A node that the rows move.
    fn node_of(&self, first: usize, rows: usize) -> Option<usize> {
        let nv = self.node_of_dof.len();
        let moved = self.own_rows[first * nv..(first + rows) * nv].iter().position(|&x| x != 0.0)?;
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
