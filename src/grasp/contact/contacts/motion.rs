//! How the two bodies of a contact move there, and what of that the next step on frozen geometry takes on.

use super::{GraspContact, WarmStart};
use crate::grasp::cones::inverse_inertia::Dynamics;
use crate::grasp::linalg::Spatial;
use crate::mujoco::Simulation;
use nalgebra::Vector3;

impl GraspContact {
    /// Rotation and translation of the target at the contact, relative to the link's, from those of both bodies about their
    /// reference points.
    pub(in crate::grasp) fn relative(
        &self,
        dynamics: &Dynamics<'_>,
        hand: &Spatial,
        target: &Spatial,
    ) -> [Vector3<f64>; 2] {
        let at_contact = |of: &Spatial, body: usize| {
            let [turn, move_] = parts(of);
            [turn, move_ + turn.cross(&(self.position - dynamics.reference_point(body)))]
        };
        let ([t0, t1], [h0, h1]) = (at_contact(target, self.target), at_contact(hand, self.link));
        [t0 - h0, t1 - h1]
    }

    /// Rotation and translation of the target relative to the link at the contact, per second.
    pub(in crate::grasp) fn velocity(&self, dynamics: &Dynamics<'_>) -> [Vector3<f64>; 2] {
        let [hand, target] = [self.link, self.target].map(|body| dynamics.velocity(body));
        let [turn, move_] = self.relative(dynamics, &hand, &target);
        [turn + self.drift[0], move_ + self.drift[1]]
    }

    /// `dJ/dt qvel` of that: the material points' acceleration while no joint accelerates.
    fn turning(&self, dynamics: &Dynamics<'_>) -> [Vector3<f64>; 2] {
        let [hand, target] = self.leaves.map(|leaf| dynamics.turning(leaf));
        let [turn, move_] = self.relative(dynamics, &hand, &target);
        let swing = |body: usize| {
            let [turn, move_] = parts(&dynamics.velocity(body));
            turn.cross(&(move_ + turn.cross(&(self.position - dynamics.reference_point(body)))))
        };
        [turn, move_ + swing(self.target) - swing(self.link)]
    }

    /// One step on frozen geometry later, after the velocities: the surfaces have moved, the relative velocity has changed with
    /// what the joints' axes have turned, and the last step's forces are what is remembered.
    pub(in crate::grasp) fn resume(&mut self, dynamics: &Dynamics<'_>, timestep: f64) {
        let turning = self.turning(dynamics);
        self.drift.iter_mut().zip(turning).for_each(|(drift, rate)| *drift += rate * timestep);
        let [_, velocity] = self.velocity(dynamics);
        self.parameters.dist += timestep * self.axes[0].dot(&velocity);
        self.solved = false;
        let mut friction = [0.0; 5];
        friction.copy_from_slice(&self.force_rows[1..]);
        let mut correction = friction;
        correction.iter_mut().zip(&self.main[1..]).for_each(|(correction, main)| *correction -= main);
        let (main, active_sets) = (self.main, self.active_sets);
        self.warm_start = Some(WarmStart { main, friction, correction: Some(correction), active_sets });
    }

    /// The same contact with the last step's forces; `None` for a new one.
    pub(in crate::grasp) fn with_last_forces(&self) -> Option<GraspContact> {
        let memory = self.warm_start()?;
        let mut contact = self.clone();
        contact.force_rows[0] = memory.main[0];
        contact.force_rows[1..].copy_from_slice(&memory.friction);
        contact.update_force();
        Some(contact)
    }

    /// Tangential velocity of the target relative to the link, from the bodies' present velocities \[m/s\].
    pub(super) fn slip(&self, sim: &Simulation) -> Vector3<f64> {
        let velocity =
            point_velocity(sim, self.target, &self.position) - point_velocity(sim, self.link, &self.position);
        let n = &self.axes[0];
        velocity - n * n.dot(&velocity)
    }
}

/// Rotation and translation.
fn parts(of: &Spatial) -> [Vector3<f64>; 2] {
    [Vector3::new(of[0], of[1], of[2]), Vector3::new(of[3], of[4], of[5])]
}

/// Velocity of the material point of `body` at `point`, world axes \[m/s\].
fn point_velocity(sim: &Simulation, body: usize, point: &Vector3<f64>) -> Vector3<f64> {
    let twist = &sim.cvel()[6 * body..6 * body + 6];
    let root = sim.model().body_rootid()[body] as usize;
    let reference = Vector3::from_column_slice(&sim.subtree_com()[3 * root..3 * root + 3]);
    let (turn, move_) = (Vector3::from_column_slice(&twist[..3]), Vector3::from_column_slice(&twist[3..]));
    move_ + turn.cross(&(point - reference))
}
