//! What else acts on hand and target (limits, friction, couplings, other contacts) is solved together with the grasp:
//! its normal forces are those of the engine's converged solve of the same step, to rounding.

#[path = "common/claw.rs"]
mod claw;

use claw::Claw;
use mujoco_grasp::grasp::{self, Phase};
use mujoco_grasp::mujoco::{Model, Simulation, Solver};
use nalgebra::Vector3;

const DEFAULT_JOINT: &str = r#"<joint damping="0.05" armature="0"/>"#;

/// `claw.xml` with other text in the place of some.
fn claw_with(changes: &[(&str, &str)]) -> Claw {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    let mut xml = std::fs::read_to_string(path).expect("the claw");
    for (from, to) in changes {
        assert!(xml.contains(from), "no {from} in claw.xml");
        xml = xml.replace(from, to);
    }
    Claw::closed_from(&Model::from_xml_string(&xml).expect("a model"), |_, _| {})
}

/// The engine's own solve of the step that `sim` is about to make, with Newton's method to the last digit.
fn engine(sim: &Simulation) -> Simulation {
    let mut exact = sim.clone();
    exact.set_solver(Solver::Newton).expect("Newton");
    exact.set_noslip_iterations(0).expect("no noslip");
    exact.set_iterations(300).expect("iterations");
    exact.set_tolerance(0.0).expect("a tolerance");
    grasp::step(&mut exact, &mut []).expect("a step");
    exact
}

/// Largest difference of a normal force, relative to the largest normal force; and the rows beside the grasp's.
fn worst_difference(claw: &mut Claw) -> (f64, usize) {
    let exact = engine(&claw.sim);
    claw.step();
    let (mut worst, mut largest) = (0.0f64, 0.0f64);
    for contact in claw.grasp().contacts() {
        let (i, _) = exact
            .contacts()
            .enumerate()
            .filter(|(_, c)| c.geoms.map(|g| g.index()) == [contact.geoms.0, contact.geoms.1])
            .min_by(|(_, a), (_, b)| {
                let distance = |c: &mujoco_grasp::mujoco::Contact| (c.position - contact.position).norm();
                distance(a).total_cmp(&distance(b))
            })
            .expect("the same contact");
        let on_body2 = exact.contact_force(i).expect("a force").force;
        let normal = on_body2.dot(&contact.axes[0]) * if contact.target_first { -1.0 } else { 1.0 };
        worst = worst.max((normal - contact.normal_force()).abs());
        largest = largest.max(normal);
    }
    (worst / largest, claw.sim.nefc())
}

fn compare(name: &str, changes: &[(&str, &str)], needs_rows: bool) {
    for cone in [r#"cone="elliptic""#, r#"cone="pyramidal""#] {
        let mut changes = changes.to_vec();
        changes.push((r#"cone="elliptic""#, cone));
        let mut claw = claw_with(&changes);
        claw.run(0.3);
        assert_eq!(claw.grasp().phase(), Phase::Grasped, "{name}, {cone}: never latched");
        let mut most_rows = 0;
        for push in [[0.0, 0.0, 0.0], [1.5, 0.5, 0.0], [0.0, -1.0, -1.0]] {
            claw.push(Vector3::from(push));
            for _ in 0..10 {
                claw.run(0.02);
                let (worst, rows) = worst_difference(&mut claw);
                assert_eq!(claw.grasp().phase(), Phase::Grasped, "{name}, {cone}: released under {push:?}");
                assert!(worst < 1e-6, "{name}, {cone}, push {push:?}: normal forces differ by {worst}");
                most_rows = most_rows.max(rows);
            }
        }
        assert!(!needs_rows || most_rows > 0, "{name}: there are no other rows");
    }
}

#[test]
fn the_grasp_alone() {
    compare("alone", &[], false);
}

#[test]
fn friction_of_the_fingers_joints() {
    let joint = r#"<joint damping="0.05" armature="0" frictionloss="0.003"/>"#;
    compare("friction loss", &[(DEFAULT_JOINT, joint)], true);
}

#[test]
fn limits_of_the_fingers_joints() {
    compare("limits", &[(r#"range="-0.6 1.7""#, r#"range="-0.6 0.4""#)], true);
}

#[test]
fn couplings_within_and_between_fingers() {
    let couplings = r#"<tendon><fixed name="t" limited="true" range="-1 0.4"><joint joint="f3_pip" coef="0.5"/>
      <joint joint="f4_pip" coef="0.5"/></fixed></tendon>
      <equality><joint joint1="f0_dip" joint2="f0_pip" polycoef="0 0.4 0 0 0"/>
      <joint joint1="f1_pip" joint2="f2_pip"/></equality><actuator>"#;
    compare("couplings", &[("<actuator>", couplings)], true);
}

#[test]
fn limits_of_the_arm() {
    compare("arm limit", &[(r#"range="-0.2 0.2""#, r#"range="-0.2 -0.004""#)], true);
}

#[test]
fn a_table_under_the_target() {
    // the ball's lowest point
    let table = r#"<geom name="floor" type="plane" size="1 1 0.1" pos="0 0 0.265" rgba="0.4 0.45 0.5 1"/>"#;
    compare("table", &[(r#"<geom name="floor" type="plane" size="1 1 0.1" rgba="0.4 0.45 0.5 1"/>"#, table)], true);
}
