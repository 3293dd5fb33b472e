//! What a run keeps of some of its steps, for pictures.

use nalgebra::Vector3;

use super::runner::Runner;
use crate::grasp::Grasp;
use crate::mujoco::BodyId;

/// The state that a step starts from, with the contacts and forces found there.
#[derive(Clone, Debug)]
pub struct Moment {
    /// \[s\]
    pub time: f64,
    /// Position of every joint.
    pub qpos: Vec<f64>,
    /// Contacts between hands and targets that press.
    pub contacts: Vec<Pressing>,
}

/// A contact that presses on a target.
#[derive(Clone, Copy, Debug)]
pub struct Pressing {
    /// Index of the grasp.
    pub grasp: usize,
    /// Palm, or a link below it.
    pub link: BodyId,
    /// Midpoint between the two surfaces, in the world \[m\].
    pub position: Vector3<f64>,
    /// Force on the target, world axes \[N\].
    pub force: Vector3<f64>,
    /// \[N\]
    pub normal_force: f64,
    /// Size of the tangential force \[N\].
    pub friction: f64,
    /// Friction over its limit, see [`GraspContact::friction_share`](crate::grasp::GraspContact::friction_share).
    pub share: Option<f64>,
}

/// The contacts that press in the step that `runner` has just made.
pub(super) fn pressing(runner: &Runner) -> Vec<Pressing> {
    let cone = runner.sim().model().cone();
    let of_grasp = |(index, grasp): (usize, &Grasp)| {
        let pressing = grasp.contacts().iter().filter(|c| c.normal_force() > 0.0);
        pressing
            .map(|c| Pressing {
                grasp: index,
                link: c.link_id,
                position: c.position,
                force: c.force,
                normal_force: c.normal_force(),
                friction: c.force_rows[1].hypot(c.force_rows[2]),
                share: c.friction_share(cone),
            })
            .collect::<Vec<_>>()
    };
    runner.grasps().iter().enumerate().flat_map(of_grasp).collect()
}
