//! How the two bodies of a contact move there, and what of that the next step on frozen geometry takes on.

use super::{GraspContact, WarmStart, spatial};
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::contact::cost::MAX_ROWS;
use crate::grasp::linalg::Spatial;
use nalgebra::Vector3;

/// How the axes of joints turn what they move, `dJ/dt qvel` by the last of these: the same for all contacts of one body.
#[derive(Clone, Debug, Default)]
pub(in crate::grasp) struct Turning(Vec<(Option<usize>, Spatial)>);

impl Turning {
    /// Nothing is known of a new step.
    pub fn forget(&mut self) {
        self.0.clear();
    }

    fn of(&mut self, dynamics: &Dynamics<'_>, leaf: Option<usize>) -> Spatial {
        if let Some((_, known)) = self.0.iter().find(|(of, _)| *of == leaf) {
            return *known;
        }
        let turning = dynamics.turning(leaf);
        self.0.push((leaf, turning));
        turning
    }
}

impl GraspContact {
    /// The wrenches of unit forces of each row, on the link and on the target, about the bodies' reference points; zero beyond
    /// the contact's rows.
    pub(in crate::grasp) fn unit_wrenches(&self, dynamics: &Dynamics<'_>) -> [[Spatial; 2]; MAX_ROWS] {
        let [hand, target] = [self.link, self.target].map(|body| dynamics.reference_point(body));
        let mut wrenches = [[Spatial::zeros(); 2]; MAX_ROWS];
        for (i, wrenches) in wrenches.iter_mut().enumerate().take(self.parameters.condim) {
            *wrenches = [-self.unit_wrench(i, &hand), self.unit_wrench(i, &target)];
        }
        wrenches
    }

    /// Rotation and translation, at the contact, of a body whose motion about its reference point is `of`.
    fn at_contact(&self, dynamics: &Dynamics<'_>, of: &Spatial, body: usize) -> [Vector3<f64>; 2] {
        let [turn, move_] = [Vector3::new(of[0], of[1], of[2]), Vector3::new(of[3], of[4], of[5])];
        [turn, move_ + turn.cross(&(self.position - dynamics.reference_point(body)))]
    }

    /// The same of the target less the link's.
    pub(in crate::grasp) fn relative(
        &self,
        dynamics: &Dynamics<'_>,
        [hand, target]: [&Spatial; 2],
    ) -> [Vector3<f64>; 2] {
        let (t, h) = (self.at_contact(dynamics, target, self.target), self.at_contact(dynamics, hand, self.link));
        [t[0] - h[0], t[1] - h[1]]
    }

    /// Rotation and translation of the target relative to the link at the contact, per second, from the bodies' present
    /// velocities.
    pub(in crate::grasp) fn velocity(&self, dynamics: &Dynamics<'_>) -> [Vector3<f64>; 2] {
        let [turn, move_] =
            self.relative(dynamics, [self.link, self.target].map(|body| dynamics.velocity(body)).each_ref());
        [turn + self.drift[0], move_ + self.drift[1]]
    }

    /// What of a rotation and translation of the target relative to the link is along row `i`.
    pub(in crate::grasp) fn along_row(&self, i: usize, motion: &[Vector3<f64>; 2]) -> f64 {
        self.axes[i % 3].dot(&motion[usize::from(i < 3)])
    }

    /// One step on frozen geometry later, after the velocities: the surfaces have moved, the relative velocity has changed with
    /// what the joints' axes have turned, and the last step's forces are what is remembered. Returns the
    /// [velocity](Self::velocity).
    pub(in crate::grasp) fn resume(
        &mut self,
        dynamics: &Dynamics<'_>,
        turning: &mut Turning,
        timestep: f64,
    ) -> [Vector3<f64>; 2] {
        let turning = self.leaves.map(|leaf| turning.of(dynamics, leaf));
        let [turning, swinging] = self.relative(dynamics, turning.each_ref());
        let [link, target] =
            [self.link, self.target].map(|body| self.at_contact(dynamics, &dynamics.velocity(body), body));
        // `dJ/dt qvel`: the material points' acceleration while no joint accelerates
        self.drift[0] += turning * timestep;
        self.drift[1] += (swinging + target[0].cross(&target[1]) - link[0].cross(&link[1])) * timestep;
        let velocity = [0, 1].map(|k| target[k] - link[k] + self.drift[k]);
        self.parameters.dist += timestep * self.axes[0].dot(&velocity[1]);
        self.solved = false;
        let mut friction = [0.0; 5];
        friction.copy_from_slice(&self.force_rows[1..]);
        let mut correction = friction;
        correction.iter_mut().zip(&self.main[1..]).for_each(|(correction, main)| *correction -= main);
        let GraspContact { main, active_sets, residual, .. } = *self;
        self.warm_start = Some(WarmStart { main, friction, correction: Some(correction), active_sets, residual });
        velocity
    }

    /// Adds what the contact's force adds to the generalised force with each further step, to first order in time: its point
    /// and normal go on as since the last reading, `elapsed` steps ago. With `dp` and `R` its way and rotation,
    /// `d(p x f) = dp x f + p x (R x f)`.
    pub(in crate::grasp) fn add_turn(&self, dynamics: &Dynamics<'_>, timestep: f64, elapsed: usize, out: &mut [f64]) {
        let [turn, move_] = self.displacement.unwrap_or_default().map(|since| since / elapsed as f64);
        let force_change = turn.cross(&self.force);
        let [on_link, on_target] = self.leaves;
        for (body, leaf, sign) in [(self.target, on_target, 1.0), (self.link, on_link, -1.0)] {
            let point = dynamics.reference_point(body);
            let arm = self.position - point;
            let torque_change = move_.cross(&self.force) + arm.cross(&force_change) + turn.cross(&self.torque);
            let wrench = self.wrench_about(&point) * sign;
            let change = spatial(&torque_change, &force_change) * sign;
            dynamics.add_wrench_change(leaf, [&wrench, &change], timestep, out);
        }
    }

    /// Tangential velocity of the target relative to the link, from the bodies' present velocities \[m/s\].
    pub(super) fn slip(&self, dynamics: &Dynamics<'_>) -> Vector3<f64> {
        let [_, velocity] = self.velocity(dynamics);
        let n = &self.axes[0];
        velocity - n * n.dot(&velocity)
    }
}
