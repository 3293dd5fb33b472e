//! The engine's smooth dynamics as a grasp solve reads it.
//!
//! Spatial vectors are `[rotation; translation]` about the centre of mass of the body's kinematic tree, as MuJoCo's
//! `cdof` and `cvel`.

use crate::grasp::linalg::Spatial;
use crate::mujoco::{MassRows, Simulation};
use nalgebra::Vector3;

/// The engine's state that a grasp solve is made of; slices as in MuJoCo's `mjModel` and `mjData`.
#[derive(Clone, Copy, Debug)]
pub struct Dynamics<'a> {
    /// Parent of each degree of freedom, -1 at the base.
    pub dof_parent: &'a [i32],
    /// `L` of the mass matrix (`qLD`).
    pub factor: MassRows<'a>,
    /// The mass matrix.
    pub inertia: MassRows<'a>,
    /// `1 / D` (`qLDiagInv`).
    pub inverse_diagonal: &'a [f64],
    /// Motion axis of each degree of freedom (`cdof`).
    pub dof_axis: &'a [f64],
    /// How fast that turns (`cdof_dot`).
    pub axis_rate: &'a [f64],
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
            factor: sim.mass_factor(),
            inertia: sim.mass_rows(),
            inverse_diagonal: sim.qLDiagInv(),
            dof_axis: sim.cdof(),
            axis_rate: sim.cdof_dot(),
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
    pub fn ancestors_factor(&self, dof: usize) -> impl Iterator<Item = f64> {
        self.factor.ancestors(dof)
    }

    /// Parent of a degree of freedom.
    pub fn parent(&self, dof: usize) -> Option<usize> {
        usize::try_from(self.dof_parent[dof]).ok()
    }

    /// A degree of freedom and those before it, towards the base.
    pub fn with_ancestors(&self, dof: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(dof), |&dof| self.parent(dof))
    }

    /// The degrees of freedom that move either of two bodies, given the last of each, from the last to the first.
    pub fn chains(&self, leaves: [Option<usize>; 2]) -> impl Iterator<Item = usize> {
        let mut at = leaves;
        std::iter::from_fn(move || {
            let dof = at[0].max(at[1])?;
            at.iter_mut().filter(|next| **next == Some(dof)).for_each(|next| *next = self.parent(dof));
            Some(dof)
        })
    }
}
