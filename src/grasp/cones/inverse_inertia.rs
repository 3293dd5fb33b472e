//! What a force moves: palm and target as six-axis mobilities, fingers as chains that hang from the palm.
//!
//! MuJoCo factors the mass matrix as `M = L^T D L` along the kinematic tree, and `L` couples a joint to its ancestors
//! only. So the acceleration of a body under a wrench on it, `J M^-1 J^T`, needs no joints but those between the body
//! and the world, and with the palm's acceleration as an unknown each finger needs no joints but its own.
//!
//! Spatial vectors are `[rotation; translation]` about the centre of mass of the body's kinematic tree, as MuJoCo's
//! `cdof`, `crb` and `cvel`.

use crate::grasp::hand::topology::Topology;
pub use crate::grasp::linalg::Spatial;
use crate::mujoco::MassFactor;
use nalgebra::{Matrix6, Vector3};

/// Largest negative or zero pivot, relative to the largest diagonal, that counts as a direction without inverse inertia.
const RANK_TOLERANCE: f64 = 1e-12;

/// What is left of a row, relative to what it was, and is nothing but rounding: all that a finger does to a long arm it does
/// through the palm. Left in, it would tie all fingers to each other.
const ROUNDING: f64 = 1e-10;

/// The engine's state that a grasp solve is made of; slices as in MuJoCo's `mjModel` and `mjData`.
#[derive(Clone, Copy, Debug)]
pub struct Dynamics<'a> {
    /// Parent of each degree of freedom, -1 at the base.
    pub dof_parent: &'a [i32],
    /// Body of each degree of freedom.
    pub dof_body: &'a [i32],
    /// `L` of the mass matrix (`qLD`).
    pub factor: MassFactor<'a>,
    /// `1 / D` (`qLDiagInv`).
    pub inverse_diagonal: &'a [f64],
    /// Motion axis of each degree of freedom (`cdof`).
    pub dof_axis: &'a [f64],
    /// Inertia of each body with all that hangs on it (`crb`).
    pub composite_inertia: &'a [f64],
    /// Root body of each body's tree.
    pub body_root: &'a [i32],
    /// Centre of mass of each body's subtree, world.
    pub subtree_com: &'a [f64],
    /// Velocity of each body (`cvel`).
    pub body_velocity: &'a [f64],
    /// Generalised acceleration without constraint forces (`qacc_smooth`).
    pub acceleration: &'a [f64],
}

impl Dynamics<'_> {
    /// Centre of mass of the tree that `body` belongs to: the point that its spatial vectors refer to \[m\].
    pub fn reference_point(&self, body: usize) -> Vector3<f64> {
        let root = self.body_root[body] as usize;
        Vector3::from_column_slice(&self.subtree_com[3 * root..3 * root + 3])
    }

    /// Velocity of `body`.
    pub fn velocity(&self, body: usize) -> Spatial {
        Spatial::from_column_slice(&self.body_velocity[6 * body..6 * body + 6])
    }

    /// Motion axis of a degree of freedom.
    pub fn axis(&self, dof: usize) -> Spatial {
        Spatial::from_column_slice(&self.dof_axis[6 * dof..6 * dof + 6])
    }

    /// `L` entries of `dof` for its ancestors, the nearest first.
    fn ancestors_factor(&self, dof: usize) -> impl Iterator<Item = f64> {
        self.factor.ancestors(dof)
    }

    /// Parent of a degree of freedom.
    pub fn parent(&self, dof: usize) -> Option<usize> {
        usize::try_from(self.dof_parent[dof]).ok()
    }

    /// `x <- D^-1/2 L^-T x`: a row of a Jacobian in coordinates in which the mass matrix is the identity.
    pub fn whiten(&self, x: &mut [f64]) {
        for dof in (0..x.len()).rev() {
            let value = x[dof];
            if value == 0.0 {
                continue;
            }
            let mut ancestor = self.parent(dof);
            for l in self.ancestors_factor(dof) {
                let Some(j) = ancestor else { break };
                x[j] -= l * value;
                ancestor = self.parent(j);
            }
            x[dof] = value * self.inverse_diagonal[dof].sqrt();
        }
    }

    /// Momentum of the subtree at `dof` per unit of its velocity: `crb * cdof`, a column of the mass matrix in space.
    fn momentum(&self, dof: usize) -> Spatial {
        let body = self.dof_body[dof] as usize;
        let i = &self.composite_inertia[10 * body..10 * body + 10];
        let v = &self.dof_axis[6 * dof..6 * dof + 6];
        Spatial::new(
            i[0] * v[0] + i[3] * v[1] + i[4] * v[2] - i[8] * v[4] + i[7] * v[5],
            i[3] * v[0] + i[1] * v[1] + i[5] * v[2] + i[8] * v[3] - i[6] * v[5],
            i[4] * v[0] + i[5] * v[1] + i[2] * v[2] - i[7] * v[3] + i[6] * v[4],
            i[8] * v[1] - i[7] * v[2] + i[9] * v[3],
            i[6] * v[2] - i[8] * v[0] + i[9] * v[4],
            i[7] * v[0] - i[6] * v[1] + i[9] * v[5],
        )
    }
}

