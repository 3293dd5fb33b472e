//! Saves a running simulation with its grasp to a file, and goes on from there in a new one: the same, bit for bit.
//!
//! `cargo run --release --example save_replay [FILE]`
#![forbid(unsafe_code)]

use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Snapshot};
use mujoco_grasp::mujoco::{Model, Simulation};
use std::error::Error;
use std::path::Path;

/// A simulation of the gripper, and its grasp.
fn set_up() -> Result<(Simulation, Grasps), Box<dyn Error>> {
    let model = Model::from_xml_file(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/gripper.xml"))?;
    let sim = Simulation::new(&model)?;
    let spec = GraspSpec::new(sim.model().body("ball")?, sim.model().body("palm")?);
    let grasps = Grasps::of(&sim, &spec)?;
    Ok((sim, grasps))
}

/// Closes, lifts and opens again, up to a time \[s\]; positions and contact forces of each step.
fn advance(sim: &mut Simulation, grasps: &mut Grasps, until: f64) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
    let mut steps = Vec::new();
    while sim.time() < until {
        let time = sim.time();
        let ctrl = sim.ctrl_mut();
        ctrl.fill(if time < 1.5 { 0.01 } else { -0.01 });
        ctrl[0] = 0.1 * (time - 0.5).clamp(0.0, 0.5) / 0.5;
        grasps.step(sim)?;
        let forces = grasps.iter().flat_map(|grasp| grasp.contacts()).flat_map(|contact| contact.force_rows);
        steps.push(sim.qpos().iter().copied().chain(forces).collect());
    }
    Ok(steps)
}

/// Number of steps that were replayed from `file`, and of those in which any number differs.
pub fn run(file: &Path) -> Result<(usize, usize), Box<dyn Error>> {
    let (mut sim, mut grasps) = set_up()?;
    advance(&mut sim, &mut grasps, 0.8)?;
    let snapshot = Snapshot::take(&sim, &grasps);
    std::fs::write(file, serde_json::to_string_pretty(&snapshot)?)?;
    println!("saved at {:.3} s, {:?}, to {}", sim.time(), grasps[GraspId::FIRST].phase(), file.display());
    let first = advance(&mut sim, &mut grasps, 2.0)?;

    // as another program would
    let (mut sim, mut grasps) = set_up()?;
    let snapshot: Snapshot = serde_json::from_reader(std::fs::File::open(file)?)?;
    snapshot.restore(&mut sim, &mut grasps)?;
    let second = advance(&mut sim, &mut grasps, 2.0)?;

    let same_bits = |a: &[f64], b: &[f64]| a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits()));
    let different = first.iter().zip(&second).filter(|(a, b)| !same_bits(a, b)).count();
    println!(
        "{} steps replayed, {different} of them different; now {:?}",
        second.len(),
        grasps[GraspId::FIRST].phase()
    );
    Ok((if first.len() == second.len() { first.len() } else { 0 }, different))
}

#[allow(dead_code)] // not where a test includes this file
fn main() -> Result<(), Box<dyn Error>> {
    match std::env::args_os().nth(1) {
        Some(file) => run(Path::new(&file)).map(|_| ()),
        None => run(&std::env::temp_dir().join(format!("mujoco-grasp-{}.json", std::process::id()))).map(|_| ()),
    }
}
