//! What a force moves: palm and target as six-axis mobilities, fingers as chains that hang from the palm.
//!
//! MuJoCo factors the mass matrix as `M = L^T D L` along the kinematic tree, and `L` couples a joint to its ancestors
//! only. So the acceleration of a body under a wrench on it, `J M^-1 J^T`, needs no joints but those between the body
//! and the world, and with the palm's acceleration as an unknown each finger needs no joints but its own.
//!
//! Spatial vectors are `[rotation; translation]` about the centre of mass of the body's kinematic tree, as MuJoCo's
//! `cdof`, `crb` and `cvel`.

use crate::grasp::cones::arrow::Arrow;
use crate::grasp::hand::topology::Topology;
pub use crate::grasp::linalg::Spatial;
use crate::mujoco::{MassFactor, Simulation};
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
    /// How fast that turns (`cdof_dot`).
    pub axis_rate: &'a [f64],
    /// Inertia of each body with all that hangs on it (`crb`).
    pub composite_inertia: &'a [f64],
    /// Root body of each body's tree.
    pub body_root: &'a [i32],
    /// Centre of mass of each body's subtree, world.
    pub subtree_com: &'a [f64],
    /// Velocity of each body (`cvel`).
    pub body_velocity: &'a [f64],
    /// Generalised velocity (`qvel`).
    pub joint_velocity: &'a [f64],
    /// Generalised acceleration without constraint forces (`qacc_smooth`).
    pub acceleration: &'a [f64],
}

impl<'a> Dynamics<'a> {
    /// Of the engine's present state.
    pub fn of(sim: &'a Simulation) -> Self {
        let model = sim.model();
        Dynamics {
            dof_parent: model.dof_parentid(),
            dof_body: model.dof_bodyid(),
            factor: sim.mass_factor(),
            inverse_diagonal: sim.qLDiagInv(),
            dof_axis: sim.cdof(),
            axis_rate: sim.cdof_dot(),
            composite_inertia: sim.crb(),
            body_root: model.body_rootid(),
            subtree_com: sim.subtree_com(),
            body_velocity: sim.cvel(),
            joint_velocity: sim.qvel(),
            acceleration: sim.qacc_smooth(),
        }
    }

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

    /// Adds the generalised force of a wrench on what `leaf` moves last, about its reference point, to `out`.
    pub fn add_wrench(&self, leaf: Option<usize>, wrench: &Spatial, out: &mut [f64]) {
        for dof in leaf.into_iter().flat_map(|leaf| self.with_ancestors(leaf)) {
            out[dof] += self.axis(dof).dot(wrench);
        }
    }

    /// Adds to `out` what a wrench on what `leaf` moves last, about its reference point, adds to the generalised force in
    /// `time`, while it changes by `change` and the joints' axes turn.
    pub fn add_wrench_change(&self, leaf: Option<usize>, [wrench, change]: [&Spatial; 2], time: f64, out: &mut [f64]) {
        for dof in leaf.into_iter().flat_map(|leaf| self.with_ancestors(leaf)) {
            out[dof] += self.axis(dof).dot(change) + time * self.axis_rate(dof).dot(wrench);
        }
    }

    fn axis_rate(&self, dof: usize) -> Spatial {
        Spatial::from_column_slice(&self.axis_rate[6 * dof..6 * dof + 6])
    }

