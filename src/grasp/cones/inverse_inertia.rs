//! What a force moves: palm and target as six-axis mobilities, fingers as chains that hang from the palm.
//!
//! MuJoCo factors the mass matrix as `M = L^T D L` along the kinematic tree, and `L` couples a joint to its ancestors
//! only. So the acceleration of a body under a wrench on it, `J M^-1 J^T`, needs no joints but those between the body
//! and the world, and with the palm's acceleration as an unknown each finger needs no joints but its own.
//!
//! Spatial vectors are as in [`Dynamics`].

use crate::grasp::cones::arrow::Arrow;
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::hand::topology::Topology;
pub use crate::grasp::linalg::Spatial;
use crate::grasp::linalg::{LANES, Lanes};
use nalgebra::Matrix6;

/// Largest negative or zero pivot, relative to the largest diagonal, that counts as a direction without inverse inertia.
const RANK_TOLERANCE: f64 = 1e-12;

/// What is left of a row, relative to what it was, and is nothing but rounding: all that a finger does to a long arm it does
/// through the palm. Left in, it would tie all fingers to each other.
const ROUNDING: f64 = 1e-10;

/// Acceleration of one body under wrenches on it: `a = smooth + factor y`, where `1/2 |y|^2` is the inertial cost.
#[derive(Clone, Debug, Default)]
pub struct BodyInverseInertia {
    /// `factor factor^T = J M^-1 J^T`
    pub factor: Matrix6<f64>,
    /// Acceleration without constraint forces.
    pub smooth: Spatial,
    chain: Vec<usize>,
    /// Whitened axes of the chain's degrees of freedom, the columns of `J L^-1 D^-1/2`; of a chain that is longer than its
    /// rank, `factor^-1` times those, which are orthonormal rows.
    columns: Vec<Spatial>,
    /// See [`find_accelerations`](Self::find_accelerations).
    accelerations: Vec<Spatial>,
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
        self.factorize();
    }

    fn factorize(&mut self) {
        if self.columns.len() <= 6 {
            self.factor = Matrix6::zeros();
            for (k, column) in self.columns.iter().enumerate() {
                self.factor.set_column(k, column);
            }
            return;
        }
        let mut inverse_inertia = Matrix6::zeros();
        for column in &self.columns {
            inverse_inertia.ger(1.0, column, column, 1.0);
        }
        self.factor = semidefinite_factor(&inverse_inertia);
        let pivots: [f64; 6] = std::array::from_fn(|k| self.factor[(k, k)]);
        let inverse = pivots.map(|pivot| if pivot > 0.0 { 1.0 / pivot } else { 0.0 });
        self.columns.iter_mut().for_each(|column| forward(&self.factor, &inverse, column));
    }

    /// Updates the acceleration alone, where nothing has moved.
    pub fn accelerate(&mut self, dynamics: &Dynamics<'_>) {
        let sum = |sum, &dof: &usize| sum + dynamics.axis(dof) * dynamics.acceleration[dof];
        self.smooth = self.chain.iter().fold(Spatial::zeros(), sum);
    }

    /// Takes out of whitened rows what moves this body, into the body's own coordinates `y`, as many as its
    /// [rank](Self::rank); what stays in the rows leaves the body at rest.
    pub fn take(&self, rows: &mut [Lanes], y: &mut [Lanes]) {
        if self.columns.len() <= 6 {
            for (y, &dof) in y.iter_mut().zip(&self.chain) {
                *y = std::mem::take(&mut rows[dof]);
            }
            return;
        }
        let mut largest = [0.0; LANES];
        y.fill([0.0; LANES]);
        for (column, &dof) in self.columns.iter().zip(&self.chain) {
            let entries = rows[dof];
            if entries == [0.0; LANES] {
                continue;
            }
            for (y, c) in y.iter_mut().zip(column.iter()) {
                *y = std::array::from_fn(|k| y[k] + c * entries[k]);
            }
            largest = std::array::from_fn(|k| entries[k].abs().max(largest[k]));
        }
        if largest == [0.0; LANES] {
            return;
        }
        for (column, &dof) in self.columns.iter().zip(&self.chain) {
            let mut rest = rows[dof];
            for (y, c) in y.iter().zip(column.iter()) {
                rest = std::array::from_fn(|k| rest[k] - c * y[k]);
            }
            rows[dof] = std::array::from_fn(|k| if rest[k].abs() > ROUNDING * largest[k] { rest[k] } else { 0.0 });
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

    /// What a joint that the body carries resists as the body accelerates, per unit of `y`, into as many entries as its rank;
    /// `row` are the joint's entries in the mass matrix, for the chain's degrees of freedom.
    fn coupling(&self, row: impl Iterator<Item = f64>, out: &mut [f64]) {
        let sum = self.accelerations.iter().zip(row).fold(Spatial::zeros(), |sum, (a, m)| sum + a * m);
        let rank = self.rank();
        out[..rank].copy_from_slice(&sum.as_slice()[..rank]);
    }

    /// After [`update`](Self::update), of a body that carries others: what each degree of freedom of the chain accelerates by,
    /// per unit of `y`.
    pub fn find_accelerations(&mut self, dynamics: &Dynamics<'_>) {
        let n = self.chain.len();
        self.accelerations.clear();
        for (k, &dof) in self.chain.iter().enumerate() {
            // where the chain is no longer than its rank, `y` is of its joints
            let whitened = if n > 6 { self.columns[k] } else { Spatial::ith(k, 1.0) };
            self.accelerations.push(whitened * dynamics.inverse_diagonal[dof].sqrt());
        }
        for k in (0..n).rev() {
            let (done, ancestors) = self.accelerations.split_at_mut(k + 1);
            for (ancestor, l) in ancestors.iter().zip(dynamics.ancestors_factor(self.chain[k])) {
                done[k] -= ancestor * l;
            }
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

/// Solves `L y = x` in place for a factor of [`semidefinite_factor`] and the inverses of its pivots; zero along its zero columns.
fn forward(l: &Matrix6<f64>, inverse: &[f64; 6], x: &mut Spatial) {
    for j in 0..6 {
        x[j] *= inverse[j];
        for i in j + 1..6 {
            x[i] -= l[(i, j)] * x[j];
        }
    }
}

/// One finger's own joints, with the palm's acceleration prescribed.
#[derive(Clone, Debug, Default)]
pub struct FingerInverseInertia {
    dofs: Vec<usize>,
    /// Position in `dofs` of each joint's nearest ancestor within the finger.
    parents: Vec<Option<usize>>,
    axes: Vec<Spatial>,
    /// Acceleration relative to the palm of what each joint moves, without constraint forces.
    smooth: Vec<Spatial>,
}

impl FingerInverseInertia {
    /// The finger with these degrees of freedom, parents first.
    pub fn new(dofs: Vec<usize>, dof_parent: &[i32]) -> Self {
        let parents = dofs.iter().map(|&d| dofs.iter().position(|&p| p as i32 == dof_parent[d])).collect();
        FingerInverseInertia {
            axes: vec![Spatial::zeros(); dofs.len()],
            smooth: vec![Spatial::zeros(); dofs.len()],
            dofs,
            parents,
        }
    }

    /// Updates to the present state.
    pub fn update(&mut self, dynamics: &Dynamics<'_>) {
        for (axis, &dof) in self.axes.iter_mut().zip(&self.dofs) {
            *axis = dynamics.axis(dof);
        }
        self.accelerate(dynamics);
    }

    /// Updates the accelerations alone, where nothing has moved.
    pub fn accelerate(&mut self, dynamics: &Dynamics<'_>) {
        for (k, &dof) in self.dofs.iter().enumerate() {
            let before = self.parents[k].map_or(Spatial::zeros(), |parent| self.smooth[parent]);
            self.smooth[k] = before + self.axes[k] * dynamics.acceleration[dof];
        }
    }

    /// Sets the inertia of the joints in the present branch of `arrow`, among whose own unknowns they begin at `offset`: their
    /// coupling to the palm, and their part of the mass matrix.
    pub fn set_inertia(&self, dynamics: &Dynamics<'_>, palm: &BodyInverseInertia, arrow: &mut Arrow, offset: usize) {
        for (k, &dof) in self.dofs.iter().enumerate() {
            let ancestors = std::iter::successors(Some(k), |&k| self.parents[k]);
            palm.coupling(dynamics.inertia.row(dof).skip(ancestors.clone().count()), arrow.inertia_row(offset + k).0);
            for (j, entry) in ancestors.zip(dynamics.inertia.row(dof)) {
                arrow.inertia_row(offset + k).1[offset + j] = entry;
                arrow.inertia_row(offset + j).1[offset + k] = entry;
            }
        }
    }

    /// Acceleration of the link on `leaf` relative to the palm, without constraint forces.
    pub fn smooth_acceleration(&self, leaf: usize) -> Spatial {
        self.position(leaf).map_or(Spatial::zeros(), |k| self.smooth[k])
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
