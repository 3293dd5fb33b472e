//! Grasps over a long time and many changes: shaken, latched and released again and again, opened slowly and at once.

use crate::claw::Claw;
use mujoco_grasp::grasp::{GraspId, Phase};
use mujoco_grasp::mujoco::Model;
use nalgebra::Vector3;

const GRAVITY: f64 = 9.81;

/// The claw in full mode, its friction converged, and in grasp mode, from the same state, far above the floor.
fn both_modes(file: &str) -> [Claw; 2] {
    let path = format!("{}/tests/data/{file}", env!("CARGO_MANIFEST_DIR"));
    let xml = std::fs::read_to_string(path).expect("the claw");
    let floor = r#"<geom name="floor" type="plane""#;
    assert!(xml.contains(floor));
    let xml = xml.replace(floor, &format!(r#"{floor} pos="0 0 -9""#));
    let mut full = Claw::closed_from(&Model::from_xml_string(&xml).expect("a model"), |_, _| {});
    let mut latched = full.clone();
    full.sim.set_noslip_iterations(100).expect("iterations");
    full.sim.set_noslip_tolerance(0.0).expect("a tolerance");
    full.run_in_full_mode(0.5);
    latched.run(0.5);
    assert_eq!(latched.grasp().phase(), Phase::Grasped);
    [full, latched]
}

/// A minute of shaking by the arm, 1 g at 2 Hz: target and energy follow the full solve's.
///
/// Under such a load MuJoCo's contacts themselves ratchet: without any slip, the target wanders up and down the fingers by
/// millimetres, in both modes alike. What a grasp may add is judged by the difference of the two. Noslip iterations that stop
/// at MuJoCo's default tolerance are 0.06 mm off to the side by then.
#[test]
fn a_shaken_hand_keeps_its_target() {
    for file in ["claw.xml", "claw4.xml"] {
        let [full, grasp] = both_modes(file).map(shake);
        assert_eq!(grasp.claw.grasp().phase(), Phase::Grasped, "{file}");
        assert!(full.acceleration > 0.8 * GRAVITY, "{file}: shaken by {} m/s^2 only", full.acceleration);
        let apart = full.path.iter().zip(&grasp.path).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let travel = full.path.iter().map(|p| (p - full.path[0]).norm()).fold(0.0, f64::max);
        println!("{file}: at most {:.4} mm apart in {:.2} mm", apart * 1e3, travel * 1e3);
        assert!(apart < 0.04 * travel, "{file}: {apart} m apart after {travel} m");
        let sideways = |shaken: &Shaken| (shaken.path[shaken.path.len() - 1] - shaken.path[0]).xy().norm();
        assert!(sideways(&grasp) < 1e-5, "{file}: drifts {} m to the side", sideways(&grasp));
        let range = |e: &[f64]| e.iter().fold(f64::MIN, |m, e| m.max(*e)) - e.iter().fold(f64::MAX, |m, e| m.min(*e));
        let swing = range(&full.energy);
        let worst = full.energy.iter().zip(&grasp.energy).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("{file}: energy differs by {:.3} % of its swing of {swing:.3} J", 100.0 * worst / swing);
        assert!(worst < 0.01 * swing, "{file}: energy differs by {worst} J of {swing} J");
    }
}

/// A minute of shaking.
struct Shaken {
    claw: Claw,
    /// Position of the target in the palm, in every step.
    path: Vec<Vector3<f64>>,
    /// Potential and kinetic.
    energy: Vec<f64>,
    /// Largest of the target.
    acceleration: f64,
}

fn shake(mut claw: Claw) -> Shaken {
    claw.sim.set_energy_enabled(true);
    let wrist = claw.sim.model().actuator("wrist").expect("the wrist").index();
    let (rest, start) = (claw.sim.ctrl()[wrist], claw.sim.time());
    let omega = std::f64::consts::TAU * 2.0;
    let (mut path, mut energy, mut acceleration) = (vec![claw.offset()], Vec::new(), 0.0f64);
    while claw.sim.time() < start + 60.0 {
        claw.sim.ctrl_mut()[wrist] = rest + GRAVITY / (omega * omega) * (omega * (claw.sim.time() - start)).sin();
        claw.step();
        path.push(claw.offset());
        energy.push(claw.sim.energy().iter().sum());
        acceleration = acceleration.max(claw.acceleration().norm());
    }
    Shaken { claw, path, energy, acceleration }
}

/// A thousand times latched and released at rest: the target stays where it is, and no contact is lost.
#[test]
fn a_thousand_latches_leave_the_target_in_its_place() {
    let mut claw = Claw::closed("claw4.xml");
    let (start, contacts) = (claw.offset(), claw.grasp().contacts().len());
    for cycle in 0..1000 {
        claw.grasps[GraspId::FIRST].allow_latch(true);
        claw.run(0.06);
        assert_eq!(claw.grasp().phase(), Phase::Grasped, "cycle {cycle}");
        assert_eq!(claw.grasp().contacts().len(), contacts, "cycle {cycle}");
        claw.grasps[GraspId::FIRST].release();
        claw.grasps[GraspId::FIRST].allow_latch(false);
        claw.run(0.01);
        assert_eq!(claw.grasp().contacts().len(), contacts, "cycle {cycle}");
    }
    let moved = (claw.offset() - start).norm();
    println!("moved {:.4} mm", moved * 1e3);
    assert!(moved < 5e-4, "the target moved {moved} m");
}

/// When and how the target leaves an opening hand: 0.2 s after its own loss of contact its velocity is that of the full
/// solve within 5 %, and the losses are within 20 ms of each other.
#[test]
fn an_opening_hand_lets_go_as_in_the_full_solve() {
    for file in ["claw.xml", "claw4.xml"] {
        for seconds in [0.0, 1.0] {
            let [(full, full_velocity), (grasp, velocity)] = both_modes(file).map(|claw| drop(claw, seconds));
            println!(
                "{file}, opened in {seconds} s: lost at {full:.4} and {grasp:.4} s, {full_velocity:?} {velocity:?}"
            );
            assert!((full - grasp).abs() < 0.02, "{file}, {seconds}: lost at {full} s and {grasp} s");
            let apart = (full_velocity - velocity).norm();
            assert!(apart < 0.05 * full_velocity.norm(), "{file}, {seconds}: {full_velocity} and {velocity} m/s");
        }
    }
}

/// Opens the hand within so many seconds; time of the loss after that and velocity of the target 0.2 s later.
fn drop(mut claw: Claw, seconds: f64) -> (f64, Vector3<f64>) {
    let start = claw.sim.time();
    let mut last_touch = start;
    let mut fell_at = None;
    while fell_at.is_none_or(|fell| claw.sim.time() < fell + 0.2 - 1e-9) {
        let part = if seconds > 0.0 { (claw.sim.time() - start) / seconds } else { 1.0 };
        claw.open_by(part.min(1.0));
        claw.step();
        if !claw.grasp().contacts().is_empty() {
            last_touch = claw.sim.time();
            fell_at = None;
        } else if fell_at.is_none() {
            fell_at = Some(claw.sim.time());
        }
        assert!(claw.sim.time() < start + 5.0, "the target does not fall");
    }
    assert_eq!(claw.grasp().phase(), Phase::Ungrasped);
    let dof = claw.target_dof();
    (last_touch - start, Vector3::from_column_slice(&claw.sim.qvel()[dof..dof + 3]))
}
