//! Several grasps at once: each with its own phase, and all forces those of the engine's converged solve of the step.

use crate::one_step;
use mujoco_grasp::grasp::{Error, GraspId, GraspSpec, Grasps, Limits, Phase, Snapshot, weld_xml};
use mujoco_grasp::mujoco::{Model, Simulation};
use nalgebra::Vector3;

/// A palm on a stiff slide with two fingers that pinch along y, at `x`, and their actuators.
fn pincher(name: &str, x: f64, half_width: f64) -> (String, String) {
    let finger = |side: &str, sign: f64| {
        let y = sign * (half_width + 0.0105);
        format!(
            r#"<body pos="0 {y} -.1"><joint name="{name}_{side}" type="slide" axis="0 {} 0" damping="8"/>
            <joint type="slide" axis="1 0 0" stiffness="500" damping="5"/>
            <geom size=".01" mass=".05"/><geom size=".01" mass=".05" pos=".025 0 0"/></body>"#,
            -sign
        )
    };
    let body = format!(
        r#"<body name="{name}" pos="{x} 0 .5"><joint name="{name}_rail" type="slide" axis="0 0 1" damping="30"/>
        <geom type="box" size=".02 .06 .01" mass=".3"/>{}{}</body>"#,
        finger("a", 1.0),
        finger("b", -1.0)
    );
    let actuators = format!(
        r#"<position name="{name}_rail" joint="{name}_rail" kp="2000"/>
        <position name="{name}_a" joint="{name}_a" kp="400"/><position name="{name}_b" joint="{name}_b" kp="400"/>"#
    );
    (body, actuators)
}