/// Acceleration of one body under wrenches on it: `a = smooth + factor y`, where `1/2 |y|^2` is the inertial cost.
#[derive(Clone, Debug, Default)]
pub struct BodyInverseInertia {
    /// `factor factor^T = J M^-1 J^T`
    pub factor: Matrix6<f64>,
    /// Acceleration without constraint forces.
    pub smooth: Spatial,
    chain: Vec<usize>,
    columns: Vec<Spatial>,
}

impl BodyInverseInertia {
    /// Updates to the present state, `leaf` being the last degree of freedom that moves the body.
    pub fn update(&mut self, dynamics: &Dynamics<'_>, leaf: Option<usize>) {
        self.chain.clear();
        self.columns.clear();
        self.smooth = Spatial::zeros();
        let mut dof = leaf;
        while let Some(i) = dof {
            let axis = dynamics.axis(i);
            self.smooth += axis * dynamics.acceleration[i];
            self.chain.push(i);
            self.columns.push(axis);
            dof = dynamics.parent(i);
        }
        self.whiten(dynamics);
        if self.columns.len() <= 6 {
            self.factor = Matrix6::zeros();
            for (k, column) in self.columns.iter().enumerate() {
                self.factor.set_column(k, column);
            }
        } else {
            let mut inverse_inertia = Matrix6::zeros();
            for column in &self.columns {
                inverse_inertia.ger(1.0, column, column, 1.0);
            }
            self.factor = semidefinite_factor(&inverse_inertia);
        }
    }

    /// Takes out of a whitened row what moves this body, and returns it in the body's own coordinates `y`; what stays in
    /// the row leaves the body at rest.
    pub fn take(&self, row: &mut [f64]) -> Spatial {
        if self.columns.len() <= 6 {
            let mut y = Spatial::zeros();
            for (y, &dof) in y.iter_mut().zip(&self.chain) {
                *y = std::mem::take(&mut row[dof]);
            }
            return y;
        }
        let mut moved = Spatial::zeros();
        let mut largest = 0.0f64;
        for (column, &dof) in self.columns.iter().zip(&self.chain) {
            moved += column * row[dof];
            largest = largest.max(row[dof].abs());
        }
        let y = forward(&self.factor, moved);
        let wrench = backward(&self.factor, y);
        for (column, &dof) in self.columns.iter().zip(&self.chain) {
            let rest = row[dof] - column.dot(&wrench);
            row[dof] = if rest.abs() > ROUNDING * largest { rest } else { 0.0 };
        }
        y
    }

    /// The degrees of freedom that move the body, from the nearest to the base.
    pub fn chain(&self) -> &[usize] {
        &self.chain
    }

    /// `J <- J L^-1 D^-1/2`, column by column from the leaf to the base.
    fn whiten(&mut self, dynamics: &Dynamics<'_>) {
        for k in 0..self.chain.len() {
            let dof = self.chain[k];
            let (done, ancestors) = self.columns.split_at_mut(k + 1);
            let column = &mut done[k];
            for (ancestor, l) in ancestors.iter_mut().zip(dynamics.ancestors_factor(dof)) {
                *ancestor -= *column * l;
            }
            *column *= dynamics.inverse_diagonal[dof].sqrt();
        }
    }
}

/// Lower factor of a positive semidefinite matrix; directions without inverse inertia give zero columns.
fn semidefinite_factor(a: &Matrix6<f64>) -> Matrix6<f64> {
    let floor = RANK_TOLERANCE * a.diagonal().max();
    let mut l = Matrix6::zeros();
    for j in 0..6 {
        let mut pivot = a[(j, j)];
        for k in 0..j {
            pivot -= l[(j, k)] * l[(j, k)];
        }
        if pivot <= floor {
            continue;
        }
        let root = pivot.sqrt();
        l[(j, j)] = root;
        for i in j + 1..6 {
            let mut sum = a[(i, j)];
            for k in 0..j {
                sum -= l[(i, k)] * l[(j, k)];
            }
            l[(i, j)] = sum / root;
        }
    }
    l
}

/// Solves `L y = x` for a factor of [`semidefinite_factor`]; zero along its zero columns.
fn forward(l: &Matrix6<f64>, mut x: Spatial) -> Spatial {
    for j in 0..6 {
        x[j] = if l[(j, j)] > 0.0 { x[j] / l[(j, j)] } else { 0.0 };
        for i in j + 1..6 {
            x[i] -= l[(i, j)] * x[j];
        }
    }
    x
}

/// Solves `L^T y = x` likewise.
fn backward(l: &Matrix6<f64>, mut x: Spatial) -> Spatial {
    for j in (0..6).rev() {
        for i in j + 1..6 {
            x[j] -= l[(i, j)] * x[i];
        }
        x[j] = if l[(j, j)] > 0.0 { x[j] / l[(j, j)] } else { 0.0 };
    }
    x
}

