//! A control loop of one's own: the grip follows the load that the fingers feel, from live contact forces.
//!
//! `cargo run --release --example control_loop`
//!
//! The controller runs between two steps. It reads the contacts of the last one, whether MuJoCo solved them or the grasp
//! constraint did, and squeezes with what the tangential load needs, and some to spare.
#![forbid(unsafe_code)]

use mujoco_grasp::grasp::{Grasp, GraspId, GraspSpec, Grasps};
use mujoco_grasp::mujoco::{BodyId, Model, Simulation};
use nalgebra::Vector3;
use std::error::Error;

/// Normal force wanted for each newton of load on a finger, at friction 1, and without load \[N\].
const SAFETY: f64 = 1.5;
const LEAST: f64 = 1.0;
/// Of the controller \[m/(N s)\].
const GAIN: f64 = 0.02;
/// Pull at the ball from 1.5 s to 2.5 s \[N\].
const PULL: f64 = 4.0;

/// How one run went.
#[derive(Debug)]
pub struct Grip {
    /// Normal force of a finger before the pull and at its end \[N\].
    pub normal: [f64; 2],
    /// Whether the ball is in the hand at the end.
    pub kept: bool,
}

/// Squeezes one finger.
struct Controller {
    link: BodyId,
    actuator: usize,
    ctrl: f64,
}

impl Controller {
    /// Normal force on this finger, and what it carries along the surface \[N\].
    fn felt(&self, grasp: &Grasp) -> (f64, f64) {
        let mine = grasp.contacts().iter().filter(|contact| contact.link_id == self.link);
        mine.fold((0.0, 0.0), |(normal, load), contact| {
            let along = contact.force - contact.axes[0] * contact.axes[0].dot(&contact.force);
            (normal + contact.normal_force(), load + along.norm())
        })
    }

    fn update(&mut self, sim: &mut Simulation, grasp: &Grasp) {
        let (normal, load) = self.felt(grasp);
        let wanted = LEAST + SAFETY * load;
        self.ctrl = (self.ctrl + GAIN * (wanted - normal) * sim.model().timestep()).clamp(0.0, 0.05);
        sim.ctrl_mut()[self.actuator] = self.ctrl;
    }
}

/// With the controller, or with the fingers left where they are when the pull begins.
pub fn run(controlled: bool) -> Result<Grip, Box<dyn Error>> {
    let model = Model::from_xml_file(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/gripper.xml"))?;
    let mut sim = Simulation::new(&model)?;
    let (ball, palm) = (sim.model().body("ball")?, sim.model().body("palm")?);
    let mut grasps = Grasps::of(&sim, &GraspSpec::new(ball, palm))?;
    let lift = sim.model().actuator("lift")?.index();
    let mut fingers = Vec::new();
    for name in ["left", "right"] {
        let (link, actuator) = (sim.model().body(name)?, sim.model().actuator(name)?.index());
        fingers.push(Controller { link, actuator, ctrl: 0.006 });
    }
    let mut normal = [0.0; 2];
    while sim.time() < 2.5 {
        let time = sim.time();
        sim.ctrl_mut()[lift] = 0.1 * (time - 0.7).clamp(0.0, 0.5) / 0.5;
        for finger in &mut fingers {
            if controlled || time < 1.5 {
                finger.update(&mut sim, &grasps[GraspId::FIRST]);
            }
        }
        let pull = if time < 1.5 { 0.0 } else { PULL * (time - 1.5).min(0.5) / 0.5 };
        sim.set_body_wrench(ball, &Vector3::new(0.0, 0.0, -pull), &Vector3::zeros())?;
        grasps.step(&mut sim)?;
        normal[usize::from(time >= 1.5)] = fingers[0].felt(&grasps[GraspId::FIRST]).0;
    }
    let kept = sim.body_com(ball).z > 0.1;
    println!(
        "{}: {:.2} N on a finger before the pull, {:.2} N at its end; the ball is {}",
        if controlled { "controlled" } else { "left alone" },
        normal[0],
        normal[1],
        if kept { "kept" } else { "lost" }
    );
    Ok(Grip { normal, kept })
}

#[allow(dead_code)] // not where a test includes this file
fn main() -> Result<(), Box<dyn Error>> {
    println!("a pull of {PULL} N at a ball of 1 N:");
    run(true)?;
    run(false).map(|_| ())
}
