//! Jacobian rows of a contact in whitened accelerations.
//!
//! MuJoCo factors the mass matrix as `M = L^T D L` along the kinematic tree. With `z = D^1/2 L (a - a_smooth)` the
//! inertial cost of a motion is `1/2 |z|^2`, and a row `J` of a Jacobian becomes `Y = J L^-1 D^-1/2`. `L` only couples a
//! joint to its ancestors, so `Y` has entries for the joints between a contact and the world and no others.

use super::arrow::RowsMut;
use super::dense;
use super::topology::{Slot, Topology};
use nalgebra::Vector3;

/// The engine's state that rows are made of; slices as in MuJoCo's `mjModel` and `mjData`.
#[derive(Clone, Copy, Debug)]
pub struct Dynamics<'a> {
    /// Parent of each degree of freedom, -1 at the base.
    pub dof_parent: &'a [i32],
    /// Address of each row's diagonal in `factor`; the ancestors' entries follow it, the nearest first.
    pub dof_address: &'a [i32],
    /// `L` and `D` of the mass matrix (`qLD`).
    pub factor: &'a [f64],
    /// `1 / D` (`qLDiagInv`).
    pub inverse_diagonal: &'a [f64],
    /// Motion axis of each degree of freedom, rotation then translation, about its tree's centre of mass.
    pub dof_axis: &'a [f64],
    /// Root body of each body's tree.
    pub body_root: &'a [i32],
    /// Centre of mass of each body's subtree, world.
    pub subtree_com: &'a [f64],
    /// Generalised velocity.
    pub velocity: &'a [f64],
    /// Generalised acceleration without constraint forces.
    pub acceleration: &'a [f64],
}

impl Dynamics<'_> {
    /// Centre of mass of the tree that `body` belongs to: where its axes are expressed [m].
    pub fn reference_point(&self, body: usize) -> Vector3<f64> {
        let root = self.body_root[body] as usize;
        Vector3::from_column_slice(&self.subtree_com[3 * root..3 * root + 3])
    }

    fn axis(&self, dof: usize) -> (Vector3<f64>, Vector3<f64>) {
        let axis = &self.dof_axis[6 * dof..6 * dof + 6];
        (Vector3::from_column_slice(&axis[..3]), Vector3::from_column_slice(&axis[3..]))
    }
}

/// A direction in which a contact acts: a force along `force` and a torque `torque` about the world's axes, both of
/// unit intensity, at the contact's position.
#[derive(Clone, Copy, Debug)]
pub struct Direction {
    /// Force part.
    pub force: Vector3<f64>,
    /// Torque part.
    pub torque: Vector3<f64>,
}

/// The directions of a contact's rows in MuJoCo's order; `axes` are normal and tangents.
pub fn directions(axes: &[Vector3<f64>; 3], condim: usize) -> ([Direction; 6], usize) {
    let zero = Vector3::zeros();
    let mut out = [Direction { force: zero, torque: zero }; 6];
    for i in 0..3 {
        out[i].force = axes[i];
        out[i + 3].torque = axes[i];
    }
    (out, condim.clamp(1, 6))
}

/// Velocity and unconstrained acceleration of a contact's rows, target minus link.
#[derive(Clone, Copy, Debug, Default)]
pub struct RowState {
    /// `J v`, [m/s] and [rad/s].
    pub velocity: [f64; 6],
    /// `J a_smooth`, [m/s^2] and [rad/s^2].
    pub acceleration: [f64; 6],
}

/// Fills whitened rows; holds the scratch memory for it.
#[derive(Clone, Debug, Default)]
pub struct RowBuilder {
    chain: Vec<usize>,
    row: Vec<f64>,
}

impl RowBuilder {
    /// Adds one side of a contact to its rows: `sign` +1 for the target, -1 for the link on `body`.
    #[allow(clippy::too_many_arguments)]
    pub fn add_side(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        body: usize,
        sign: f64,
        position: &Vector3<f64>,
        directions: &[Direction],
        rows: &mut RowsMut<'_>,
        state: &mut RowState,
    ) {
        self.collect_chain(dynamics, topology, body);
        let n = self.chain.len();
        if n == 0 {
            return;
        }
        let count = directions.len();
        let root_size = rows.root.len() / count;
        let finger_size = rows.finger.len() / count;
        let arm = position - dynamics.reference_point(body);
        self.row.resize(n, 0.0);
        for (i, direction) in directions.iter().enumerate() {
            let turn = arm.cross(&direction.force) + direction.torque;
            let (mut velocity, mut acceleration) = (0.0, 0.0);
            for (value, &dof) in self.row.iter_mut().zip(&self.chain) {
                let (rotation, translation) = dynamics.axis(dof);
                *value = sign * (rotation.dot(&turn) + translation.dot(&direction.force));
                velocity += *value * dynamics.velocity[dof];
                acceleration += *value * dynamics.acceleration[dof];
            }
            state.velocity[i] += velocity;
            state.acceleration[i] += acceleration;
            self.whiten(dynamics);
            for (&value, &dof) in self.row.iter().zip(&self.chain) {
                match topology.slot(dof) {
                    Slot::Root(index) => rows.root[i * root_size + index] += value,
                    Slot::Finger { index, .. } => rows.finger[i * finger_size + index] += value,
                    Slot::Outside => {}
                }
            }
        }
    }

    /// Adds the generalised force of a wrench on `body` (force at `position`, torque; world axes) to `out`.
    pub fn add_force(
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        body: usize,
        position: &Vector3<f64>,
        force: &Vector3<f64>,
        torque: &Vector3<f64>,
        out: &mut [f64],
    ) {
        let turn = (position - dynamics.reference_point(body)).cross(force) + torque;
        let mut dof = topology.leaf(body);
        while let Some(i) = dof {
            let (rotation, translation) = dynamics.axis(i);
            out[i] += rotation.dot(&turn) + translation.dot(force);
            dof = usize::try_from(dynamics.dof_parent[i]).ok();
        }
    }

    fn collect_chain(&mut self, dynamics: &Dynamics<'_>, topology: &Topology, body: usize) {
        self.chain.clear();
        let mut dof = topology.leaf(body);
        while let Some(i) = dof {
            self.chain.push(i);
            dof = usize::try_from(dynamics.dof_parent[i]).ok();
        }
    }

    /// `row <- row L^-1 D^-1/2`, from the leaf to the base.
    fn whiten(&mut self, dynamics: &Dynamics<'_>) {
        let n = self.chain.len();
        for k in 0..n {
            let dof = self.chain[k];
            let address = dynamics.dof_address[dof] as usize;
            let ancestors = n - k - 1;
            let value = self.row[k];
            let factors = &dynamics.factor[address + 1..address + 1 + ancestors];
            dense::axpy(-value, factors, &mut self.row[k + 1..]);
            self.row[k] = value * dynamics.inverse_diagonal[dof].sqrt();
        }
    }
}
