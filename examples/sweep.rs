//! A sweep in parallel threads: at which friction does a lift succeed? In MuJoCo's own contact solve and with a grasp.
//!
//! `cargo run --release --example sweep`
//!
//! A `Model` is shared; each thread makes a `Simulation` of its own, which owns a private copy of it, so its parameters can
//! be changed there.
#![forbid(unsafe_code)]

use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps};
use mujoco_grasp::mujoco::{Model, Simulation};
use rayon::prelude::*;

/// An error that can leave its thread.
type Error = Box<dyn std::error::Error + Send + Sync>;

/// One lift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lift {
    /// Sliding friction of all geoms.
    pub friction: f64,
    /// Height of the ball at the end \[m\]: in MuJoCo's solve, and with a grasp that may latch.
    pub heights: [f64; 2],
}

impl Lift {
    /// Whether the ball is in the hand at the end, in either.
    pub fn held(&self) -> [bool; 2] {
        self.heights.map(|height| height > 0.1)
    }
}

fn height(model: &Model, friction: f64, may_latch: bool) -> Result<f64, Error> {
    let mut sim = Simulation::new(model)?;
    for of_geom in sim.geom_friction_mut().chunks_exact_mut(3) {
        of_geom[0] = friction;
    }
    let (ball, palm) = (sim.model().body("ball")?, sim.model().body("palm")?);
    let mut grasps = Grasps::of(&sim, &GraspSpec::new(ball, palm))?;
    grasps[GraspId::FIRST].allow_latch(may_latch);
    let lift = sim.model().actuator("lift")?.index();
    sim.ctrl_mut().fill(0.01);
    while sim.time() < 2.0 {
        sim.ctrl_mut()[lift] = 0.15 * (sim.time() - 0.5).clamp(0.0, 1.0);
        grasps.step(&mut sim)?;
    }
    Ok(sim.body_com(ball).z)
}

/// All lifts, in the order of their frictions.
pub fn run() -> Result<Vec<Lift>, Error> {
    let model = Model::from_xml_file(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/gripper.xml"))?;
    let frictions: Vec<f64> = (1..=12).map(|i| 0.1 * f64::from(i)).collect();
    let lift = |friction: &f64| {
        let heights = [height(&model, *friction, false)?, height(&model, *friction, true)?];
        Ok(Lift { friction: *friction, heights })
    };
    let lifts = frictions.par_iter().map(lift).collect::<Result<Vec<_>, Error>>()?;
    println!("friction  MuJoCo      grasp");
    for lift in &lifts {
        let [full, grasp] = lift.heights;
        let word = |held: bool| if held { "held" } else { "lost" };
        let [a, b] = lift.held().map(word);
        println!("{:8.1}  {a} {full:.3} m  {b} {grasp:.3} m", lift.friction);
    }
    Ok(lifts)
}

#[allow(dead_code)] // not where a test includes this file
fn main() -> Result<(), Error> {
    run().map(|_| ())
}
