//! One scenario in one mode, looked at when asked.

use image::RgbImage;
use mujoco_grasp::grasp::Phase;
use mujoco_grasp::grasp::monitor::wrench::LoadedContact;
use mujoco_grasp::mujoco::{Arrow, Camera, Drawing, Renderer, Simulation};
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;

/// Length of a contact force's arrow [m/N].
const CONTACT: f64 = 0.035;
const BLUE: [f32; 4] = [0.0, 0.28, 0.5, 1.0];
const BLACK: [f32; 4] = [0.05, 0.05, 0.05, 1.0];

pub struct Stage<'a> {
    runner: Runner,
    push: Option<&'a Push>,
    /// Shows poses; the runner's simulation is further by a step.
    poses: Simulation,
    renderer: Renderer,
    camera: Camera,
    time: f64,
}

impl<'a> Stage<'a> {
    pub fn new(
        plan: &'a Plan,
        mode: Mode,
        push: Option<&'a Push>,
        (width, height): (u32, u32),
        camera: Camera,
    ) -> anyhow::Result<Self> {
        let runner = Runner::new(plan, mode, push)?;
        let poses = Simulation::new(&plan.model)?;
        let renderer = Renderer::new(&plan.model, width, height)?;
        Ok(Self { runner, push, poses, renderer, camera, time: 0.0 })
    }

    /// Goes on to a time [s]: poses, contacts and forces are those of the step from there.
    pub fn go_to(&mut self, time: f64) -> anyhow::Result<()> {
        self.runner.advance_to(time)?;
        self.poses.qpos_mut().copy_from_slice(self.runner.sim().qpos());
        self.poses.kinematics()?;
        self.runner.step()?;
        self.time = time;
        Ok(())
    }

    pub fn grasped(&self) -> bool {
        self.runner.mode() == Mode::Grasp && self.runner.grasp().phase() == Phase::Grasped
    }

    /// All contacts between hand and target, those without force too: so many are solved.
    pub fn contact_count(&self) -> usize {
        self.runner.grasp().contacts().len()
    }

    /// The contacts that press.
    pub fn contacts(&self) -> Vec<LoadedContact> {
        let contacts = self.runner.grasp().contacts().iter().map(|contact| contact.loaded());
        contacts.filter(|c| c.normal_force > 0.0).collect()
    }

    /// Centre of mass of the target.
    pub fn target(&self) -> Vector3<f64> {
        self.poses.body_com(self.runner.grasp().target())
    }

    /// An arrow at each contact: how the finger presses.
    pub fn pressing(&self) -> Vec<Arrow> {
        let arrow = |c: &LoadedContact| Arrow::to_point(c.position, c.force, CONTACT, BLUE).with_width(0.0025);
        self.contacts().iter().map(arrow).collect()
    }

    /// The push while it is on, from and to a distance from the target's centre of mass along it [m].
    pub fn pushing(&self, (from, to): (f64, f64)) -> Option<Arrow> {
        let push = self.push.filter(|p| p.start <= self.time && self.time < p.end)?;
        let along = push.force.normalize();
        Some(Arrow::from_point(self.target() + from * along, along, to - from, BLACK).with_width(0.004))
    }

    pub fn picture(&mut self, arrows: Vec<Arrow>, transparent: bool) -> anyhow::Result<RgbImage> {
        let drawing = Drawing { arrows, transparent, hide_sites: true, ..Drawing::default() };
        Ok(self.renderer.draw(&self.poses, self.camera, &drawing)?)
    }
}