    /// Acceleration of what `leaf` moves while no joint accelerates, `dJ/dt qvel`.
    pub fn turning(&self, leaf: Option<usize>) -> Spatial {
        let dofs = leaf.into_iter().flat_map(|leaf| self.with_ancestors(leaf));
        dofs.fold(Spatial::zeros(), |sum, dof| sum + self.axis_rate(dof) * self.joint_velocity[dof])
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
            if x[dof] != 0.0 {
                self.whiten_at(dof, x);
            }
        }
    }

    /// As [`whiten`](Self::whiten), of a row with entries for `dof` and its ancestors only.
    pub fn whiten_chain(&self, dof: usize, x: &mut [f64]) {
        self.with_ancestors(dof).for_each(|dof| self.whiten_at(dof, x));
    }

    /// A degree of freedom and those before it, towards the base.
    pub fn with_ancestors(&self, dof: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(dof), |&dof| self.parent(dof))
    }

    fn whiten_at(&self, dof: usize, x: &mut [f64]) {
        let value = x[dof];
        let mut ancestor = self.parent(dof);
        for l in self.ancestors_factor(dof) {
            let Some(j) = ancestor else { break };
            x[j] -= l * value;
            ancestor = self.parent(j);
        }
        x[dof] = value * self.inverse_diagonal[dof].sqrt();
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
        let mut dof = leaf;
        while let Some(i) = dof {
            self.chain.push(i);
            self.columns.push(dynamics.axis(i));
            dof = dynamics.parent(i);
        }
        self.accelerate(dynamics);
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

    /// Updates the acceleration alone, where nothing has moved.
    pub fn accelerate(&mut self, dynamics: &Dynamics<'_>) {
        let sum = |sum, &dof: &usize| sum + dynamics.axis(dof) * dynamics.acceleration[dof];
        self.smooth = self.chain.iter().fold(Spatial::zeros(), sum);
    }

    /// Takes out of a whitened row what moves this body, into the body's own coordinates `y`, as many as its
    /// [rank](Self::rank); what stays in the row leaves the body at rest.
    pub fn take(&self, row: &mut [f64], y: &mut [f64]) {
        if self.columns.len() <= 6 {
            for (y, &dof) in y.iter_mut().zip(&self.chain) {
                *y = std::mem::take(&mut row[dof]);
            }
            return;
        }
        let mut moved = Spatial::zeros();
        let mut largest = 0.0f64;
        for (column, &dof) in self.columns.iter().zip(&self.chain) {
            moved += column * row[dof];
            largest = largest.max(row[dof].abs());
        }
        let taken = forward(&self.factor, moved);
        y.copy_from_slice(taken.as_slice());
        let wrench = backward(&self.factor, taken);
        for (column, &dof) in self.columns.iter().zip(&self.chain) {
            let rest = row[dof] - column.dot(&wrench);
            row[dof] = if rest.abs() > ROUNDING * largest { rest } else { 0.0 };
        }
    }

    /// Number of the body's own coordinates `y`; the factor's further columns are zero.
    pub fn rank(&self) -> usize {
        self.columns.len().min(6)
    }

    /// A wrench on the body in its own coordinates: `factor^T wrench`, into as many entries as its rank.
    #[inline]
    pub fn own(&self, wrench: &Spatial, out: &mut [f64]) {
        for (k, out) in out.iter_mut().take(self.rank()).enumerate() {
            *out = self.factor.column(k).dot(wrench);
        }
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
}

impl FingerInverseInertia {
    /// The finger with these degrees of freedom, parents first.
    pub fn new(dofs: Vec<usize>, dof_parent: &[i32]) -> Self {
        let parents = dofs.iter().map(|&d| dofs.iter().position(|&p| p as i32 == dof_parent[d])).collect();
        FingerInverseInertia { axes: vec![Spatial::zeros(); dofs.len()], dofs, parents }
    }

    /// Updates to the present state.
    pub fn update(&mut self, dynamics: &Dynamics<'_>) {
        for (axis, &dof) in self.axes.iter_mut().zip(&self.dofs) {
            *axis = dynamics.axis(dof);
        }
    }

    /// Sets the inertia of the joints in the present branch of `arrow`, among whose own unknowns they begin at `offset`: their
    /// coupling to the palm, and their part of the mass matrix, `M = L^T D L`.
    pub fn set_inertia(&self, dynamics: &Dynamics<'_>, palm: &BodyInverseInertia, arrow: &mut Arrow, offset: usize) {
        for (k, &dof) in self.dofs.iter().enumerate() {
            let (root, own) = arrow.inertia_row(offset + k);
            palm.own(&dynamics.momentum(dof), root);
            own[offset + k] = 0.0;
        }
        for (k, &dof) in self.dofs.iter().enumerate() {
            let d = 1.0 / dynamics.inverse_diagonal[dof];
            for (i, left) in self.factor_row(dynamics, k) {
                let (_, own) = arrow.inertia_row(offset + i);
                for (j, right) in self.factor_row(dynamics, k) {
                    own[offset + j] += d * left * right;
                }
            }
        }
    }

    /// Row `k` of the mass matrix' factor `L` within the finger: position and entry, the diagonal first.
    fn factor_row(&self, dynamics: &Dynamics<'_>, k: usize) -> impl Iterator<Item = (usize, f64)> {
        let chain = std::iter::successors(Some(k), |&k| self.parents[k]);
        chain.zip(std::iter::once(1.0).chain(dynamics.ancestors_factor(self.dofs[k])))
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

    /// The row of a wrench on the link whose last joint is `leaf`: its force on each of the joints before it, into one entry
    /// for each joint of the finger.
    pub fn row(&self, leaf: usize, wrench: &Spatial, out: &mut [f64]) {
        let mut at = self.position(leaf);
        while let Some(k) = at {
            out[k] = self.axes[k].dot(wrench);
            at = self.parents[k];
        }
    }

    /// Adds the generalised force of a wrench on the link whose last joint is `leaf`.
    pub fn add_force(&self, leaf: usize, wrench: &Spatial, out: &mut [f64]) {
        let mut at = self.position(leaf);
        while let Some(k) = at {
            out[self.dofs[k]] += self.axes[k].dot(wrench);
            at = self.parents[k];
        }
    }

    /// Position of a degree of freedom among the finger's.
    pub fn position(&self, dof: usize) -> Option<usize> {
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
