//! What else acts on hand and target (limits, friction, couplings, other contacts) is solved together with the grasp:
//! its normal forces are those of the engine's converged solve of the same step, to rounding.

use crate::claw::Claw;
use crate::one_step;
use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Phase};
use mujoco_grasp::mujoco::{Model, Simulation};
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

/// Largest difference of a normal force, relative to the largest normal force; and the rows beside the grasp's.
fn worst_difference(claw: &mut Claw) -> (f64, usize) {
    let exact = one_step::engine(&claw.sim);
    claw.step();
    (one_step::difference(&exact, claw.grasp().contacts()), claw.sim.nefc())
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

/// A mechanism that has nothing to do with the hand: its rows are solved with the grasp, so that the engine's solver is not run for
/// them, and come out as the engine has them.
#[test]
fn a_mechanism_elsewhere_moves_as_without_the_grasp() {
    let mechanism = r#"<body name="door" pos="1 1 1"><joint name="hinge" axis="0 1 0" frictionloss="0.01" limited="true" range="-3 0.3"/>
      <geom size="0.02" pos="0.2 0 0" mass="0.2"/><body pos="0.2 0 0"><joint name="latch" axis="0 1 0"/>
      <geom size="0.02" pos="0.1 0 0" mass="0.1"/></body></body></worldbody>"#;
    let coupled = r#"<equality><joint joint1="latch" joint2="hinge" polycoef="0 0.5 0 0 0"/></equality><actuator>"#;
    for cone in [r#"cone="elliptic""#, r#"cone="pyramidal""#] {
        let (key, longer) = ("0 0 0.3 1 0 0 0", "0 0 0.3 1 0 0 0 0 0");
        let no_noslip = ("noslip_iterations=\"50\"", "");
        let rows = [("</worldbody>", mechanism), ("<actuator>", coupled), (key, longer)];
        let changes = [&rows[..], &[(r#"cone="elliptic""#, cone), no_noslip]].concat();
        let mut claw = claw_with(&changes);
        claw.run(0.3);
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        let nv = claw.sim.model().nv();
        let (mut most_rows, mut moves) = (0, 0.0f64);
        for k in 0..200 {
            claw.sim.qfrc_applied_mut()[nv - 2] = 2.0 * (0.1 * k as f64).sin();
            let exact = one_step::engine(&claw.sim);
            claw.step();
            for dof in nv - 2..nv {
                let [ours, theirs] = [&claw.sim, &exact].map(|sim| sim.qacc()[dof]);
                assert!((ours - theirs).abs() < 1e-6 * theirs.abs().max(1.0), "{cone}, {dof}: {ours}, not {theirs}");
                moves = moves.max(theirs.abs());
            }
            most_rows = most_rows.max(claw.sim.nefc());
        }
        assert!(moves > 1.0 && most_rows >= 3, "{cone}: it moves by {moves} under {most_rows} rows");
    }
}

/// Jaws that slide on the palm under load and can hardly move across: their contacts' first tangent was taken for the measure of
/// both, the solve did not come to its end, and the ball's normal forces jumped by 15 % in the step after the latch.
#[test]
fn contacts_that_can_hardly_move_along_one_tangent_do_not_spoil_the_other() {
    let jaw = |name: &str, x: f64, axis: i32| {
        format!(
            r#"<body name="{name}" pos="{x} 0 0"><joint type="slide" axis="0 1 0" armature="1e4"/>
            <joint type="slide" axis="0 0 1" damping="1"/><joint name="{name}" type="slide" axis="{axis} 0 0" damping=".5"/>
            <geom type="box" size=".03 .02 .02" mass=".2"/></body>"#
        )
    };
    for cone in ["elliptic", "pyramidal"] {
        let xml = format!(
            r#"<mujoco><option cone="{cone}" noslip_iterations="200" noslip_tolerance="0"/>
            <default><geom condim="3" friction=".6"/></default><worldbody><body name="palm">
            <geom type="box" size=".02 .02 .01" pos="-.06 0 -.03"/><geom type="box" size=".02 .02 .01" pos=".06 0 -.03"/>
            {}{}</body><body name="ball"><freejoint/><geom size=".0295" mass=".1" condim="4" friction=".6 .01"/></body>
            </worldbody><actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>"#,
            jaw("left", -0.06, 1),
            jaw("right", 0.06, -1)
        );
        let model = Model::from_xml_string(&xml).expect("a model");
        let mut sim = Simulation::new(&model).expect("a simulation");
        let spec = GraspSpec::new(model.body("ball").expect("a ball"), model.body("palm").expect("a palm"));
        let mut grasps = Grasps::of(&sim, &spec).expect("a grasp");
        // gravity is off until the ball is held
        let gravity = model.gravity();
        sim.set_gravity(Vector3::zeros()).expect("no gravity");
        for k in 0..400 {
            if k == 100 {
                sim.set_gravity(gravity).expect("gravity");
                grasps[GraspId::FIRST].allow_latch(true);
            }
            if k == 0 {
                grasps[GraspId::FIRST].allow_latch(false);
                sim.ctrl_mut().fill(10.0);
            }
            let mut full = sim.clone();
            let latched = grasps[GraspId::FIRST].phase() == Phase::Grasped;
            grasps.step(&mut sim).expect("a step");
            if latched {
                full.step().expect("a step");
                let apart = sim.qvel().iter().zip(full.qvel()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(apart < 1e-5, "{cone}: {apart} m/s apart after one step, at {} s", full.time());
            }
        }
        assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped, "{cone}");
    }
}
