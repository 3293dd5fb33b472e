//! The forms "box" and "rigid": a weld between the target and the merged effectors, with or without bounds.
//!
//! Each contact follows MuJoCo's own law with its rows kept bilateral, `J a + R f = aref`: the normal with its spring
//! and softness; friction held without softness, by a small resistance to the *change* of its force. MergedHand, the
//! contacts of a step are one motion of six axes, whose weld rows the engine solves with everything else, and a internal
//! with a closed form. While no contact slides or opens, that is the engine's own solution.
//!
//! All references are velocities, except the normals' springs, so a row at its bound has nothing to spring back to.

use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::cost::ActiveSet;
use crate::grasp::contact::softness::{SolverOptions, softness};
use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::grasp::spec::GraspSpec;
use crate::grasp::weld::bilateral::{BilateralContact, SavedBilateral, normal_resistance};
use crate::grasp::weld::bounds::Bounds;
use crate::grasp::weld::impedance::{Fingers, ROWS, for_each_dof, link_motion, motion, relative_rows, row_wrench};
use crate::grasp::weld::impedance::{condim, dof_motion, for_each_dof_below, power, reference_point};
use crate::grasp::weld::merged_hand::MergedHand;
use crate::grasp::weld::rows::{WELD_ROWS, regularise};
use crate::grasp::weld::six::{mean_distance, subtract, turn, turn_matrix};
use crate::grasp::weld::soft_axes::{SoftAxes, SoftMemory};
use crate::mujoco::{BodyId, CompiledModel, Simulation};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

/// Resistance to the change of a friction force, relative to the finger's own mobility along it. What it leaves of an
/// error is gone once the force is steady.
const RESISTANCE: f64 = 1e-3;
/// Resistance of the rows that a contact does not have (beyond its condim), relative to the bodies' mobility: enough to
/// say how the merged part turns where the contacts leave it free, too little to be felt where they do not.
const ABSENT: f64 = 1e8;
/// Least lever by which a mobility against forces becomes one against torques \[m\].
const LEAST_LEVER: f64 = 1e-3;

/// What stands in the weld's rows and why.
#[derive(Clone, Debug)]
pub(in crate::grasp) struct MergedSolver {
    target: BodyId,
    palm: BodyId,
    bounded: [bool; WELD_ROWS],
    axes: UnitQuaternion<f64>,
    fingers: Fingers,
    merged: MergedHand,
    /// Contacts in the order of their rows: palm first, then finger by finger.
    order: Vec<usize>,
    /// BilateralContact of each contact in that order.
    bilateral: Vec<BilateralContact>,
    memory: Vec<SavedBilateral>,
    /// Axes of the weld's rows, and the target's centre of mass.
    frame: Matrix3<f64>,
    com: Vector3<f64>,
    /// Constraint row of each axis; `None` while no rows are made.
    rows: Option<[usize; WELD_ROWS]>,
    /// What of the merged softness the rows' regularisation is too much, see [`regularise`].
    excess: Matrix6<f64>,
    /// Wrench across the grasp in the last step, on the target, in `frame`.
    wrench: Vector6<f64>,
    bounds: Bounds,
    soft: SoftAxes,
    internal: Vec<f64>,
    scratch: Scratch,
}

/// What a latched merged grasp hands on to the next step.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(in crate::grasp) struct MergedState {
    pub contacts: Vec<SavedBilateral>,
    pub wrench: Vector6<f64>,
    pub bounds: Bounds,
    pub soft: SoftMemory,
}

#[derive(Clone, Debug, Default)]
struct Scratch {
    group: Vec<usize>,
    mobility: Vec<f64>,
    base: Vec<f64>,
    maps: Vec<Vector6<f64>>,
    resistances: Vec<f64>,
    bias: Vec<f64>,
    jacobian: Vec<f64>,
}

impl MergedSolver {
    pub(in crate::grasp) fn new(model: &CompiledModel, topology: &Topology, spec: &GraspSpec) -> Self {
        let weights = model.body_invweight0();
        let of_both = |part: usize| weights[2 * spec.target.index() + part] + weights[2 * topology.palm() + part];
        MergedSolver {
            target: spec.target,
            palm: BodyId::from_index(topology.palm()),
            bounded: spec.bounded(),
            axes: spec.axes,
            fingers: Fingers::new(model, topology),
            merged: MergedHand::default(),
            order: Vec::new(),
            bilateral: Vec::new(),
            memory: Vec::new(),
            frame: Matrix3::identity(),
            com: Vector3::zeros(),
            rows: None,
            excess: Matrix6::zeros(),
            wrench: Vector6::zeros(),
            bounds: Bounds::default(),
            soft: SoftAxes::new(spec.softness(), std::array::from_fn(|axis| of_both(axis / 3))),
            internal: Vec::new(),
            scratch: Scratch::default(),
        }
    }