/// One finger's own joints, with the palm's acceleration prescribed.
#[derive(Clone, Debug, Default)]
pub struct FingerInverseInertia {
    dofs: Vec<usize>,
    /// Position in `dofs` of each joint's nearest ancestor within the finger.
    parents: Vec<Option<usize>>,
    axes: Vec<Spatial>,
    /// `L_f^-T F`, `F` the momentum of each joint: what holding the palm back costs.
    momenta: Vec<Spatial>,
}

impl FingerInverseInertia {
    /// The finger with these degrees of freedom, parents first.
    pub fn new(dofs: Vec<usize>, dof_parent: &[i32]) -> Self {
        let parents = dofs.iter().map(|&d| dofs.iter().position(|&p| p as i32 == dof_parent[d])).collect();
        FingerInverseInertia {
            axes: vec![Spatial::zeros(); dofs.len()],
            momenta: vec![Spatial::zeros(); dofs.len()],
            dofs,
            parents,
        }
    }

    /// Number of joints.
    pub fn len(&self) -> usize {
        self.dofs.len()
    }

    /// Updates to the present state.
    pub fn update(&mut self, dynamics: &Dynamics<'_>) {
        for (k, &dof) in self.dofs.iter().enumerate() {
            self.axes[k] = dynamics.axis(dof);
            self.momenta[k] = dynamics.momentum(dof);
        }
        for k in (0..self.dofs.len()).rev() {
            let factor = dynamics.ancestors_factor(self.dofs[k]);
            let momentum = self.momenta[k];
            let mut ancestor = self.parents[k];
            for l in factor {
                let Some(j) = ancestor else { break };
                self.momenta[j] -= momentum * l;
                ancestor = self.parents[j];
            }
        }
    }

    /// Acceleration of the link on `leaf` relative to the palm, without constraint forces.
    pub fn smooth_acceleration(&self, dynamics: &Dynamics<'_>, leaf: usize) -> Spatial {
        let mut out = Spatial::zeros();
        let mut at = self.position(leaf);
        while let Some(k) = at {
            out += self.axes[k] * dynamics.acceleration[self.dofs[k]];
            at = self.parents[k];
        }
        out
    }

    /// The row of a unit wrench on the link whose last joint is `leaf`: one whitened entry for each joint of the finger,
    /// the square of whose norm is the row's inverse inertia. Returns the wrench on the palm when the joints give way.
    pub fn row(&self, dynamics: &Dynamics<'_>, leaf: usize, wrench: &Spatial, whitened: &mut [f64]) -> Spatial {
        whitened.fill(0.0);
        let mut at = self.position(leaf);
        while let Some(k) = at {
            whitened[k] = self.axes[k].dot(wrench);
            at = self.parents[k];
        }
        *wrench + self.whiten(dynamics, leaf, whitened)
    }

    /// As [`row`](Self::row), of a force `entry` on the one joint `dof`.
    pub fn joint_row(&self, dynamics: &Dynamics<'_>, dof: usize, entry: f64, whitened: &mut [f64]) -> Spatial {
        whitened.fill(0.0);
        if let Some(k) = self.position(dof) {
            whitened[k] = entry;
        }
        self.whiten(dynamics, dof, whitened)
    }

    /// Whitens a row of forces on `leaf` and its ancestors; returns what their giving way leaves on the palm.
    fn whiten(&self, dynamics: &Dynamics<'_>, leaf: usize, whitened: &mut [f64]) -> Spatial {
        let mut palm = Spatial::zeros();
        let mut at = self.position(leaf);
        while let Some(k) = at {
            let dof = self.dofs[k];
            let value = whitened[k];
            let mut ancestor = self.parents[k];
            for l in dynamics.ancestors_factor(dof) {
                let Some(j) = ancestor else { break };
                whitened[j] -= l * value;
                ancestor = self.parents[j];
            }
            palm -= self.momenta[k] * (value * dynamics.inverse_diagonal[dof]);
            whitened[k] = value * dynamics.inverse_diagonal[dof].sqrt();
            at = self.parents[k];
        }
        palm
    }

    /// Adds the generalised force of a wrench on the link whose last joint is `leaf`.
    pub fn add_force(&self, leaf: usize, wrench: &Spatial, out: &mut [f64]) {
        let mut at = self.position(leaf);
        while let Some(k) = at {
            out[self.dofs[k]] += self.axes[k].dot(wrench);
            at = self.parents[k];
        }
    }

    fn position(&self, dof: usize) -> Option<usize> {
        // parents come first, so a finger's degrees of freedom ascend
        self.dofs.binary_search(&dof).ok()
    }
}

/// The mobilities of palm, fingers and target of one grasp.
#[derive(Clone, Debug)]
pub struct HandInverseInertia {
    /// The palm.
    pub palm: BodyInverseInertia,
    /// The target.
    pub target: BodyInverseInertia,
    /// The fingers.
    pub fingers: Vec<FingerInverseInertia>,
}

impl HandInverseInertia {
    /// For the hand and target of `topology`.
    pub fn new(topology: &Topology, dof_parent: &[i32]) -> Self {
        HandInverseInertia {
            palm: BodyInverseInertia::default(),
            target: BodyInverseInertia::default(),
            fingers: topology
                .fingers()
                .iter()
                .map(|dofs| FingerInverseInertia::new(dofs.clone(), dof_parent))
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests;
