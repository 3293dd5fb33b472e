//! The forms "box" and "rigid": a weld between the target and the merged effectors, with or without bounds.
//!
//! Each contact follows MuJoCo's own law with its rows kept bilateral, `J a + R f = aref`: the normal with its spring
//! and softness; friction held without softness, by a small resistance to the *change* of its force. Merged (see
//! [`MergedHand`]), the contacts of a step are one motion of six axes, whose weld rows are solved with everything else, and an
//! internal force with a closed form. While no contact slides or opens, that is the engine's own solution.
//!
//! All references are velocities, except the normals' springs, so a row at its bound has nothing to spring back to.

use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::contact::contacts::{GraspContact, Turning};
use crate::grasp::contact::cost::ActiveSet;
use crate::grasp::contact::softness::{SolverOptions, softness};
use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::grasp::linalg::Spatial;
use crate::grasp::spec::GraspSpec;
use crate::grasp::weld::bilateral::{BilateralContact, SavedBilateral, normal_resistance};
use crate::grasp::weld::bounds::Bounds;
use crate::grasp::weld::impedance::{Fingers, ROWS, dof_motion, for_each_dof, motion, reference_point};
use crate::grasp::weld::merged_hand::MergedHand;
use crate::grasp::weld::rows::WELD_ROWS;
use crate::grasp::weld::six::turn;
use crate::grasp::weld::soft_axes::{SoftAxes, SoftMemory};
use crate::mujoco::{BodyId, CompiledModel, Simulation};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

mod making;

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
    /// How far the target has moved against the palm on frozen geometry, in the rows' axes.
    since: Vector6<f64>,
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
    turning: Turning,
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
            since: Vector6::zeros(),
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
        let (dynamics, target) = (Dynamics::of(sim), self.target.index());
        let velocity = motion(sim, topology, target, sim.qvel());
        let acceleration = motion(sim, topology, target, sim.qacc());
        let mut wrench = Vector6::zeros();
        for c in contacts {
            let soft = softness(&c.parameters, options);
            let along_normal = |of_target: &Spatial, rates: &[f64]| {
                let of_link = motion(sim, topology, c.link, rates);
                c.along_row(0, &c.relative(&dynamics, [&of_link, of_target]))
            };
            let v = along_normal(&velocity, sim.qvel());
            let a = along_normal(&acceleration, sim.qacc());
            let force = normal_resistance(c, options, soft.regularisation) * c.force_rows[0];
            self.memory.push(SavedBilateral::of(c, a + force + soft.damping * v + soft.spring));
            let on_target = c.wrench_about(&self.com);
            wrench += Vector6::new(on_target[3], on_target[4], on_target[5], on_target[0], on_target[1], on_target[2]);
        }
        self.wrench = turn(&self.frame.transpose(), &wrench);
        self.soft.begin(self.pose(sim), self.wrench, contacts);
        self.bounds = Bounds::of(contacts.iter().map(|c| c.loaded()));
    }

    /// One step on frozen geometry later, before [`load`](Self::load): the contacts have moved on.
    pub(in crate::grasp) fn resume(&mut self, sim: &Simulation, topology: &Topology, contacts: &mut [GraspContact]) {
        let (dynamics, options) = (Dynamics::of(sim), SolverOptions::of(sim.model()));
        let turning = &mut self.scratch.turning;
        turning.forget();
        for (law, &i) in self.bilateral.iter_mut().zip(&self.order) {
            contacts[i].resume(&dynamics, turning, options.timestep);
            law.resume(&contacts[i], &options);
        }
        if self.soft.any() {
            let [_, velocity] = self.motion_in_palm(sim, topology);
            self.since += velocity * options.timestep;
        }
    }

    /// The rows that were made are no longer there.
    pub(in crate::grasp) fn forget_rows(&mut self) {
        self.rows = None;
    }

    /// Whether there are rows, for a [`resume`](Self::resume).
    pub(in crate::grasp) fn has_rows(&self) -> bool {
        self.rows.is_some()
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
        for (&i, internal) in self.order.iter().zip(self.internal.chunks_exact(ROWS)) {
            let c = &contacts[i];
            let along = |rows: &[f64]| c.axes[0] * rows[0] + c.axes[1] * rows[1] + c.axes[2] * rows[2];
            let (push, spin) = (along(&internal[..3]), along(&internal[3..]));
            let torque = (c.position - reference_point(sim, c.link)).cross(&push) + spin;
            let wrench = Spatial::new(torque.x, torque.y, torque.z, push.x, push.y, push.z);
            for_each_dof(sim, topology, c.link, |dof| out[dof] += dof_motion(sim, dof).dot(&wrench));
        }
        Ok(())
    }

    /// Fills `bias` with each row's reference and `internal` with the internal force.
    fn references(&mut self, sim: &Simulation, topology: &Topology, contacts: &[GraspContact]) {
        let dynamics = Dynamics::of(sim);
        let of_target = motion(sim, topology, self.target.index(), sim.qacc_smooth());
        let (mut link, mut of_link) = (None, Spatial::zeros());
        let Scratch { bias, resistances: resisted, .. } = &mut self.scratch;
        bias.clear();
        resisted.clear();
        for (block, &i) in self.order.iter().enumerate() {
            let (c, law) = (&contacts[i], &self.bilateral[block]);
            // contacts of one link follow each other, as a rule
            if link.replace(c.link) != Some(c.link) {
                of_link = motion(sim, topology, c.link, sim.qacc_smooth());
            }
            let (velocity, acceleration) = (c.velocity(&dynamics), c.relative(&dynamics, [&of_link, &of_target]));
            for row in 0..ROWS {
                let kept = if row == 0 {
                    law.offset - law.spring
                } else {
                    self.merged.resistance(ROWS * block + row) * law.friction[row]
                };
                let reference = kept - law.damping * c.along_row(row, &velocity);
                bias.push(reference);
                resisted.push(reference - c.along_row(row, &acceleration));
            }
        }
        self.merged.internal(resisted, &mut self.internal);
    }

    /// After the engine's solve: the contacts' forces from the rows' and the internal force, and the bounds for the next step.
    pub(in crate::grasp) fn read(&mut self, sim: &Simulation, contacts: &mut [GraspContact]) {
        let Some(rows) = self.rows else { return };
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
            let [[rx, ry, rz, x, y, z]] = motion(sim, topology, body, sim.qvel()).data.0;
            let (rotation, translation) = (Vector3::new(rx, ry, rz), Vector3::new(x, y, z));
            let v = translation + rotation.cross(&(self.com - reference_point(sim, body)));
            Vector6::new(v.x, v.y, v.z, rx, ry, rz)
        };
        let to_axes = self.frame.transpose();
        let palm = sim.body_quaternion(self.palm).to_rotation_matrix().into_inner();
        let velocity = at_com(self.target.index()) - at_com(self.palm.index());
        let displacement = turn(&(to_axes * palm), &self.soft.displacement(self.pose(sim)));
        [displacement + self.since, turn(&to_axes, &velocity)]
    }

    fn place_frame(&mut self, sim: &Simulation) {
        self.com = sim.subtree_com_of(self.target);
        self.frame = (sim.body_quaternion(self.target) * self.axes).to_rotation_matrix().into_inner();
    }
}