    /// Number of rows with bounds.
    pub(in crate::grasp) fn bounded_count(&self) -> usize {
        self.bounded.iter().filter(|b| **b).count()
    }

    /// Bounds that hold in the next step (thesis Eqs. 4.1 to 4.3).
    pub(in crate::grasp) fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Wrench that the weld's rows carried in the last step, on the target about its centre of mass, in the rows' axes.
    pub(in crate::grasp) fn wrench(&self) -> Vector6<f64> {
        self.wrench
    }

    /// What the next step remembers, into `out`.
    pub(in crate::grasp) fn save_into(&self, out: &mut MergedState) {
        out.contacts.clone_from(&self.memory);
        (out.wrench, out.bounds, out.soft) = (self.wrench, self.bounds, self.soft.memory());
    }

    /// The next step remembers `state`.
    pub(in crate::grasp) fn restore(&mut self, state: &MergedState) {
        self.memory.clone_from(&state.contacts);
        (self.wrench, self.bounds) = (state.wrench, state.bounds);
        self.soft.restore(state.soft);
        self.rows = None;
    }

    /// Takes over from the engine's contacts, after a step with their forces: the forces go on as they are.
    pub(in crate::grasp) fn begin(
        &mut self,
        sim: &Simulation,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
    ) {
        self.place_frame(sim);
        self.memory.clear();
        self.rows = None;
        let target = self.target.index();
        let velocity = motion(sim, topology, target, sim.qvel());
        let acceleration = motion(sim, topology, target, sim.qacc());
        let mut wrench = Vector6::zeros();
        for c in contacts {
            let soft = softness(&c.parameters, options);
            let link = motion(sim, topology, c.link, sim.qvel());
            let v = relative_rows(sim, c, &velocity, &link)[0];
            let link = motion(sim, topology, c.link, sim.qacc());
            let a = relative_rows(sim, c, &acceleration, &link)[0];
            let force = normal_resistance(c, options, soft.regularisation) * c.force_rows[0];
            self.memory.push(SavedBilateral::of(c, a + force + soft.damping * v + soft.spring));
            for row in 0..ROWS {
                wrench += row_wrench(c, row, &self.com) * c.force_rows[row];
            }
        }
        self.wrench = turn(&self.frame.transpose(), &wrench);
        self.soft.begin(self.pose(sim), self.wrench, contacts);
        self.bounds = Bounds::of(contacts.iter().map(|c| c.loaded()));
    }

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

    /// Once the smooth accelerations are known: sets the rows' references and bounds, and adds the internal force to the
    /// generalised force `out`.
    pub(in crate::grasp) fn load(
        &mut self,
        sim: &mut Simulation,
        topology: &Topology,
        contacts: &[GraspContact],
        out: &mut [f64],
    ) -> Result<(), Error> {
        let Some(rows) = self.rows else { return Ok(()) };
        let options = SolverOptions::of(sim.model());
        self.references(sim, topology, contacts);
        let bias = &mut self.scratch.bias;
        for (row, (x, f)) in bias.iter_mut().zip(&self.internal).enumerate() {
            *x += self.merged.resistance(row) * f;
        }
        let mut reference = turn(&self.frame.transpose(), &self.merged.merge(bias)) + self.excess * self.wrench;
        let [displacement, velocity] =
            if self.soft.any() { self.motion_in_palm(sim, topology) } else { Default::default() };
        for (axis, &row) in rows.iter().enumerate() {
            let bound = self.bounded[axis].then(|| self.bounds.axis(axis));
            let motion = (displacement[axis], velocity[axis]);
            if let Some((regularisation, soft)) = self.soft.row(axis, motion, bound, &options) {
                sim.set_row_regularization(row, regularisation)?;
                reference[axis] = soft;
            }
            if !reference[axis].is_finite() {
                return Err(Error::Diverged { time: sim.time(), what: "the reference of the merged effectors" });
            }
            sim.set_row_reference(row, reference[axis])?;
            if let Some(bound) = bound {
                sim.set_row_friction_limit(row, bound)?;
            }
        }
        for (block, &i) in self.order.iter().enumerate() {
            let c = &contacts[i];
            let point = reference_point(sim, c.link);
            let mut internal = Vector6::zeros();
            for row in 0..ROWS {
                internal += row_wrench(c, row, &point) * self.internal[ROWS * block + row];
            }
            let (push, torque) = (internal.fixed_rows::<3>(0).into(), internal.fixed_rows::<3>(3).into());
            for_each_dof(sim, topology, c.link, |dof| {
                out[dof] += power(&sim.cdof()[6 * dof..], &torque, &push);
            });
        }
        Ok(())
    }

