//! The coupled' rows in the coordinates of the solve, and what they move.

use super::{JointGroups, Moved, find};
use crate::grasp::cones::arrow::ROOT;
use crate::grasp::cones::coupled::{CoupledConstraints, Jacobian};
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::cones::inverse_inertia::HandInverseInertia;
use crate::grasp::linalg::{LANES, Lanes};

impl JointGroups {
    /// The coupled' rows, parted into the root's and the rest, and what they move; joins the nodes that a constraint moves at
    /// once.
    pub(super) fn read(
        &mut self,
        dynamics: &Dynamics<'_>,
        inverse_inertia: &HandInverseInertia,
        coupled: &CoupledConstraints,
    ) {
        self.root_rows.clear();
        self.own_rows.clear();
        self.moved.clear();
        self.parent.clear();
        self.parent.extend(0..self.dofs.len());
        self.scale.clear();
        self.scale.extend(dynamics.inverse_diagonal.iter().map(|x| x.sqrt()));
        let palm_moves = inverse_inertia.palm.rank() > 0;
        let mut rows = std::mem::take(&mut self.rows);
        rows.clear();
        for (i, constraint) in coupled.list().iter().enumerate() {
            let (node, root) =
                self.on_finger(constraint).map_or((None, false), |(finger, ..)| (Some(finger), palm_moves));
            self.moved.push(Moved { node, root, first: rows.len() });
            if node.is_none() {
                rows.extend((0..constraint.rows).map(|row| (i, row)));
            }
        }
        for some in rows.chunks(LANES) {
            self.read_rows(dynamics, inverse_inertia, coupled, some);
        }
        self.rows = rows;
    }

    /// At most [`LANES`] rows, side by side: by their constraint and which of its rows they are.
    fn read_rows(
        &mut self,
        dynamics: &Dynamics<'_>,
        inverse_inertia: &HandInverseInertia,
        coupled: &CoupledConstraints,
        rows: &[(usize, usize)],
    ) {
        let nv = self.node_of_dof.len();
        let HandInverseInertia { palm, target, .. } = inverse_inertia;
        let at = self.own_rows.len();
        self.own_rows.resize(at + nv, [0.0; LANES]);
        let JointGroups { node_of_dof, own_rows, support, .. } = self;
        let own = &mut own_rows[at..];
        let of_finger = |dof: usize| node_of_dof[dof] < self.fingers;
        support.clear();
        // fingers' entries stay what they are, and what is before them is whitened without them
        for (lane, &(i, row)) in rows.iter().enumerate() {
            let constraint = &coupled.list()[i];
            if let Jacobian::Single(dof, value) = constraint.jacobian {
                own[dof][lane] = value;
                support.extend(dynamics.with_ancestors(dof));
            } else {
                let of_row = coupled.support(constraint);
                for (&dof, &entry) in of_row.iter().zip(coupled.row(constraint, row)) {
                    own[dof][lane] = if of_finger(dof) { 0.0 } else { entry };
                }
                if support != of_row {
                    support.extend(of_row);
                }
            }
        }
        if !support.is_sorted_by(|a, b| a > b) {
            support.sort_unstable_by(|a, b| b.cmp(a));
            support.dedup();
        }
        support.iter().for_each(|&dof| whiten(dynamics, &self.scale, dof, own));
        let mut root = [[0.0; LANES]; ROOT];
        let (of_palm, of_target) = root.split_at_mut(palm.rank());
        palm.take(own, of_palm);
        target.take(own, &mut of_target[..target.rank()]);
        for (lane, &(i, row)) in rows.iter().enumerate() {
            let constraint = &coupled.list()[i];
            let moved = &mut self.moved[i];
            moved.root |= root.iter().any(|y| y[lane] != 0.0);
            let entries = coupled.support(constraint).iter().zip(coupled.row(constraint, row));
            for (&dof, &entry) in entries.filter(|(dof, _)| of_finger(**dof)) {
                own[dof][lane] = entry;
                // a finger's joints move the palm by their inertia
                moved.root |= palm.rank() > 0 && entry != 0.0;
            }
            for &dof in support.iter().filter(|dof| own[**dof][lane] != 0.0) {
                let node = node_of_dof[dof];
                let with = *moved.node.get_or_insert(node);
                if with != node {
                    let (node, with) = (find(&mut self.parent, node), find(&mut self.parent, with));
                    self.parent[node] = with;
                }
            }
        }
        self.root_rows.push(root);
    }
}

/// One step of `x <- D^-1/2 L^-T x`, rows of a Jacobian in coordinates in which the mass matrix is the identity: that of `dof`,
/// after those that hang on it.
fn whiten(dynamics: &Dynamics<'_>, scale: &[f64], dof: usize, x: &mut [Lanes]) {
    let value = x[dof];
    if value == [0.0; LANES] {
        return;
    }
    let mut ancestor = dynamics.parent(dof);
    for l in dynamics.ancestors_factor(dof) {
        let Some(j) = ancestor else { break };
        x[j] = std::array::from_fn(|k| x[j][k] - l * value[k]);
        ancestor = dynamics.parent(j);
    }
    x[dof] = value.map(|x| x * scale[dof]);
}
