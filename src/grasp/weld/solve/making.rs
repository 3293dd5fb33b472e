//! The weld's rows of a step: the contacts' impedances, merged, and what they make of the Jacobian.

use super::{MergedSolver, Scratch};
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::softness::SolverOptions;
use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::grasp::weld::bilateral::BilateralContact;
use crate::grasp::weld::impedance::{
    ROWS, condim, dof_motion, for_each_dof, for_each_dof_below, link_motion, reference_point, row_wrench,
};
use crate::grasp::weld::rows::{WELD_ROWS, regularise};
use crate::grasp::weld::six::{mean_distance, subtract, turn, turn_matrix};
use crate::mujoco::Simulation;
use nalgebra::{Matrix6, Vector3, Vector6};

/// Resistance to the change of a friction force, relative to the finger's own mobility along it. What it leaves of an
/// error is gone once the force is steady.
const RESISTANCE: f64 = 1e-3;
/// Resistance of the rows that a contact does not have (beyond its condim), relative to the bodies' mobility: enough to
/// say how the merged part turns where the contacts leave it free, too little to be felt where they do not.
const ABSENT: f64 = 1e8;
/// Least lever by which a mobility against forces becomes one against torques \[m\].
const LEAST_LEVER: f64 = 1e-3;

impl MergedSolver {
    /// Merges the contacts and fills the weld's rows `rows`, after the engine has made them.
    pub(in crate::grasp) fn write_rows(
        &mut self,
        sim: &mut Simulation,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
        rigid: &mut usize,
        bounded: &mut usize,
    ) -> Result<(), Error> {
        self.place_frame(sim);
        self.merge(sim, topology, options, contacts);
        if !self.merged.finish() {
            return Err(Error::Diverged { time: sim.time(), what: "the impedance of the merged effectors" });
        }
        let rows = self.bounded.map(|b| {
            let next = if b { &mut *bounded } else { &mut *rigid };
            *next += 1;
            *next - 1
        });
        self.rows = Some(rows);
        self.since = Vector6::zeros();
        let to_axes = self.frame.transpose();
        let regularisation = regularise(&turn_matrix(&to_axes, &self.merged.softness()));
        self.excess = regularisation.1;
        self.fill_jacobian(sim, topology, contacts);
        let nv = sim.model().nv();
        for (axis, &row) in rows.iter().enumerate() {
            sim.set_row_jacobian(row, &self.scratch.jacobian[axis * nv..(axis + 1) * nv])?;
            sim.set_row_position(row, 0.0)?;
            // no spring and no damper of the row's own: its reference is set outright, in `load`
            sim.set_row_kbip(row, [0.0, 0.0, 0.5, 0.0])?;
            sim.set_row_regularization(row, regularisation.0[axis])?;
        }
        Ok(())
    }

    /// Impedances of all contacts, finger by finger.
    fn merge(&mut self, sim: &Simulation, topology: &Topology, options: &SolverOptions, contacts: &[GraspContact]) {
        let lever = mean_distance(contacts).max(LEAST_LEVER);
        self.merged.begin(self.fingers.base());
        self.order.clear();
        self.bilateral.clear();
        let Scratch { group, mobility, base, maps, resistances, .. } = &mut self.scratch;
        for finger in std::iter::once(None).chain((0..self.fingers.count()).map(Some)) {
            group.clear();
            group.extend((0..contacts.len()).filter(|&i| contacts[i].finger == finger));
            if group.is_empty() {
                continue;
            }
            self.fingers.mobility(sim, topology, finger, (contacts, group), mobility, base);
            maps.clear();
            resistances.clear();
            let n: usize = group.iter().map(|&i| condim(&contacts[i])).sum();
            let mut at = 0;
            for &i in &*group {
                let c = &contacts[i];
                let law = BilateralContact::of(c, options, &self.memory);
                for row in 0..ROWS {
                    maps.push(row_wrench(c, row, &self.com));
                    let bodies = c.parameters.inverse_weight / if row < 3 { 1.0 } else { lever * lever };
                    resistances.push(match row {
                        0 => law.resistance,
                        _ if row < condim(c) => RESISTANCE * bodies.max(mobility[(at + row) * (n + 1)]),
                        _ => ABSENT * bodies,
                    });
                }
                at += condim(c);
                self.bilateral.push(law);
                self.order.push(i);
            }
            let coupled = group.iter().enumerate().flat_map(|(k, &i)| ROWS * k..ROWS * k + condim(&contacts[i]));
            self.merged.add_finger(mobility, base, maps, resistances, coupled);
        }
    }

    /// `J_g`: target minus merged part, in the rows' axes; 6 x nv.
    fn fill_jacobian(&mut self, sim: &Simulation, topology: &Topology, contacts: &[GraspContact]) {
        let nv = sim.model().nv();
        let to_axes = self.frame.transpose();
        let jacobian = &mut self.scratch.jacobian;
        jacobian.clear();
        jacobian.resize(WELD_ROWS * nv, 0.0);
        let target = self.target.index();
        let arm = self.com - reference_point(sim, target);
        for_each_dof(sim, topology, target, |dof| {
            let axis = &sim.cdof()[6 * dof..6 * dof + 6];
            let rotation = Vector3::from_column_slice(&axis[..3]);
            let translation = Vector3::from_column_slice(&axis[3..]) + rotation.cross(&arm);
            let (linear, angular) = (to_axes * translation, to_axes * rotation);
            for i in 0..3 {
                jacobian[i * nv + dof] += linear[i];
                jacobian[(i + 3) * nv + dof] += angular[i];
            }
        });
        // the joints that carry the palm move all links alike: one map for all of them
        let (carrying, mut of_all) = (topology.leaf(topology.palm()), Matrix6::zeros());
        for (block, &i) in self.order.iter().enumerate() {
            let map = link_motion(sim, &contacts[i], |row| turn(&to_axes, self.merged.share(ROWS * block + row)));
            of_all += map;
            for_each_dof_below(sim, topology.leaf(contacts[i].link), carrying, |dof| {
                subtract(jacobian, nv, dof, &(map * dof_motion(sim, dof)));
            });
        }
        for_each_dof_below(sim, carrying, None, |dof| subtract(jacobian, nv, dof, &(of_all * dof_motion(sim, dof))));
    }
}
