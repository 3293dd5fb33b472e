//! `Clearance`: what it certifies is what the engine finds, over long random motions and at touching distance.

use crate::robot;
use std::time::Instant;

use mujoco_grasp::mujoco::{Clearance, Error, GeomId, Model, PairCollider, Simulation};

use crate::random::Random;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

fn simulation(xml: &str) -> Simulation {
    Simulation::new(&Model::from_xml_string(xml).unwrap()).unwrap()
}

/// How often the answer was yes, how often it should have been, and how many steps there were.
#[derive(Debug, Default, Clone, Copy)]
struct Tally {
    certified: usize,
    clear: usize,
    all: usize,
}

struct Watch {
    collider: PairCollider,
    clearance: Clearance,
    tally: Tally,
}

impl Watch {
    fn new(sim: &Simulation, first: &[GeomId], second: &[GeomId]) -> Self {
        let collider = PairCollider::new(sim, first, second).unwrap();
        Self { clearance: Clearance::new(sim, &collider).unwrap(), collider, tally: Tally::default() }
    }

    /// Compares with the engine at the present configuration.
    fn look(&mut self, sim: &mut Simulation) -> bool {
        sim.kinematics().unwrap();
        let certified = self.clearance.certifies(sim).unwrap();
        sim.collision().unwrap();
        let other = sim.contacts().find(|c| !self.collider.covers(c.geoms));
        if let (true, Some(contact)) = (certified, &other) {
            let names = contact.geoms.map(|geom| sim.model().label(geom));
            panic!("{names:?} touch at {} s: {contact:?}", sim.time());
        }
        self.tally.all += 1;
        self.tally.certified += usize::from(certified);
        self.tally.clear += usize::from(other.is_none());
        certified
    }
}

/// Bodies of every shape that fly about in a room, with margins, a mocap body and a pair.
fn room(option: &str, margin: f64) -> String {
    let shapes = [
        r#"type="sphere" size=".05""#,
        r#"type="capsule" size=".03 .07""#,
        r#"type="ellipsoid" size=".03 .07 .05""#,
        r#"type="cylinder" size=".04 .06""#,
        r#"type="box" size=".03 .05 .06""#,
        r#"type="mesh" mesh="wedge""#,
        r#"type="box" size=".06 .01 .04""#,
    ];
    let bodies: String = shapes
        .iter()
        .enumerate()
        .map(|(i, shape)| {
            let (x, y, z) = (i % 3, i / 3 % 3, i % 2);
            format!(
                r#"<body pos=".{x}5 .{y}5 .{z}5"><freejoint/><geom {shape} margin="{margin}"/>
                <geom name="g{i}" {shape} pos="0 .08 .01" euler="40 0 20"/></body>"#
            )
        })
        .collect();
    format!(
        r#"<mujoco><option gravity="0 0 0" timestep=".002">{option}</option><size nconmax="1000"/>
        <asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .08 0  0 0 .06  .1 .08 .06"/>
          <hfield name="hills" nrow="4" ncol="4" size=".1 .1 .1 .05"/></asset>
        <worldbody>
          <geom type="plane" size="1 1 1" pos="0 0 -.9"/><geom type="plane" size="1 1 1" pos="0 0 .9" zaxis="0 0 -1"/>
          <geom type="plane" size="1 1 1" pos="-.9 0 0" zaxis="1 0 0"/><geom type="plane" size="1 1 1" pos=".9 0 0" zaxis="-1 0 0"/>
          <geom type="plane" size="1 1 1" pos="0 -.9 0" zaxis="0 1 0"/><geom type="plane" size="1 1 1" pos="0 .9 0" zaxis="0 -1 0"/>
          <geom type="hfield" hfield="hills" pos="-.5 -.5 -.5"/>
          <body pos=".6 .6 -.6"><geom type="box" size=".1 .1 .1"/></body>
          <body name="mocap" mocap="true" pos="-.5 .5 .5"><geom type="capsule" size=".05 .1"/></body>
          {bodies}
        </worldbody>
        <contact><pair geom1="g0" geom2="g4" margin=".03"/><exclude body1="mocap" body2="world"/></contact></mujoco>"#
    )
}

/// Geoms of which the collider has the pairs of one side with the other.
fn sides(sim: &Simulation) -> (Vec<GeomId>, Vec<GeomId>) {
    sim.model().geoms().partition(|geom| geom.index() % 3 == 0)
}

