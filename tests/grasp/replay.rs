//! A simulation with its grasps, saved and restored: the same from there on, bit for bit.

use crate::bits::{Format, bits, through};
use crate::claw::Claw;
use mujoco_grasp::grasp::{Grasp, GraspId, GraspSpec, Grasps, Limits, Phase, Snapshot, weld_xml};
use mujoco_grasp::mujoco::{Model, Simulation};
use nalgebra::Vector3;

/// A claw, how its grasp is made, and what happens to it.
struct Scene {
    name: &'static str,
    model: Model,
    limits: Limits,
    /// Force on the target by step.
    push: fn(usize) -> Vector3<f64>,
    /// From which step on the hand opens.
    open_at: usize,
}

/// The claw with touch, force and torque sensors, and with other text in the place of some.
fn model(changes: &[(&str, &str)]) -> Model {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    let mut xml = std::fs::read_to_string(path).expect("the claw");
    let mut sensors = String::from("<sensor>");
    for finger in 0..5 {
        let tip = format!(r#"<site name="f{finger}_tip" pos="-0.008 0 -0.025" size="0.002"/>"#);
        assert!(xml.contains(&tip));
        xml = xml.replace(&tip, &format!(r#"{tip}<site name="pad{finger}" pos="0 0 -0.015" size="0.04"/>"#));
        sensors += &format!(r#"<touch site="pad{finger}"/><force site="pad{finger}"/><torque site="pad{finger}"/>"#);
    }
    xml = xml.replace("</mujoco>", &(sensors + "</sensor>" + &weld_xml("object", None) + "</mujoco>"));
    for (from, to) in changes {
        assert!(xml.contains(from), "no {from} in claw.xml");
        xml = xml.replace(from, to);
    }
    Model::from_xml_string(&xml).expect("a model")
}

impl Scene {
    fn new(name: &'static str, changes: &[(&str, &str)], limits: Limits) -> Scene {
        Scene { name, model: model(changes), limits, push: pushed, open_at: 560 }
    }

    fn start(&self) -> Claw {
        let mut claw = Claw::closed_from(&self.model, |_, spec| spec.limits = self.limits);
        claw.push((self.push)(0));
        claw
    }

    /// A simulation that has never made a step.
    fn fresh(&self) -> (Simulation, Grasps) {
        let sim = Simulation::new(&self.model).expect("a simulation");
        let grasps = Grasps::of(&sim, &self.spec(&sim)).expect("a grasp");
        (sim, grasps)
    }

    fn spec(&self, sim: &Simulation) -> GraspSpec {
        let body = |name| sim.model().body(name).expect("a body");
        let mut spec = GraspSpec::new(body("object"), body("palm"));
        spec.limits = self.limits;
        spec
    }

    /// What is done between two steps: pushes, and the hand opens.
    fn act(&self, k: usize, sim: &mut Simulation, open: &[f64]) {
        let target = sim.model().body("object").expect("object");
        sim.set_body_wrench(target, &(self.push)(k), &Vector3::zeros()).expect("a wrench");
        if k >= self.open_at {
            sim.ctrl_mut().copy_from_slice(open);
        }
    }

    fn run(&self, (sim, grasps): (&mut Simulation, &mut Grasps), open: &[f64], steps: std::ops::Range<usize>) -> Log {
        steps
            .map(|k| {
                self.act(k, sim, open);
                grasps.step(sim).expect("a step");
                bits(sim, grasps)
            })
            .collect()
    }
}

/// Bits of each step.
type Log = Vec<Vec<u64>>;

/// Along the fingers until it slides, then across, and back.
fn pushed(k: usize) -> Vector3<f64> {
    match k {
        120..240 => Vector3::new(0.0, 0.0, -9.5),
        240..300 => Vector3::new(2.0, -1.0, 0.0),
        300..420 => Vector3::new(0.0, 0.0, 9.0),
        _ => Vector3::zeros(),
    }
}

fn open_ctrl(sim: &Simulation) -> Vec<f64> {
    let mut open = Simulation::new(&Model::from_xml_file(claw_path()).expect("the claw")).expect("a simulation");
    let key = open.model().keyframe("open").expect("keyframe");
    open.reset_to_keyframe(key).expect("a reset");
    assert_eq!(open.ctrl().len(), sim.ctrl().len());
    open.ctrl().to_vec()
}

fn claw_path() -> String {
    format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"))
}

fn assert_same(what: &str, from: usize, first: &[Vec<u64>], second: &[Vec<u64>]) {
    assert_eq!(first.len(), second.len());
    for (k, (a, b)) in first.iter().zip(second).enumerate() {
        assert!(a == b, "{what}: step {k} after the snapshot at step {from} differs");
    }
}

/// What a snapshot was taken in the midst of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Moment {
    Ungrasped,
    Latching,
    Holding,
    Sliding,
    Released,
}

fn moment(grasp: &Grasp, before: Phase) -> Moment {
    match (before, grasp.phase()) {
        (Phase::Ungrasped, Phase::Grasped) => Moment::Latching,
        (Phase::Grasped, Phase::Ungrasped) => Moment::Released,
        (_, Phase::Ungrasped) => Moment::Ungrasped,
        _ if grasp.contacts().iter().any(|c| c.is_sliding()) => Moment::Sliding,
        _ => Moment::Holding,
    }
}

/// Every moment of a grasp's life, through text and bytes into a simulation that has never made a step, and into one that
/// is elsewhere.
fn replays_from_every_moment(scene: &Scene, needed: &[Moment]) {
    const STEPS: usize = 700;
    const AFTER: usize = 60;
    let Claw { mut sim, mut grasps, .. } = scene.start();
    let open = open_ctrl(&sim);
    let mut snapshots = vec![(0, Moment::Ungrasped, Snapshot::take(&sim, &grasps))];
    let mut log = Log::new();
    for k in 0..STEPS {
        let before = grasps[GraspId::FIRST].phase();
        log.extend(scene.run((&mut sim, &mut grasps), &open, k..k + 1));
        let now = moment(&grasps[GraspId::FIRST], before);
        if k % 47 == 0 || matches!(now, Moment::Latching | Moment::Released) {
            snapshots.push((k + 1, now, Snapshot::take(&sim, &grasps)));
        }
    }
    for moment in needed {
        assert!(snapshots.iter().any(|(_, m, _)| m == moment), "{}: no snapshot while {moment:?}", scene.name);
    }
    for (i, (from, moment, snapshot)) in snapshots.iter().enumerate() {
        let what = format!("{} {:?}, {moment:?}", scene.name, scene.limits);
        let format = if i % 2 == 0 { Format::Json } else { Format::Cbor };
        let read = through(format, snapshot);
        assert_eq!(&read, snapshot, "{what} in {format:?}");
        let steps = *from..(from + AFTER).min(STEPS);
        let (mut new_sim, mut new_grasps) = scene.fresh();
        read.restore(&mut new_sim, &mut new_grasps).expect("a restored state");
        assert_eq!(&Snapshot::take(&new_sim, &new_grasps), snapshot, "{what}: saved again");
        let replay = scene.run((&mut new_sim, &mut new_grasps), &open, steps.clone());
        assert_same(&format!("{what}, fresh"), *from, &log[steps.clone()], &replay);
        // `sim` and `grasps` come from wherever the last replay left them
        read.restore(&mut sim, &mut grasps).expect("a restored state");
        let replay = scene.run((&mut sim, &mut grasps), &open, steps.clone());
        assert_same(&format!("{what}, used before"), *from, &log[steps], &replay);
    }
}

const ALL: [Moment; 5] = [Moment::Ungrasped, Moment::Latching, Moment::Holding, Moment::Sliding, Moment::Released];

#[test]
fn cones_replay_from_every_moment() {
    replays_from_every_moment(&Scene::new("elliptic", &[], Limits::Cones), &ALL);
    let pyramidal = [(r#"cone="elliptic""#, r#"cone="pyramidal""#)];
    replays_from_every_moment(&Scene::new("pyramidal", &pyramidal, Limits::Cones), &ALL);
}

#[test]
fn merged_grasps_replay_from_every_moment() {
    let scene = Scene::new("merged", &[], Limits::Box);
    replays_from_every_moment(&scene, &ALL);
    let held = [Moment::Ungrasped, Moment::Latching, Moment::Holding, Moment::Released];
    replays_from_every_moment(&Scene { limits: Limits::Rigid, ..scene }, &held);
}

const FLOOR: &str = r#"<geom name="floor" type="plane" size="1 1 0.1" rgba="0.4 0.45 0.5 1"/>"#;
const TABLE: &str = r#"<geom name="floor" type="plane" size="1 1 0.1" pos="0 0 0.265" rgba="0.4 0.45 0.5 1"/>"#;

/// Limits and frictions of joints, couplings, a table: what is solved with the grasp has a memory too.
#[test]
fn grasps_with_neighbours_replay_from_every_moment() {
    let joints = [
        (r#"<joint damping="0.05" armature="0"/>"#, r#"<joint damping="0.05" armature="0" frictionloss="0.003"/>"#),
        (r#"range="-0.6 1.7""#, r#"range="-0.6 0.4""#),
        ("<actuator>", r#"<equality><joint joint1="f1_pip" joint2="f2_pip"/></equality><actuator>"#),
    ];
    let held = [Moment::Ungrasped, Moment::Latching, Moment::Holding, Moment::Released];
    let scene = Scene { push: |k| pushed(k) * 0.3, ..Scene::new("joints", &joints, Limits::Cones) };
    replays_from_every_moment(&scene, &held);
    let scene = Scene { push: |k| pushed(k) * 0.3, ..Scene::new("table", &[(FLOOR, TABLE)], Limits::Cones) };
    replays_from_every_moment(&scene, &held);
}

/// The whole story: 10 000 steps in which the grasp latches, slips, is released and latches again, and in the end opens and
/// drops the ball. What was saved in the middle, while it slips, goes through JSON into a fresh simulation.
#[test]
fn ten_thousand_steps_go_on_from_the_middle_bit_for_bit() {
    const STEPS: usize = 10_000;
    const MIDDLE: usize = 5_040;
    const CYCLE: usize = 1_000;
    fn push(k: usize) -> Vector3<f64> {
        match k % CYCLE {
            20..160 => Vector3::new(0.0, 0.0, if (k / CYCLE).is_multiple_of(2) { 9.0 } else { -9.0 }),
            300..400 => Vector3::new(0.0, 3.0, 0.0),
            _ => Vector3::zeros(),
        }
    }
    let scene = Scene { push, open_at: 9_500, ..Scene::new("story", &[], Limits::Cones) };
    let run = |sim: &mut Simulation, grasps: &mut Grasps, open: &[f64], steps: std::ops::Range<usize>| -> Log {
        let one = |k: usize| {
            // given up once in each cycle; it latches again by itself
            if k % CYCLE == 900 {
                grasps[GraspId::FIRST].release();
            }
            scene.run((&mut *sim, &mut *grasps), open, k..k + 1).remove(0)
        };
        steps.map(one).collect()
    };
    let Claw { mut sim, mut grasps, .. } = scene.start();
    let open = open_ctrl(&sim);
    let mut log = Log::new();
    let (mut latches, mut releases, mut slipping) = ([0; 2], [0; 2], [0; 2]);
    let mut snapshot = None;
    let mut copy = None;
    for k in 0..STEPS {
        if k == MIDDLE {
            snapshot = Some(Snapshot::take(&sim, &grasps));
            copy = Some((sim.clone(), grasps.clone()));
            assert_eq!(moment(&grasps[GraspId::FIRST], grasps[GraspId::FIRST].phase()), Moment::Sliding);
        }
        let before = grasps[GraspId::FIRST].phase();
        log.extend(run(&mut sim, &mut grasps, &open, k..k + 1));
        let half = usize::from(k >= MIDDLE);
        match moment(&grasps[GraspId::FIRST], before) {
            Moment::Latching => latches[half] += 1,
            Moment::Released => releases[half] += 1,
            Moment::Sliding => slipping[half] += 1,
            _ => {}
        }
    }
    println!("latched {latches:?} times, released {releases:?} by itself, {slipping:?} steps of slip");
    assert!(latches.iter().all(|n| *n >= 4) && slipping.iter().all(|n| *n >= 50) && releases[1] >= 1);
    assert!(sim.body_com(grasps[GraspId::FIRST].target()).z < 0.1, "the ball was not dropped");

    let snapshot = through(Format::Json, &snapshot.expect("a snapshot"));
    let (mut fresh_sim, mut fresh_grasps) = scene.fresh();
    snapshot.restore(&mut fresh_sim, &mut fresh_grasps).expect("a restored state");
    let replay = run(&mut fresh_sim, &mut fresh_grasps, &open, MIDDLE..STEPS);
    assert_same("restored", MIDDLE, &log[MIDDLE..], &replay);
    let (mut sim, mut grasps) = copy.expect("a copy");
    let replay = run(&mut sim, &mut grasps, &open, MIDDLE..STEPS);
    assert_same("cloned", MIDDLE, &log[MIDDLE..], &replay);
}

/// Two pinching hands on one bar: latched they are solved as one problem, and each saves its own part of it.
#[test]
fn two_hands_on_one_object_go_on_alike() {
    let finger = |hand: &str, side: &str, sign: f64| {
        let y = sign * 0.0305;
        format!(
            r#"<body pos="0 {y} -.1"><joint name="{hand}_{side}" type="slide" axis="0 {} 0" damping="8"/>
            <geom size=".01" mass=".05"/><geom size=".01" mass=".05" pos=".025 0 0"/></body>"#,
            -sign
        )
    };
    let hand = |name: &str, x: f64| {
        let fingers = finger(name, "a", 1.0) + &finger(name, "b", -1.0);
        format!(
            r#"<body name="{name}" pos="{x} 0 .5"><joint name="{name}_rail" type="slide" axis="0 0 1" damping="30"/>
            <geom type="box" size=".02 .06 .01" mass=".3"/>{fingers}</body>"#
        )
    };
    let actuators = ["left", "right"].map(|hand| {
        format!(
            r#"<position joint="{hand}_rail" kp="2000"/><position joint="{hand}_a" kp="400"/>
            <position joint="{hand}_b" kp="400"/>"#
        )
    });
    let xml = format!(
        r#"<mujoco><option cone="elliptic" noslip_iterations="20"/><default><geom condim="4"/></default>
        <worldbody>{}{}<body name="bar" pos="0 0 .4"><freejoint/><geom type="box" size=".2 .02 .02" mass=".08"/></body>
        </worldbody><actuator>{}</actuator></mujoco>"#,
        hand("left", -0.12),
        hand("right", 0.1),
        actuators.concat()
    );
    let model = Model::from_xml_string(&xml).expect("a model");
    let start = || {
        let mut sim = Simulation::new(&model).expect("a simulation");
        sim.ctrl_mut().copy_from_slice(&[0.0, 0.012, 0.012, 0.0, 0.012, 0.012]);
        let body = |name| sim.model().body(name).expect("a body");
        let spec = |palm| GraspSpec::new(body("bar"), body(palm));
        let mut grasps = Grasps::new();
        for palm in ["left", "right"] {
            grasps.add(&sim, &spec(palm)).expect("a grasp");
        }
        (sim, grasps)
    };
    // steps of both, from `from` on: the right one is late, the left one lets go, and all the while something pulls
    let run = |sim: &mut Simulation, grasps: &mut Grasps, from: usize, to: usize| -> Vec<Vec<u64>> {
        let bar = sim.model().body("bar").expect("a body");
        let right = grasps.ids().nth(1).expect("two grasps");
        let one = |k: usize| {
            grasps[right].allow_latch(k > 300);
            if k == 600 {
                grasps[GraspId::FIRST].release();
                grasps[GraspId::FIRST].allow_latch(false);
            }
            let pull = Vector3::new(0.5 * (0.01 * k as f64).sin(), 0.0, -0.5);
            sim.set_body_wrench(bar, &pull, &Vector3::zeros()).expect("a wrench");
            grasps.step(sim).expect("a step");
            bits(sim, grasps)
        };
        (from..to).map(one).collect()
    };
    let (mut sim, mut grasps) = start();
    let mut log = Vec::new();
    for (k, phases) in [
        (250, [Phase::Grasped, Phase::Ungrasped]),
        (500, [Phase::Grasped; 2]),
        (650, [Phase::Ungrasped, Phase::Grasped]),
    ] {
        log.extend(run(&mut sim, &mut grasps, log.len(), k));
        assert_eq!(grasps.iter().map(Grasp::phase).collect::<Vec<_>>(), phases, "step {k}");
        let snapshot = through(Format::Json, &Snapshot::take(&sim, &grasps));
        let (mut fresh_sim, mut fresh_grasps) = start();
        snapshot.restore(&mut fresh_sim, &mut fresh_grasps).expect("a restored state");
        let replay = run(&mut fresh_sim, &mut fresh_grasps, k, k + 150);
        let (mut sim, mut grasps) = (sim.clone(), grasps.clone());
        assert!(run(&mut sim, &mut grasps, k, k + 150) == replay, "from step {k}");
    }
}

/// A gripper closes on a box on a table and lifts it.
const LIFT: &str = r#"<mujoco><option cone="elliptic" noslip_iterations="10"/>
  <default><geom condim="4" friction="1 .01 .001"/></default><worldbody>
  <geom name="tabletop" type="box" size=".2 .2 .1" pos="0 0 .1"/>
  <body name="arm" pos="0 0 .45"><joint name="z" type="slide" axis="0 0 1" damping="100"/>
    <geom type="box" size=".08 .03 .02" mass="1"/>
    <body pos="-.05 0 -.1"><joint name="f1" type="slide" axis="1 0 0" damping="20" limited="true" range="0 .05"/>
      <geom type="box" size=".006 .012 .04" mass=".1"/></body>
    <body pos=".05 0 -.1"><joint name="f2" type="slide" axis="-1 0 0" damping="20" limited="true" range="0 .05"/>
      <geom type="box" size=".006 .012 .04" mass=".1"/></body></body>
  <body name="box" pos="0 0 .2305"><freejoint/><geom type="box" size=".02 .025 .03" mass=".2"/></body></worldbody>
  <actuator><position joint="z" kp="3000"/><position joint="f1" kp="800"/><position joint="f2" kp="800"/></actuator></mujoco>"#;

/// How far things were apart was remembered, and decided which steps were whole.
#[test]
fn after_a_reset_or_a_restore_several_steps_a_call_are_the_same_each_time() {
    let model = Model::from_xml_string(LIFT).expect("a model");
    let mut sim = Simulation::new(&model).expect("a simulation");
    let spec = GraspSpec::new(model.body("box").expect("a box"), model.body("arm").expect("an arm"));
    let mut grasps = Grasps::of(&sim, &spec).expect("a grasp");
    let steps = |sim: &mut Simulation, grasps: &mut Grasps, until: f64| {
        let mut log = Vec::new();
        while sim.time() < until {
            let time = sim.time();
            let lift = if time < 0.4 { -0.095 * time / 0.4 } else { -0.095 + (0.2 * (time - 0.8)).clamp(0.0, 0.15) };
            let grip = (0.2 * (time - 0.45)).clamp(0.0, 0.04);
            sim.ctrl_mut().copy_from_slice(&[lift, grip, grip]);
            grasps.steps(sim, 10).expect("steps");
            log.push(bits(sim, grasps));
        }
        log
    };
    let (state, saved) = (sim.save(), grasps.save());
    let mut first = None;
    for episode in 0..4 {
        sim.restore(&state).expect("a state");
        if episode % 2 == 0 {
            grasps.reset()
        } else {
            grasps.restore(&saved).expect("a state")
        }
        let before = grasps.frozen_steps();
        let log = steps(&mut sim, &mut grasps, 1.3);
        assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped);
        assert!(grasps.frozen_steps() > before + 150, "{} frozen", grasps.frozen_steps() - before);
        assert_same("episode", episode, first.get_or_insert_with(|| log.clone()), &log);
    }
    // in the midst of it
    let (state, saved) = (sim.save(), grasps.save());
    let mut first = None;
    for replay in 0..3 {
        sim.restore(&state).expect("a state");
        grasps.restore(&saved).expect("a state");
        let log = steps(&mut sim, &mut grasps, 1.6);
        assert_same("replay", replay, first.get_or_insert_with(|| log.clone()), &log);
    }
}