    /// Fills `bias` with each row's reference and `internal` with the internal force.
    fn references(&mut self, sim: &Simulation, topology: &Topology, contacts: &[GraspContact]) {
        let target = self.target.index();
        let velocity = motion(sim, topology, target, sim.qvel());
        let acceleration = motion(sim, topology, target, sim.qacc_smooth());
        let Scratch { bias, resistances: resisted, .. } = &mut self.scratch;
        bias.clear();
        resisted.clear();
        for (block, &i) in self.order.iter().enumerate() {
            let (c, law) = (&contacts[i], &self.bilateral[block]);
            let link = motion(sim, topology, c.link, sim.qvel());
            let v = relative_rows(sim, c, &velocity, &link);
            let link = motion(sim, topology, c.link, sim.qacc_smooth());
            let a = relative_rows(sim, c, &acceleration, &link);
            for row in 0..ROWS {
                let kept = if row == 0 {
                    law.offset - law.spring
                } else {
                    self.merged.resistance(ROWS * block + row) * law.friction[row]
                };
                let reference = kept - law.damping * v[row];
                bias.push(reference);
                resisted.push(reference - a[row]);
            }
        }
        self.merged.internal(resisted, &mut self.internal);
    }

    /// After the engine's solve: the contacts' forces from the rows' and the internal force, and the bounds for the next step.
    pub(in crate::grasp) fn read(&mut self, sim: &Simulation, contacts: &mut [GraspContact]) {
        let Some(rows) = self.rows.take() else { return };
        self.wrench = Vector6::from_fn(|axis, _| sim.efc_force()[rows[axis]]);
        let wrench = turn(&self.frame, &self.wrench);
        let at_bound = |axis: usize| self.bounded[axis] && self.wrench[axis].abs() >= self.bounds.axis(axis);
        let active_set = if (0..WELD_ROWS).any(at_bound) { ActiveSet::Slide } else { ActiveSet::Stick };
        self.memory.clear();
        for (block, &i) in self.order.iter().enumerate() {
            let c = &mut contacts[i];
            for row in 0..ROWS {
                let at = ROWS * block + row;
                c.force_rows[row] = self.merged.share(at).dot(&wrench) - self.internal[at];
            }
            c.update_force();
            c.active_sets = [active_set; 2];
            self.memory.push(SavedBilateral::of(c, self.bilateral[block].offset));
        }
        self.bounds = Bounds::of(contacts.iter().map(|c| c.loaded()));
    }

    /// The target's centre of mass and orientation in the palm's frame.
    fn pose(&self, sim: &Simulation) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let palm = sim.body_quaternion(self.palm).inverse();
        (palm * (self.com - sim.body_position(self.palm)), palm * sim.body_quaternion(self.target))
    }

    /// Displacement of the target since the latch and velocity, against the palm, in the rows' axes.
    fn motion_in_palm(&self, sim: &Simulation, topology: &Topology) -> [Vector6<f64>; 2] {
        let at_com = |body: usize| {
            let [rx, ry, rz, x, y, z] = motion(sim, topology, body, sim.qvel());
            let (rotation, translation) = (Vector3::new(rx, ry, rz), Vector3::new(x, y, z));
            let v = translation + rotation.cross(&(self.com - reference_point(sim, body)));
            Vector6::new(v.x, v.y, v.z, rx, ry, rz)
        };
        let to_axes = self.frame.transpose();
        let palm = sim.body_quaternion(self.palm).to_rotation_matrix().into_inner();
        let velocity = at_com(self.target.index()) - at_com(self.palm.index());
        [turn(&(to_axes * palm), &self.soft.displacement(self.pose(sim))), turn(&to_axes, &velocity)]
    }

    fn place_frame(&mut self, sim: &Simulation) {
        self.com = sim.subtree_com_of(self.target);
        self.frame = (sim.body_quaternion(self.target) * self.axes).to_rotation_matrix().into_inner();
    }
}
