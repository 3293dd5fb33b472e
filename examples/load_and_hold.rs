//! Loads an MJCF, closes the hand, waits until the grasp latches, lifts, and prints quality and forces.
//!
//! `cargo run --release --example load_and_hold`
#![forbid(unsafe_code)]

use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Phase};
use mujoco_grasp::mujoco::{Model, Simulation};
use std::error::Error;

/// What the example has seen.
#[derive(Debug)]
pub struct Held {
    /// When the grasp latched \[s\].
    pub latched_at: f64,
    /// `Q` at the end \[N\].
    pub quality: f64,
    /// Sum of the contact forces on the ball along the vertical \[N\].
    pub lift: f64,
    /// Height of the ball's centre at the end \[m\].
    pub height: f64,
}

/// The program; returns what its test looks at.
pub fn run() -> Result<Held, Box<dyn Error>> {
    let model = Model::from_xml_file(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/gripper.xml"))?;
    let mut sim = Simulation::new(&model)?;
    let (ball, palm) = (sim.model().body("ball")?, sim.model().body("palm")?);
    let mut grasps = Grasps::of(&sim, &GraspSpec::new(ball, palm))?;
    let [lift, left, right] = ["lift", "left", "right"].map(|name| sim.model().actuator(name).map(|id| id.index()));
    let (lift, left, right) = (lift?, left?, right?);
    println!(
        "latches at Q = {:.3} N, is given up below {:.3} N",
        grasps[GraspId::FIRST].latch_quality(),
        grasps[GraspId::FIRST].release_quality()
    );

    let mut latched_at = f64::NAN;
    while sim.time() < 2.0 {
        let time = sim.time();
        let ctrl = sim.ctrl_mut();
        (ctrl[left], ctrl[right]) = (0.01, 0.01);
        ctrl[lift] = 0.1 * (time - 0.5).clamp(0.0, 1.0);
        grasps.step(&mut sim)?;
        if latched_at.is_nan() && grasps[GraspId::FIRST].phase() == Phase::Grasped {
            latched_at = sim.time();
            println!("latched at {latched_at:.3} s");
        }
    }

    let grasp = &grasps[GraspId::FIRST];
    println!("at {:.3} s: {:?}, Q = {:.3} N", sim.time(), grasp.phase(), grasp.quality());
    for contact in grasp.contacts() {
        let [x, y, z] = contact.force.into();
        println!("  {}: ({x:+.3}, {y:+.3}, {z:+.3}) N on the ball", sim.model().label(contact.link_id));
    }
    let lift = grasp.contacts().iter().map(|contact| contact.force.z).sum();
    let height = sim.body_com(ball).z;
    println!("the fingers carry {lift:.3} N; the ball is at {height:.3} m");
    Ok(Held { latched_at, quality: grasp.quality(), lift, height })
}

#[allow(dead_code)] // not where a test includes this file
fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
