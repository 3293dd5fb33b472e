//! What is recorded of a grasp in each step.

use nalgebra::Vector3;

use super::trajectory::Sample;
use crate::grasp::{Grasp, Phase};
use crate::mujoco::{BodyId, Simulation};

/// Measures one grasp.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    palm: BodyId,
    target: BodyId,
    /// Whether it was latched as the step began.
    grasped: bool,
    /// Body -> index among the links.
    link_of: Vec<Option<usize>>,
    normal_forces: Vec<f64>,
    /// Fastest slip of each link's contacts in this step, in the palm's axes \[m/s\].
    velocities: Vec<Vector3<f64>>,
    /// Slip of each link since `measure_from`, in the palm's axes \[m\].
    slip: Vec<Vector3<f64>>,
}

/// What a sample needs besides the state.
pub(super) struct Now {
    /// \[s\]
    pub time: f64,
    /// Wall-clock time of the step \[ns\].
    pub step_ns: u64,
    /// Time step, once slip counts.
    pub slipping: Option<f64>,
    /// The step was made on frozen geometry.
    pub frozen: bool,
}

impl Watch {
    pub(super) fn new(sim: &Simulation, grasp: &Grasp) -> Self {
        let model = sim.model();
        let (palm, target) = (grasp.palm(), grasp.target());
        let mut link_of = vec![None; model.nbody()];
        for (i, link) in grasp.links().iter().enumerate() {
            link_of[link.index()] = Some(i);
        }
        let n = grasp.links().len();
        let (normal_forces, velocities, slip) = (vec![0.0; n], vec![Vector3::zeros(); n], vec![Vector3::zeros(); n]);
        Self { palm, target, grasped: false, link_of, normal_forces, velocities, slip }
    }

    /// Normal force of each link in the last step \[N\].
    pub(super) fn normal_forces(&self) -> &[f64] {
        &self.normal_forces
    }

    /// Before a step.
    pub(super) fn begin(&mut self, grasp: &Grasp) {
        self.grasped = grasp.phase() == Phase::Grasped;
    }

    /// After it; `poses` has those of the state that it began in.
    pub(super) fn sample(&mut self, poses: &Simulation, grasp: &Grasp, at: &Now) -> Sample {
        let palm = poses.body_pose(self.palm);
        self.normal_forces.fill(0.0);
        self.velocities.fill(Vector3::zeros());
        let (mut touching, mut gripped, mut penetration) = (false, false, 0.0_f64);
        for contact in grasp.contacts() {
            touching = true;
            gripped |= contact.link_id != self.palm && contact.normal_force() > 0.0;
            penetration = penetration.max(-contact.parameters.dist);
            if let Some(link) = self.link_of[contact.link_id.index()] {
                self.normal_forces[link] += contact.normal_force();
                if contact.slip_velocity.norm_squared() > self.velocities[link].norm_squared() {
                    self.velocities[link] = palm.rotation.inverse_transform_vector(&contact.slip_velocity);
                }
            }
        }
        if let Some(step) = at.slipping {
            for (slip, velocity) in self.slip.iter_mut().zip(&self.velocities) {
                *slip += velocity * step;
            }
        }
        let target = palm.inv_mul(&poses.body_pose(self.target));
        Sample {
            time: at.time,
            position: target.translation.vector,
            rotation: target.rotation,
            grasped: self.grasped,
            frozen: self.grasped && at.frozen,
            quality: grasp.quality(),
            touching,
            gripped,
            penetration,
            slip: self.slip.iter().map(|s| s.norm()).fold(0.0, f64::max),
            step_ns: at.step_ns,
        }
    }
}
