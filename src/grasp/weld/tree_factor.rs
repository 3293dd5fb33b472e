//! `H = L^T D L` along the kinematic tree: the engine's factor of the mass matrix, with more on some of its diagonal.

use crate::grasp::linalg::axpy_lanes;
use crate::mujoco::Simulation;

/// The factor. Buffers are kept.
#[derive(Clone, Debug, Default)]
pub(super) struct TreeFactor {
    parent: Vec<Option<usize>>,
    /// Of each degree of freedom, where its row of `l` begins; and the end of the last.
    start: Vec<usize>,
    /// Entries of `L` for the ancestors, the nearest first.
    l: Vec<f64>,
    inverse_diagonal: Vec<f64>,
    column: Vec<f64>,
}

impl TreeFactor {
    /// Becomes that of the mass matrix.
    pub fn load(&mut self, sim: &Simulation) {
        let factor = sim.mass_factor();
        self.parent.clear();
        self.parent.extend(sim.model().dof_parentid().iter().map(|&p| usize::try_from(p).ok()));
        self.start.clear();
        self.start.push(0);
        self.l.clear();
        for (dof, parent) in self.parent.iter().enumerate() {
            let ancestors = parent.map_or(0, |p| 1 + self.start[p + 1] - self.start[p]);
            let end = self.l.len() + ancestors;
            self.l.extend(factor.ancestors(dof).take(ancestors));
            self.l.resize(end, 0.0);
            self.start.push(end);
        }
        self.inverse_diagonal.clear();
        self.inverse_diagonal.extend_from_slice(sim.qLDiagInv());
    }

    /// Becomes a copy; the memory is kept.
    pub fn copy_from(&mut self, other: &TreeFactor) {
        self.parent.clone_from(&other.parent);
        self.start.clone_from(&other.start);
        self.l.clone_from(&other.l);
        self.inverse_diagonal.clone_from(&other.inverse_diagonal);
    }

    /// `H <- H + x e e^T`, `e` the unit vector of degree of freedom `dof`, `x` not negative (Bennett 1965).
    pub fn strengthen(&mut self, dof: usize, x: f64) {
        let depth = self.row(dof).len();
        self.column.clear();
        self.column.resize(depth + 1, 0.0);
        self.column[0] = 1.0;
        let (mut weight, mut at) = (x, Some(dof));
        for k in 0..=depth {
            let Some(i) = at else { break };
            let (p, inverse) = (self.column[k], self.inverse_diagonal[i]);
            let grown = 1.0 + weight * p * p * inverse;
            self.inverse_diagonal[i] = inverse / grown;
            let gain = weight * p * self.inverse_diagonal[i];
            weight /= grown;
            for (l, c) in self.l[self.start[i]..self.start[i + 1]].iter_mut().zip(&mut self.column[k + 1..]) {
                *c -= p * *l;
                *l += gain * *c;
            }
            at = self.parent[i];
        }
    }

    /// `X <- L^-T X` for `width` columns, whole vectors of them, row by row of `x`.
    pub fn forward(&self, x: &mut [f64], width: usize) {
        for dof in (0..self.parent.len()).rev() {
            let (before, from) = x.split_at_mut(dof * width);
            let own = &from[..width];
            if own.iter().all(|value| *value == 0.0) {
                continue;
            }
            let mut at = self.parent[dof];
            for l in self.row(dof) {
                let Some(i) = at else { break };
                axpy_lanes(-l, own, &mut before[i * width..(i + 1) * width]);
                at = self.parent[i];
            }
        }
    }

    /// `x <- L^-T x`.
    pub fn forward_one(&self, x: &mut [f64]) {
        for dof in (0..self.parent.len()).rev() {
            let value = x[dof];
            let mut at = self.parent[dof];
            for l in self.row(dof) {
                let Some(i) = at else { break };
                x[i] -= l * value;
                at = self.parent[i];
            }
        }
    }

    /// `x <- L^-1 D^-1 x`.
    pub fn backward(&self, x: &mut [f64]) {
        for dof in 0..self.parent.len() {
            let mut value = self.inverse_diagonal[dof] * x[dof];
            let mut at = self.parent[dof];
            for l in self.row(dof) {
                let Some(i) = at else { break };
                value -= l * x[i];
                at = self.parent[i];
            }
            x[dof] = value;
        }
    }

    /// `D^-1`.
    pub fn inverse_diagonal(&self) -> &[f64] {
        &self.inverse_diagonal
    }

    fn row(&self, dof: usize) -> &[f64] {
        &self.l[self.start[dof]..self.start[dof + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two fingers of two joints on a palm with two joints.
    fn tree() -> TreeFactor {
        let parent = vec![None, Some(0), Some(1), Some(2), Some(1), Some(4)];
        let start = vec![0, 0, 1, 3, 6, 8, 11];
        let l = (0..11).map(|i| (1.3 * i as f64).sin()).collect();
        let inverse_diagonal = (0..6).map(|i| 0.5 + 0.3 * i as f64).collect();
        TreeFactor { parent, start, l, inverse_diagonal, column: Vec::new() }
    }

    fn dense(factor: &TreeFactor) -> nalgebra::DMatrix<f64> {
        let n = factor.parent.len();
        let mut l = nalgebra::DMatrix::identity(n, n);
        for dof in 0..n {
            let mut at = factor.parent[dof];
            for value in factor.row(dof) {
                let i = at.expect("an ancestor for each entry");
                l[(dof, i)] = *value;
                at = factor.parent[i];
            }
        }
        let d = nalgebra::DVector::from_iterator(n, factor.inverse_diagonal.iter().map(|d| 1.0 / d));
        l.transpose() * nalgebra::DMatrix::from_diagonal(&d) * l
    }

    #[test]
    fn strengthening_adds_to_one_diagonal_entry() {
        let mut factor = tree();
        let mut expected = dense(&factor);
        for (dof, x) in [(3, 2.0), (1, 1e5), (5, 0.0), (4, 0.7)] {
            factor.strengthen(dof, x);
            expected[(dof, dof)] += x;
            assert!((dense(&factor) - &expected).amax() < 1e-9 * expected.amax());
        }
    }

    #[test]
    fn forward_and_backward_solve() {
        let factor = tree();
        let b: Vec<f64> = (0..6).map(|i| (0.7 * i as f64).cos()).collect();
        let mut columns: Vec<f64> = b.iter().flat_map(|b| [0.0, *b, -2.0 * b, 0.0]).collect();
        factor.forward(&mut columns, 4);
        for (column, scale) in [(0, 0.0), (1, 1.0), (2, -2.0)] {
            let mut x: Vec<f64> = columns.iter().skip(column).step_by(4).copied().collect();
            let mut one: Vec<f64> = b.iter().map(|b| scale * b).collect();
            factor.forward_one(&mut one);
            assert!(one.iter().zip(&x).all(|(one, x)| (one - x).abs() < 1e-14));
            factor.backward(&mut x);
            let product = dense(&factor) * nalgebra::DVector::from_vec(x);
            assert!(product.iter().zip(&b).all(|(p, b)| (p - scale * b).abs() < 1e-12));
        }
    }
}