fn object(name: &str, pos: [f64; 3], geoms: &str) -> String {
    let [x, y, z] = pos;
    format!(r#"<body name="{name}" pos="{x} {y} {z}"><freejoint/>{geoms}</body>"#)
}

fn scene(cone: &str, bodies: &str, actuators: &str) -> String {
    format!(
        r#"<mujoco><option timestep=".002" cone="{cone}" noslip_iterations="100" noslip_tolerance="0"/>
        <default><geom condim="4" friction="1 .01 .001"/></default>
        <worldbody>{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>"#
    )
}

/// How far fingers are sent in \[m\]; they press with what is left of it.
const CLOSED: f64 = 0.012;
const BAR: &str = r#"<geom type="box" size=".2 .02 .02" mass=".08"/>"#;
const CUBE: &str = r#"<geom type="box" size=".03 .02 .02" mass=".1"/>"#;

/// Two hands on one bar.
fn two_hands_on_a_bar(cone: &str) -> (String, Vec<[&'static str; 2]>) {
    let (left, right) = (pincher("left", -0.12, 0.02), pincher("right", 0.1, 0.02));
    let bodies = left.0 + &right.0 + &object("bar", [0.0, 0.0, 0.4], BAR);
    (scene(cone, &bodies, &(left.1 + &right.1)), vec![["bar", "left"], ["bar", "right"]])
}

/// One hand with two cubes between its fingers, one on top of the other.
fn one_hand_on_two_cubes(cone: &str) -> (String, Vec<[&'static str; 2]>) {
    let finger = |side: &str, sign: f64, z: f64| {
        let y = sign * 0.0305;
        format!(
            r#"<body pos="0 {y} {z}"><joint name="{side}" type="slide" axis="0 {} 0" damping="8"/>
            <geom size=".01" mass=".05" pos="-.01 0 0"/><geom size=".01" mass=".05" pos=".012 0 .004"/></body>"#,
            -sign
        )
    };
    // the second cube leans on a finger pair of its own; both pairs hang on one wrist
    let hand = format!(
        r#"<body name="palm" pos="0 0 .5"><joint name="rail" type="slide" axis="0 0 1" damping="30"/>
        <joint name="wrist" axis="1 0 0" stiffness="20" damping="1"/>
        <geom type="box" size=".02 .06 .01" mass=".3"/>{}{}{}{}</body>"#,
        finger("a", 1.0, -0.1),
        finger("b", -1.0, -0.1),
        finger("c", 1.0, -0.139),
        finger("d", -1.0, -0.139)
    );
    let bodies = hand + &object("upper", [0.0, 0.0, 0.4], CUBE) + &object("lower", [0.0, 0.0, 0.3595], CUBE);
    let actuators = ["rail", "a", "b", "c", "d"]
        .map(|j| format!(r#"<position name="{j}" joint="{j}" kp="{}"/>"#, if j == "rail" { 2000 } else { 400 }))
        .concat();
    (scene(cone, &bodies, &actuators), vec![["upper", "palm"], ["lower", "palm"]])
}

/// Two hands on a common beam that turns, each with a cube of its own.
fn two_hands_of_one_body(cone: &str) -> (String, Vec<[&'static str; 2]>) {
    let (left, right) = (pincher("left", -0.1, 0.02), pincher("right", 0.1, 0.02));
    let beam = format!(
        r#"<body name="beam"><joint axis="1 0 0" pos="0 0 .7" stiffness="60" damping="2"/>
        <geom type="box" size=".15 .02 .01" pos="0 0 .56" mass=".5"/>{}{}</body>"#,
        left.0, right.0
    );
    let bodies = beam + &object("first", [-0.1, 0.0, 0.4], CUBE) + &object("second", [0.1, 0.0, 0.4], CUBE);
    (scene(cone, &bodies, &(left.1 + &right.1)), vec![["first", "left"], ["second", "right"]])
}

/// Two hands that have nothing to do with each other.
fn two_hands_apart(cone: &str) -> (String, Vec<[&'static str; 2]>) {
    let (left, right) = (pincher("left", -0.2, 0.02), pincher("right", 0.2, 0.02));
    let bodies =
        left.0 + &right.0 + &object("first", [-0.2, 0.0, 0.4], CUBE) + &object("second", [0.2, 0.0, 0.4], CUBE);
    (scene(cone, &bodies, &(left.1 + &right.1)), vec![["first", "left"], ["second", "right"]])
}

struct Hold {
    sim: Simulation,
    grasps: Grasps,
}

/// Closed and latched.
fn hold((xml, pairs): (String, Vec<[&'static str; 2]>)) -> Hold {
    let model = Model::from_xml_string(&xml).expect("a model");
    let mut sim = Simulation::new(&model).expect("a simulation");
    let spec = |[target, palm]: &[&str; 2]| {
        let (target, palm) = (sim.model().body(target).expect("a target"), sim.model().body(palm).expect("a palm"));
        let mut spec = GraspSpec::new(target, palm);
        spec.latch_quality = Some(0.1);
        spec
    };
    let specs: Vec<GraspSpec> = pairs.iter().map(spec).collect();
    let mut grasps = Grasps::new();
    for spec in &specs {
        grasps.add(&sim, spec).expect("a grasp");
    }
    for actuator in sim.model().actuators().collect::<Vec<_>>() {
        if !sim.model().label(actuator).contains("rail") {
            sim.ctrl_mut()[actuator.index()] = CLOSED;
        }
    }
    let mut hold = Hold { sim, grasps };
    hold.run(0.6);
    for (grasp, pair) in hold.grasps.iter().zip(&pairs) {
        assert_eq!(grasp.phase(), Phase::Grasped, "{pair:?} never latched: quality {}", grasp.quality());
    }
    hold
}

impl Hold {
    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / self.sim.model().timestep()).round() as usize {
            self.grasps.step(&mut self.sim).expect("a step");
        }
    }

    fn push(&mut self, force: [f64; 3]) {
        for grasp in &self.grasps {
            self.sim.set_body_wrench(grasp.target(), &Vector3::from(force), &Vector3::zeros()).expect("a wrench");
        }
    }

    /// Largest difference of a normal force from the engine's, relative to the largest of its grasp.
    fn worst_difference(&mut self) -> f64 {
        let exact = one_step::engine(&self.sim);
        self.grasps.step(&mut self.sim).expect("a step");
        self.grasps.iter().map(|g| one_step::difference(&exact, g.contacts())).fold(0.0, f64::max)
    }
}

const PUSHES: [[f64; 3]; 3] = [[0.0; 3], [1.0, 0.3, -0.5], [-0.5, -1.0, 2.0]];

fn compare(name: &str, scene: fn(&str) -> (String, Vec<[&'static str; 2]>)) {
    for cone in ["elliptic", "pyramidal"] {
        let mut hold = hold(scene(cone));
        for push in PUSHES {
            hold.push(push);
            for _ in 0..10 {
                hold.run(0.02);
                let worst = hold.worst_difference();
                let latched = hold.grasps.iter().all(|g| g.phase() == Phase::Grasped);
                assert!(latched, "{name}, {cone}: released under {push:?}");
                assert!(worst < 1e-6, "{name}, {cone}, push {push:?}: normal forces differ by {worst}");
            }
        }
    }
}

#[test]
fn two_hands_hold_one_bar() {
    compare("bar", two_hands_on_a_bar);
}

#[test]
fn one_hand_holds_two_cubes() {
    compare("cubes", one_hand_on_two_cubes);
}

#[test]
fn two_hands_of_one_body_hold_a_cube_each() {
    compare("beam", two_hands_of_one_body);
}

#[test]
fn two_hands_that_have_nothing_to_do_with_each_other() {
    compare("apart", two_hands_apart);
}

/// Which grasp stands first in the list decides which one solves for all: it changes nothing.
#[test]
fn the_order_of_the_grasps_does_not_matter() {
    for scene in [two_hands_on_a_bar, one_hand_on_two_cubes, two_hands_of_one_body] {
        let mut one = hold(scene("elliptic"));
        let mut other = turned_round(&one);
        for push in PUSHES {
            for hold in [&mut one, &mut other] {
                hold.push(push);
                hold.run(0.1);
            }
            let worst = one.sim.qpos().iter().zip(other.sim.qpos()).fold(0.0f64, |w, (a, b)| w.max((a - b).abs()));
            assert!(worst < 1e-7, "{push:?}: {worst}");
        }
    }
}

/// The same with the grasps in the opposite order.
fn turned_round(hold: &Hold) -> Hold {
    let mut grasps = Grasps::new();
    for grasp in hold.grasps.iter().rev() {
        let mut spec = GraspSpec::new(grasp.target(), grasp.palm());
        spec.latch_quality = Some(grasp.latch_quality());
        grasps.add(&hold.sim, &spec).expect("a grasp");
    }
    let mut state = serde_json::to_value(hold.grasps.save()).expect("a value");
    state["grasps"].as_array_mut().expect("a list").reverse();
    grasps.restore(&serde_json::from_value(state).expect("a state")).expect("the same grasps");
    Hold { sim: hold.sim.clone(), grasps }
}

/// As one hand opens, the other's grasp goes on.
#[test]
fn one_hand_opens_and_the_other_keeps_hold() {
    for (opens, keeps) in [(0, 1), (1, 0)] {
        let mut hold = hold(two_hands_on_a_bar("elliptic"));
        let name = ["left_a", "left_b", "right_a", "right_b"];
        for finger in &name[2 * opens..2 * opens + 2] {
            let actuator = hold.sim.model().actuator(finger).expect("an actuator");
            hold.sim.ctrl_mut()[actuator.index()] = -0.01;
        }
        hold.run(0.5);
        let ids: Vec<GraspId> = hold.grasps.ids().collect();
        let (opens, keeps) = (ids[opens], ids[keeps]);
        assert_eq!(hold.grasps[opens].phase(), Phase::Ungrasped);
        assert!(hold.grasps[opens].contacts().is_empty());
        assert_eq!(hold.grasps[keeps].phase(), Phase::Grasped);
        assert!(hold.grasps[keeps].contacts().len() >= 4);
    }
}

/// Grasps that are solved together are saved and go on together, bit for bit.
#[test]
fn two_grasps_replay_bit_for_bit() {
    for scene in [two_hands_on_a_bar, one_hand_on_two_cubes] {
        let mut first = hold(scene("elliptic"));
        first.push(PUSHES[1]);
        first.run(0.05);
        let saved = serde_json::to_string(&Snapshot::take(&first.sim, &first.grasps)).expect("a text");

        let mut second = hold(scene("elliptic"));
        second.push(PUSHES[2]);
        second.run(0.02);
        let snapshot: Snapshot = serde_json::from_str(&saved).expect("a snapshot");
        snapshot.restore(&mut second.sim, &mut second.grasps).expect("the same scene");
        for _ in 0..200 {
            for hold in [&mut first, &mut second] {
                hold.grasps.step(&mut hold.sim).expect("a step");
            }
            let bits = |x: &[f64]| -> Vec<u64> { x.iter().map(|x| x.to_bits()).collect() };
            assert_eq!(bits(first.sim.qpos()), bits(second.sim.qpos()));
            assert_eq!(bits(first.sim.qacc()), bits(second.sim.qacc()));
        }
    }
}

/// What two grasps of a target both had between hand and target, they divided between them.
#[test]
fn two_grasps_of_one_target_whose_hands_share_fingers_are_refused() {
    let model = Model::from_xml_string(&two_hands_of_one_body("elliptic").0).expect("a model");
    let sim = Simulation::new(&model).expect("a simulation");
    let spec = |target: &str, palm: &str| {
        let body = |name: &str| sim.model().body(name).expect("a body");
        GraspSpec::new(body(target), body(palm))
    };
    for (first, second) in [("left", "left"), ("beam", "left"), ("left", "beam")] {
        let mut grasps = Grasps::of(&sim, &spec("first", first)).expect("a grasp");
        let error = grasps.add(&sim, &spec("first", second)).expect_err("shared fingers");
        assert!(matches!(error, Error::SharedLink { grasp: 0, .. }), "{error}");
        let message = error.to_string();
        for part in
            ["body \"left\" is in the hand", "target body \"first\"", &format!("grasp 0, palm body \"{first}\"")]
        {
            assert!(message.contains(part), "{part:?} is not in: {message}");
        }
        assert_eq!(grasps.len(), 1, "what is refused is not added");
        grasps.add(&sim, &spec("second", second)).expect("another target");
    }
    let mut grasps = Grasps::of(&sim, &spec("first", "left")).expect("a grasp");
    grasps.add(&sim, &spec("first", "right")).expect("another hand");
}

/// The rows of the merged grasp were solved again in its place.
#[test]
fn cones_that_latch_after_a_merged_grasp_go_on_from_their_own_rows() {
    let (xml, _) = two_hands_on_a_bar("elliptic");
    let xml = xml.replace("</mujoco>", &format!("{}</mujoco>", weld_xml("bar", Some("left"))));
    let model = Model::from_xml_string(&xml).expect("a model");
    let mut sim = Simulation::new(&model).expect("a simulation");
    sim.set_noslip_iterations(0).expect("iterations");
    let specs = ["left", "right"].map(|palm| {
        let [bar, palm] = ["bar", palm].map(|name| sim.model().body(name).expect("a body"));
        GraspSpec::new(bar, palm)
    });
    let mut grasps = Grasps::new();
    let mut merged = specs[0].clone();
    merged.limits = Limits::Rigid;
    let [merged, cones] = [merged, specs[1].clone()].map(|spec| grasps.add(&sim, &spec).expect("a grasp"));
    grasps[cones].allow_latch(false);
    let send = |sim: &mut Simulation, fingers: &[&str], to: f64| {
        for finger in fingers {
            let actuator = sim.model().actuator(finger).expect("an actuator");
            sim.ctrl_mut()[actuator.index()] = to;
        }
    };
    send(&mut sim, &["left_a", "left_b", "right_a", "right_b"], CLOSED);
    let mut hold = Hold { sim, grasps };
    hold.run(0.6);
    assert_eq!(hold.grasps[merged].phase(), Phase::Grasped);
    hold.grasps.steps(&mut hold.sim, 10).expect("steps");
    hold.grasps[merged].release();
    hold.grasps[merged].allow_latch(false);
    send(&mut hold.sim, &["left_a", "left_b"], -0.01);
    hold.grasps[cones].allow_latch(true);
    hold.run(2.0);
    assert_eq!(hold.grasps[cones].phase(), Phase::Grasped);
    let mut whole = Hold { sim: hold.sim.clone(), grasps: hold.grasps.clone() };
    let before = hold.grasps.frozen_steps();
    for _ in 0..20 {
        hold.grasps.substep(&mut hold.sim).expect("a step");
        whole.grasps.step(&mut whole.sim).expect("a step");
    }
    assert!(hold.grasps.frozen_steps() > before, "{:?}", Vec::from_iter(hold.grasps.whole_steps()));
    let apart = hold.sim.qpos().iter().zip(whole.sim.qpos()).fold(0.0f64, |worst, (a, b)| worst.max((a - b).abs()));
    assert!(apart < 1e-6, "{apart} m");
}
