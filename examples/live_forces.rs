//! Live contact forces and slip, contact by contact, before and after the grasp latches and while the ball slides.
//!
//! `cargo run --release --example live_forces`
#![forbid(unsafe_code)]

use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Phase};
use mujoco_grasp::mujoco::{Model, Simulation};
use nalgebra::Vector3;
use std::error::Error;

/// One contact at one time.
#[derive(Debug)]
pub struct Reading {
    /// \[s\]
    pub time: f64,
    /// Whether the grasp constraint stood for MuJoCo's contact.
    pub phase: Phase,
    /// \[N\]
    pub normal: f64,
    /// \[N\]
    pub tangential: f64,
    /// Speed of the ball along the finger \[m/s\].
    pub slip: f64,
    /// Whether friction is at its limit; MuJoCo's own solve does not tell, so it is false while ungrasped.
    pub sliding: bool,
}

/// The program; returns what its test looks at.
pub fn run() -> Result<Vec<Reading>, Box<dyn Error>> {
    let model = Model::from_xml_file(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/gripper.xml"))?;
    let mut sim = Simulation::new(&model)?;
    let (ball, palm) = (sim.model().body("ball")?, sim.model().body("palm")?);
    let mut grasps = Grasps::of(&sim, &GraspSpec::new(ball, palm))?;
    let lift = sim.model().actuator("lift")?.index();
    sim.ctrl_mut().fill(0.01);
    grasps[GraspId::FIRST].allow_latch(false);

    let mut readings = Vec::new();
    println!("time    phase      finger        normal  along    slip        at the limit");
    for k in 0..1000 {
        let time = sim.time();
        // MuJoCo's own contacts first; a grasp from 0.5 s on; then a lift, and a pull until the ball slides
        grasps[GraspId::FIRST].allow_latch(time > 0.5);
        sim.ctrl_mut()[lift] = 0.1 * (time - 0.8).clamp(0.0, 0.5) / 0.5;
        let pull = 4.0 * (time - 1.5).clamp(0.0, 0.5) / 0.5;
        sim.set_body_wrench(ball, &Vector3::new(0.0, 0.0, -pull), &Vector3::zeros())?;
        grasps.step(&mut sim)?;
        let every = if time < 1.5 { 50 } else { 10 };
        if (k + 1) % every != 0 {
            continue;
        }
        let grasp = &mut grasps[GraspId::FIRST];
        grasp.read_slip(&sim);
        for contact in grasp.contacts() {
            let normal = contact.normal_force();
            let tangential = (contact.force - contact.axes[0] * contact.axes[0].dot(&contact.force)).norm();
            let reading = Reading {
                time: sim.time(),
                phase: grasp.phase(),
                normal,
                tangential,
                slip: contact.slip_velocity.norm(),
                sliding: contact.is_sliding(),
            };
            println!(
                "{:.3} s {:9}  {:12} {normal:5.2} N {tangential:5.2} N {:8.2e} m/s  {}",
                reading.time,
                format!("{:?}", reading.phase),
                sim.model().label(contact.link_id),
                reading.slip,
                if reading.sliding { "yes" } else { "" }
            );
            readings.push(reading);
        }
    }
    Ok(readings)
}

#[allow(dead_code)] // not where a test includes this file
fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
