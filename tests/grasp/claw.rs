//! The five-finger claw of tests/data, closed around its ball.

use mujoco_grasp::grasp::{Error, Grasp, GraspId, GraspSpec, Grasps, weld_xml};
use mujoco_grasp::mujoco::{BodyId, Model, Simulation};
use nalgebra::Vector3;

#[derive(Clone)]
pub struct Claw {
    pub sim: Simulation,
    pub grasps: Grasps,
    target: BodyId,
    palm: BodyId,
    open: Vec<f64>,
}

impl Claw {
    /// Closed around the ball, at rest, not yet latched; latching is allowed.
    pub fn closed(file: &str) -> Claw {
        Claw::closed_as(file, |_, _| {})
    }

    /// As [`closed`](Self::closed), with changed options and another grasp; the model has a weld for a merged one.
    pub fn closed_as(file: &str, change: impl Fn(&mut Simulation, &mut GraspSpec)) -> Claw {
        let path = format!("{}/tests/data/{file}", env!("CARGO_MANIFEST_DIR"));
        Claw::closed_from(&Model::from_xml_file_with(path, &weld_xml("object", None)).expect("the claw"), change)
    }

    /// As [`closed_as`](Self::closed_as), of a model that is loaded already.
    pub fn closed_from(model: &Model, change: impl Fn(&mut Simulation, &mut GraspSpec)) -> Claw {
        let mut sim = Simulation::new(model).expect("a simulation");
        let key = sim.model().keyframe("open").expect("keyframe");
        sim.reset_to_keyframe(key).expect("a reset");
        let (target, palm) = (sim.model().body("object").expect("object"), sim.model().body("palm").expect("palm"));
        let mut spec = GraspSpec::new(target, palm);
        change(&mut sim, &mut spec);
        let grasps = Grasps::of(&sim, &spec).expect("a grasp");
        let open = sim.ctrl().to_vec();
        let mut claw = Claw { sim, grasps, target, palm, open };
        claw.grasps[GraspId::FIRST].allow_latch(false);
        let joint = claw.sim.model().free_joint_of(target).expect("a free joint");
        let (q, v) = (claw.sim.model().jnt_qposadr()[joint.index()] as usize, claw.target_dof());
        let start = claw.sim.qpos()[q..q + 7].to_vec();
        while claw.sim.time() < 2.0 {
            claw.sim.qpos_mut()[q..q + 7].copy_from_slice(&start);
            claw.sim.qvel_mut()[v..v + 6].fill(0.0);
            claw.close((claw.sim.time() / 1.6).min(1.0));
            claw.step();
        }
        while claw.sim.time() < 3.0 {
            claw.step();
        }
        claw.grasps[GraspId::FIRST].allow_latch(true);
        claw
    }

    fn close(&mut self, part: f64) {
        for actuator in self.sim.model().actuators().collect::<Vec<_>>() {
            let name = self.sim.model().label(actuator);
            let closed = [("mcp", 0.45), ("pip", 0.75), ("dip", 0.3)];
            let goal = closed.iter().find(|(joint, _)| name.contains(joint)).map_or(0.0, |(_, angle)| *angle);
            let i = actuator.index();
            self.sim.ctrl_mut()[i] = self.open[i] + part * (goal - self.open[i]);
        }
    }

    /// Sends the fingers back to the open pose.
    pub fn open(&mut self) {
        self.open_by(1.0);
    }

    /// Sends the fingers back by so much of the way to the open pose.
    pub fn open_by(&mut self, part: f64) {
        self.close(1.0 - part);
    }

    pub fn step(&mut self) {
        self.grasps.step(&mut self.sim).expect("a step");
    }

    pub fn try_step(&mut self) -> Result<(), Error> {
        self.grasps.step(&mut self.sim)
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / self.sim.model().timestep()).round() as usize {
            self.step();
        }
    }

    pub fn run_in_full_mode(&mut self, seconds: f64) {
        self.grasps[GraspId::FIRST].allow_latch(false);
        self.run(seconds);
    }

    pub fn grasp(&self) -> &Grasp {
        &self.grasps[GraspId::FIRST]
    }

    /// First degree of freedom of the target.
    pub fn target_dof(&self) -> usize {
        self.sim.model().body_dofadr()[self.target.index()] as usize
    }

    /// Position of the target in the palm's frame.
    pub fn offset(&self) -> Vector3<f64> {
        let away = self.sim.body_position(self.target) - self.sim.body_position(self.palm);
        self.sim.body_rotation(self.palm).transpose() * away
    }

    /// Linear acceleration of the target, world.
    pub fn acceleration(&self) -> Vector3<f64> {
        Vector3::from_column_slice(&self.sim.qacc()[self.target_dof()..self.target_dof() + 3])
    }

    /// A force at the target's centre of mass, world, until changed.
    pub fn push(&mut self, force: Vector3<f64>) {
        self.sim.set_body_wrench(self.target, &force, &Vector3::zeros()).expect("a wrench");
    }
}