/// Long random flights: kicks now and then, also of the mocap body; the collider has some of the pairs.
fn fly(sim: &mut Simulation, steps: usize, kick: f64, seed: u64) -> Tally {
    let mut random = Random(seed);
    let (some, others) = sides(sim);
    let mut watch = Watch::new(sim, &some, &others);
    for step in 0..steps {
        if step % 200 == 0 {
            sim.qvel_mut().iter_mut().for_each(|v| *v = kick * random.next());
        }
        if !sim.mocap_pos().is_empty() {
            sim.mocap_pos_mut()[2] += 0.001 * random.next();
            sim.mocap_quat_mut()[step % 4] += 0.02 * random.next();
        }
        sim.step().unwrap();
        watch.look(sim);
    }
    watch.tally
}

#[test]
fn what_is_certified_in_a_room_of_flying_bodies_is_true() {
    for (option, margin, kick, seed) in [
        ("", 0.0, 1.0, 1),
        ("", 0.02, 0.5, 2),
        (r#"<flag multiccd="enable"/>"#, 0.0, 2.0, 3),
        (r#"<flag filterparent="disable"/>"#, 0.001, 0.1, 4),
    ] {
        let mut sim = simulation(&room(option, margin));
        let tally = fly(&mut sim, 6000, kick, seed);
        println!("margin {margin} m, speed {kick} m/s: {tally:?}");
        // Not by saying no all the time.
        assert!(tally.certified > tally.clear / 4, "{tally:?}");
        assert!(tally.clear < tally.all, "{tally:?}: nothing ever touched");
    }
}

#[test]
fn what_is_certified_of_a_robot_under_random_torques_is_true() {
    let mut sim = simulation(&robot::robot(r#"<option gravity="0 0 0"/>"#));
    let (hand, ball) = robot::hand_and_ball(&sim);
    let mut watch = Watch::new(&sim, &hand, &ball);
    let mut random = Random(5);
    for step in 0..12_000 {
        if step % 1000 == 0 {
            sim.reset().unwrap();
        }
        if step % 100 == 0 {
            sim.qvel_mut().iter_mut().for_each(|v| *v = 0.3 * random.next());
        }
        sim.step().unwrap();
        watch.look(&mut sim);
    }
    println!("{:?}", watch.tally);
    assert!(watch.tally.certified > watch.tally.clear / 2, "{:?}", watch.tally);
    assert!(watch.tally.clear < watch.tally.all, "{:?}", watch.tally);
}

/// Two bodies of every pair of shapes, brought to the distance at which the engine finds the first contact.
#[test]
fn certainty_ends_close_to_where_the_engines_contacts_begin() {
    let shapes = [
        r#"type="plane" size="1 1 1""#,
        r#"type="sphere" size=".05""#,
        r#"type="capsule" size=".03 .07""#,
        r#"type="ellipsoid" size=".03 .07 .05""#,
        r#"type="cylinder" size=".04 .06""#,
        r#"type="box" size=".03 .05 .06""#,
        r#"type="mesh" mesh="wedge""#,
    ];
    let mut random = Random(6);
    for (i, a) in shapes.iter().enumerate() {
        for b in &shapes[i.max(1)..] {
            for margin in [0.0, 0.01] {
                let xml = format!(
                    r#"<mujoco><asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .08 0  0 0 .06  .1 .08 .06"/></asset>
                    <worldbody><geom {a}/><body><freejoint/><geom {b} margin="{margin}"/></body></worldbody></mujoco>"#
                );
                let mut sim = simulation(&xml);
                let boxes = a.contains("box") && b.contains("box");
                for _ in 0..40 {
                    let (clear, certain) = approach(&mut sim, &mut random);
                    let most = if boxes { 2.0 * margin } else { 0.0 } + 1e-4;
                    assert!(
                        (clear..clear + most).contains(&certain),
                        "{a}, {b}: clear from {clear} m, certain from {certain} m"
                    );
                }
            }
        }
    }
}

/// The free body comes along a random line: the distances of the centres from which the engine finds nothing, and from
/// which that is certain, m.
fn approach(sim: &mut Simulation, random: &mut Random) -> (f64, f64) {
    let mut line: [f64; 3] = std::array::from_fn(|_| random.next());
    line[2] = line[2].abs();
    let length = line.iter().map(|x| x * x).sum::<f64>().sqrt();
    let quaternion: [f64; 4] = std::array::from_fn(|_| random.next());
    let look = |sim: &mut Simulation, distance: f64| {
        sim.qpos_mut()[..3].copy_from_slice(&line.map(|x| x / length * distance));
        sim.qpos_mut()[3..].copy_from_slice(&quaternion);
        let mut watch = Watch::new(sim, &[], &[]);
        let certified = watch.look(sim);
        (certified, watch.tally.clear == 1)
    };
    // Bisection; neither need be monotonous far inside, but the outermost change is what the search keeps.
    let mut outermost = |which: fn((bool, bool)) -> bool| {
        let (mut inside, mut outside) = (0.0, 20.0);
        for _ in 0..40 {
            let middle = 0.5 * (inside + outside);
            *(if which(look(sim, middle)) { &mut outside } else { &mut inside }) = middle;
        }
        outside
    };
    let (certain, clear) = (outermost(|(certain, _)| certain), outermost(|(_, clear)| clear));
    assert!(certain >= clear, "certain from {certain} m, clear from {clear} m");
    (clear, certain)
}

/// A body without joints is welded to the world, but a mocap body moves all the same, and its planes with it.
#[test]
fn a_moving_plane_of_a_mocap_body_is_seen() {
    let mut sim = simulation(
        r#"<mujoco><worldbody><body name="tray" mocap="true"><geom type="plane" size="1 1 1"/>
        <body pos="0 0 .5"><geom type="box" size=".1 .1 .1"/></body></body>
        <body pos="2 0 1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"#,
    );
    let mut random = Random(8);
    let mut watch = Watch::new(&sim, &[], &[]);
    for _ in 0..20 {
        let axis: [f64; 4] = std::array::from_fn(|_| 0.0005 * random.next());
        sim.mocap_quat_mut().copy_from_slice(&[1.0, 0.0, 0.0, 0.0]);
        for _ in 0..1000 {
            let quaternion = sim.mocap_quat_mut();
            (0..4).for_each(|i| quaternion[i] += axis[i]);
            watch.look(&mut sim);
        }
    }
    assert!(watch.tally.clear < watch.tally.all, "{:?}", watch.tally);
    assert!(watch.tally.certified > watch.tally.clear / 2, "{:?}", watch.tally);
}

#[test]
fn contacts_that_are_switched_off_need_no_distance() {
    let mut sim =
        simulation("<mujoco><worldbody><geom size='1'/><body><freejoint/><geom size='1'/></body></worldbody></mujoco>");
    let collider = PairCollider::new(&sim, &[], &[]).unwrap();
    let mut clearance = Clearance::new(&sim, &collider).unwrap();
    sim.kinematics().unwrap();
    assert!(!clearance.certifies(&sim).unwrap());
    sim.set_contacts_enabled(false);
    assert!(clearance.certifies(&sim).unwrap());
    sim.set_contacts_enabled(true);
    assert!(!clearance.certifies(&sim).unwrap());
    // Apart, it is certain again after a while.
    sim.qpos_mut()[0] = 3.0;
    sim.kinematics().unwrap();
    assert!((0..30).any(|_| clearance.certifies(&sim).unwrap()));
    // A pose that is not a number is never certain, and forgotten when it is one again.
    sim.qpos_mut()[1] = f64::NAN;
    sim.kinematics().unwrap();
    assert!((0..50).all(|_| !clearance.certifies(&sim).unwrap()));
    sim.qpos_mut()[1] = 0.0;
    sim.kinematics().unwrap();
    assert!((0..30).any(|_| clearance.certifies(&sim).unwrap()));
}

#[test]
fn the_colliders_pairs_do_not_count_and_another_model_is_an_error() {
    let sim = {
        let mut sim = simulation(&robot::robot(""));
        sim.kinematics().unwrap();
        sim
    };
    let (hand, ball) = robot::hand_and_ball(&sim);
    let with = PairCollider::new(&sim, &hand, &ball).unwrap();
    let without = PairCollider::new(&sim, &[], &ball).unwrap();
    assert!(Clearance::new(&sim, &with).unwrap().certifies(&sim).unwrap());
    let mut clearance = Clearance::new(&sim, &without).unwrap();
    assert!(!clearance.certifies(&sim).unwrap());
    // as many geoms, fewer bodies
    let geoms = "<geom size='1'/>".repeat(sim.model().ngeom());
    let other = simulation(&format!("<mujoco><worldbody>{geoms}</worldbody></mujoco>"));
    assert!(matches!(clearance.certifies(&other), Err(Error::OtherModel { .. })));
    assert!(matches!(Clearance::new(&other, &with), Err(Error::OtherModel { .. })));
}

/// Times of both calls, ns, sorted, along steps with random velocities up to `speed` (rad/s and m/s).
fn times(speed: f64) -> [Vec<f64>; 2] {
    let mut sim = simulation(&robot::robot(r#"<option gravity="0 0 0"/>"#));
    let (hand, ball) = robot::hand_and_ball(&sim);
    let collider = PairCollider::new(&sim, &hand, &ball).unwrap();
    let mut clearance = Clearance::new(&sim, &collider).unwrap();
    let mut random = Random(7);
    let mut times = [vec![], vec![]];
    for step in 0..4000 {
        if step % 200 == 0 {
            sim.reset().unwrap();
            sim.qvel_mut().iter_mut().for_each(|v| *v = speed * random.next());
        }
        sim.step().unwrap();
        sim.kinematics().unwrap();
        let start = Instant::now();
        clearance.certifies(&sim).unwrap();
        times[0].push(start.elapsed().as_nanos() as f64);
        let start = Instant::now();
        sim.collision().unwrap();
        times[1].push(start.elapsed().as_nanos() as f64);
    }
    times.iter_mut().for_each(|times| times.sort_by(f64::total_cmp));
    times
}

#[test]
fn the_cost_of_certainty_is_printed() {
    let mut sim = simulation(&robot::robot(""));
    sim.kinematics().unwrap();
    let (hand, ball) = robot::hand_and_ball(&sim);
    let collider = PairCollider::new(&sim, &hand, &ball).unwrap();
    let mut clearance = Clearance::new(&sim, &collider).unwrap();
    let mut batches: Vec<f64> = (0..300)
        .map(|_| {
            let start = Instant::now();
            (0..20).for_each(|_| assert!(clearance.certifies(&sim).unwrap()));
            start.elapsed().as_nanos() as f64 / 20.0
        })
        .collect();
    batches.sort_by(f64::total_cmp);
    println!("at rest: {:.0} ns", batches[150]);
    for speed in [0.1, 0.5] {
        let times = times(speed);
        let [ours, engine] =
            times.each_ref().map(|times| [0.5, 0.9, 0.97].map(|part| times[(part * times.len() as f64) as usize]));
        println!("up to {speed} rad/s, ns at 50, 90, 97 %: {ours:.0?}; mj_collision {engine:.0?}");
    }
}

/// Asked at rest for a motion that then happens: the way of every body, and of two of them together, are those of the motion.
#[test]
fn what_outlasts_a_motion_touches_nothing_after_it() {
    let mut sim = simulation(&room("", 0.0));
    let mut random = Random(5);
    let (some, others) = sides(&sim);
    let collider = PairCollider::new(&sim, &some, &others).unwrap();
    // about the farthest point of each body from its centre, m
    const RADIUS: f64 = 0.2;
    let (mut asked, mut outlasted, mut finer, mut touched) = (0, 0, 0, 0);
    for round in 0..6000 {
        if round % 200 == 0 {
            sim.qvel_mut().iter_mut().for_each(|v| *v = random.next());
        }
        sim.step().unwrap();
        sim.kinematics().unwrap();
        let mut clearance = Clearance::new(&sim, &collider).unwrap();
        if !clearance.certifies(&sim).unwrap() {
            continue;
        }
        let before = sim.clone();
        let way: Vec<f64> = (0..sim.model().nbody())
            .map(|body| {
                let Ok(joint) = usize::try_from(sim.model().body_jntadr()[body]) else { return 0.0 };
                let slow = 0.02 * 0.1f64.powi((body % 3) as i32);
                let [shift, turn] = [(); 2].map(|()| slow * Vector3::new(random.next(), random.next(), random.next()));
                let at = sim.model().jnt_qposadr()[joint] as usize;
                let pose = &mut sim.qpos_mut()[at..at + 7];
                pose[..3].iter_mut().zip(shift.iter()).for_each(|(x, shift)| *x += shift);
                let was = Quaternion::new(pose[3], pose[4], pose[5], pose[6]);
                let now = UnitQuaternion::from_scaled_axis(turn) * UnitQuaternion::from_quaternion(was);
                pose[3..].copy_from_slice(&[now.w, now.i, now.j, now.k]);
                shift.norm() + RADIUS * turn.norm()
            })
            .collect();
        let most = way.iter().fold(0.0f64, |most, &way| most.max(way));
        let outlasts = clearance.outlasts(most, |[a, b]| way[a] + way[b]);
        sim.kinematics().unwrap();
        sim.collision().unwrap();
        let other = sim.contacts().find(|contact| !collider.covers(contact.geoms));
        assert!(!outlasts || other.is_none(), "round {round}: {other:?}");
        asked += 1;
        outlasted += usize::from(outlasts);
        finer += usize::from(outlasts && !clearance.outlasts(most, |_| f64::INFINITY));
        touched += usize::from(other.is_some());
        assert!(!clearance.outlasts(f64::NAN, |_| f64::NAN));
        sim = before;
    }
    println!("{outlasted} of {asked} motions, {finer} by what two bodies do; {touched} of them touched something");
    assert!(outlasted > asked / 10 && finer > asked / 50 && touched > 20, "{outlasted} {finer} {touched} of {asked}");
}
