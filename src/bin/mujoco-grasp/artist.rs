//! Renders frames of one scenario.

use image::RgbImage;
use mujoco_grasp::grasp::{GraspId, Grasps};
use mujoco_grasp::mujoco::{Arrow, BodyId, Camera, Drawing, Renderer, Simulation};
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::Run;

/// The arrow that shows a push stands out so far on both sides of what is pushed, whatever its size \[m\].
const ARROW: f64 = 0.05;
const ARROW_COLOUR: [f32; 4] = [1.0, 0.75, 0.0, 1.0];

/// A renderer with a simulation to pose.
pub struct Artist {
    renderer: Renderer,
    sim: Simulation,
}

impl Artist {
    /// For frames of this size \[px\].
    pub fn new(plan: &Plan, (width, height): (u32, u32)) -> anyhow::Result<Self> {
        let sim = Simulation::new(&plan.model)?;
        Ok(Self { renderer: Renderer::new(&plan.model, width, height)?, sim })
    }

    fn pose(&mut self, qpos: &[f64]) -> anyhow::Result<()> {
        self.sim.qpos_mut().copy_from_slice(qpos);
        Ok(self.sim.kinematics()?)
    }

    /// The scene's own camera named `grasp`, else one that has hand and target in view at the first pose.
    pub fn camera(&mut self, plan: &Plan, first: &[f64]) -> anyhow::Result<Camera> {
        self.pose(first)?;
        let grasps = Grasps::of(&self.sim, &plan.grasps[0])?;
        let grasp = &grasps[GraspId::FIRST];
        Ok(Camera::for_grasp(&self.sim, grasp.palm(), grasp.target())?)
    }

    /// Of the largest sphere about a geom of the body \[m\].
    fn radius(&self, body: BodyId) -> f64 {
        let model = self.sim.model();
        let own =
            model.geom_bodyid().iter().zip(model.geom_rbound()).filter(|(owner, _)| **owner == body.index() as i32);
        own.map(|(_, radius)| *radius).fold(0.0, f64::max)
    }

    /// The scene in this pose, with an arrow for a push that is on.
    pub fn frame(&mut self, qpos: &[f64], camera: Camera, push: Option<&Push>) -> anyhow::Result<RgbImage> {
        self.pose(qpos)?;
        let mut drawing = Drawing::default();
        if let Some(push) = push.filter(|p| p.force.norm() > 0.0) {
            // Through the middle: one of its ends is seen from wherever it is looked at.
            let half = self.radius(push.body) + ARROW;
            let tip = self.sim.body_com(push.body) + half * push.force.normalize();
            drawing.arrows.push(Arrow::to_point(tip, push.force, 2.0 * half / push.force.norm(), ARROW_COLOUR));
        }
        Ok(self.renderer.draw(&self.sim, camera, &drawing)?)
    }
}

/// The pose nearest to a time; `None` if the run was over by then.
pub fn pose_at(run: &Run, time: f64) -> Option<&[f64]> {
    let next = run.moments.iter().position(|m| m.time >= time - 1e-9)?;
    Some(&run.moments[next].qpos)
}

/// The push, if it is on at this time.
pub fn pushing(push: Option<&Push>, time: f64) -> Option<&Push> {
    push.filter(|p| p.start <= time && time < p.end)
}
