//! Inverse kinematics against closed forms and against MuJoCo's own kinematics.

use mujoco_grasp::kinematics::{Error, InverseKinematics};
use mujoco_grasp::mujoco::{BodyId, JointId, Model, Simulation, SiteId};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// A planar arm of two links, 0.3 m and 0.2 m, on a palm that is turned and moved.
const ARM: &str = r#"<mujoco><compiler angle="radian"/><worldbody>
  <body name="palm" pos="0.5 -0.2 0.1" euler="0.3 -0.4 0.5"><geom size="0.01"/>
    <body name="upper"><joint name="shoulder" axis="0 0 1" range="-3 3" limited="true"/><geom size="0.01"/>
      <body name="lower" pos="0.3 0 0"><joint name="elbow" axis="0 0 1" range="-2.5 2.5" limited="true"/><geom size="0.01"/>
        <site name="tip" pos="0.2 0 0"/></body></body></body>
</worldbody></mujoco>"#;

fn sim(xml: &str) -> Simulation {
    let mut sim = Simulation::new(&Model::from_xml_string(xml).unwrap()).unwrap();
    sim.kinematics().unwrap();
    sim
}

fn pose(sim: &Simulation, body: BodyId) -> Isometry3<f64> {
    let q = &sim.xquat()[4 * body.index()..4 * body.index() + 4];
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
    Isometry3::from_parts(Translation3::from(sim.body_position(body)), rotation)
}

fn all_joints(sim: &Simulation) -> Vec<JointId> {
    sim.model().joints().collect()
}

fn arm() -> (Simulation, InverseKinematics, Isometry3<f64>) {
    let sim = sim(ARM);
    let palm = sim.model().body("palm").unwrap();
    let tip = sim.model().site("tip").unwrap();
    let ik = InverseKinematics::new(&sim, palm, &[tip], &all_joints(&sim)).unwrap();
    let frame = pose(&sim, palm);
    (sim, ik, frame)
}

fn in_world(frame: &Isometry3<f64>, x: f64, y: f64) -> Vector3<f64> {
    frame.transform_point(&nalgebra::Point3::new(x, y, 0.0)).coords
}

#[test]
fn two_links_reach_where_the_law_of_cosines_says() {
    let (_, mut ik, frame) = arm();
    for (x, y) in [(0.35, 0.1), (0.2, 0.25), (-0.1, 0.3), (0.15, -0.2), (0.05, 0.2)] {
        ik.start_at(|_| 0.3);
        let solution = ik.solve(&frame, &[in_world(&frame, x, y)]).unwrap();
        assert!(solution.residual < 1e-7, "{solution:?}");
        let (a, b) = (0.3_f64, 0.2_f64);
        let cos = (x * x + y * y - a * a - b * b) / (2.0 * a * b);
        let q: Vec<f64> = ik.values().collect();
        assert!((q[1].cos() - cos).abs() < 1e-5, "elbow {} at ({x}, {y})", q[1]);
        let shoulder = y.atan2(x) - (b * q[1].sin()).atan2(a + b * q[1].cos());
        assert!((q[0] - shoulder).sin().abs() < 1e-5, "shoulder {} instead of {shoulder}", q[0]);
    }
}

#[test]
fn a_goal_out_of_reach_stretches_the_arm_towards_it() {
    let (_, mut ik, frame) = arm();
    ik.start_at(|_| 0.4);
    let solution = ik.solve(&frame, &[in_world(&frame, 0.6, 0.8)]).unwrap();
    let q: Vec<f64> = ik.values().collect();
    assert!((solution.residual - 0.5).abs() < 1e-4, "{solution:?}");
    assert!((q[0] - 0.8_f64.atan2(0.6)).abs() < 2e-2 && q[1].abs() < 4e-2, "{q:?}");
}

#[test]
fn a_joint_on_its_limit_stays_there_and_the_other_one_takes_over() {
    let xml = ARM.replace("range=\"-2.5 2.5\"", "range=\"0.2 0.5\"");
    let sim = sim(&xml);
    let palm = sim.model().body("palm").unwrap();
    let frame = pose(&sim, palm);
    let tip = sim.model().site("tip").unwrap();
    let mut ik = InverseKinematics::new(&sim, palm, &[tip], &all_joints(&sim)).unwrap();
    // Near the base the elbow would have to bend by more than its 0.5 rad.
    ik.solve(&frame, &[in_world(&frame, 0.1, 0.2)]).unwrap();
    let q: Vec<f64> = ik.values().collect();
    assert_eq!(q[1], 0.5);
    // With a stiff elbow the best that the shoulder can do is to point the tip at the goal.
    let heading = q[0] + (0.2 * 0.5_f64.sin()).atan2(0.3 + 0.2 * 0.5_f64.cos());
    assert!((heading - 0.2_f64.atan2(0.1)).abs() < 1e-4, "{heading}");
}

#[test]
fn it_starts_within_limits_and_never_leaves_them() {
    let (sim, mut ik, frame) = arm();
    ik.start_at(|_| 100.0);
    let ranges = sim.model().jnt_range().to_vec();
    for k in 0..200 {
        let angle = f64::from(k) * 0.37;
        let reach = 0.7 * (f64::from(k) * 0.011).sin();
        ik.solve(&frame, &[in_world(&frame, reach * angle.cos(), reach * angle.sin())]).unwrap();
        for (j, q) in ik.values().enumerate() {
            assert!((ranges[2 * j]..=ranges[2 * j + 1]).contains(&q), "joint {j} at {q}");
        }
    }
}

fn claw() -> (Simulation, BodyId, Vec<SiteId>) {
    let mut sim = Simulation::new(&Model::from_xml_file("tests/data/claw.xml").unwrap()).unwrap();
    let key = sim.model().keyframe("open").unwrap();
    sim.reset_to_keyframe(key).unwrap();
    sim.kinematics().unwrap();
    let palm = sim.model().body("palm").unwrap();
    let tips = (0..5).map(|i| sim.model().site(&format!("f{i}_tip")).unwrap()).collect();
    (sim, palm, tips)
}

#[test]
fn tips_are_where_mujoco_says() {
    let (mut sim, palm, tips) = claw();
    let mut ik = InverseKinematics::new(&sim, palm, &tips, &all_joints(&sim)).unwrap();
    for k in 0..20 {
        for (i, q) in sim.qpos_mut()[1..21].iter_mut().enumerate() {
            *q = 0.35 * (f64::from(k) + 1.7 * i as f64).sin();
        }
        sim.kinematics().unwrap();
        ik.start_from(&sim);
        let mut points = vec![Vector3::zeros(); 5];
        ik.tips(&mut points);
        for (point, tip) in points.iter().zip(&tips) {
            let world = pose(&sim, palm).transform_point(&(*point).into()).coords;
            assert!((world - sim.site_position(*tip)).norm() < 1e-14);
        }
    }
}

#[test]
fn five_fingers_reach_their_goals_without_touching_the_simulation() {
    let (sim, palm, tips) = claw();
    let before = sim.save();
    let mut ik = InverseKinematics::new(&sim, palm, &tips, &all_joints(&sim)).unwrap();
    assert_eq!(ik.joints().len(), 20, "the wrist is above the palm, the ball has no part in it");
    let goals: Vec<Vector3<f64>> =
        (0..5).map(|i| sim.site_position(sim.model().site(&format!("goal{i}")).unwrap())).collect();
    let solution = ik.solve(&pose(&sim, palm), &goals).unwrap();
    assert!(solution.residual < 1e-7, "{solution:?}");
    assert_eq!(sim.save(), before);
    // What it found is where MuJoCo puts the tips.
    let mut check = sim.clone();
    for (joint, value) in ik.joints().to_vec().into_iter().zip(ik.values()) {
        let address = check.model().jnt_qposadr()[joint.index()] as usize;
        check.qpos_mut()[address] = value;
    }
    check.kinematics().unwrap();
    for (tip, goal) in tips.iter().zip(&goals) {
        assert!((check.site_position(*tip) - goal).norm() < 1e-7);
    }
}

#[test]
fn fingers_that_share_a_joint_are_solved_together() {
    // One slide carries two fingers: both goals are met only if it moves by 0.05 m.
    let xml = r#"<mujoco><worldbody><body name="palm"><geom size="0.01"/>
      <body name="carriage"><joint name="rail" type="slide" axis="0 0 1"/><geom size="0.01"/>
        <body name="l" pos="0.1 0 0"><joint name="jl" type="slide" axis="1 0 0"/><geom size="0.01"/><site name="l"/></body>
        <body name="r" pos="-0.1 0 0"><joint name="jr" type="slide" axis="1 0 0"/><geom size="0.01"/><site name="r"/></body>
      </body></body></worldbody></mujoco>"#;
    let sim = sim(xml);
    let site = |name: &str| sim.model().site(name).unwrap();
    let palm = sim.model().body("palm").unwrap();
    let mut ik = InverseKinematics::new(&sim, palm, &[site("l"), site("r")], &all_joints(&sim)).unwrap();
    let goals = [Vector3::new(0.12, 0.0, 0.05), Vector3::new(-0.07, 0.0, 0.05)];
    assert!(ik.solve(&Isometry3::identity(), &goals).unwrap().residual < 1e-7);
    let q: Vec<f64> = ik.values().collect();
    for (found, expected) in q.iter().zip([0.05, 0.02, 0.03]) {
        assert!((found - expected).abs() < 1e-6, "{q:?}");
    }
}

#[test]
fn what_cannot_be_solved_is_said() {
    let (sim, palm, tips) = claw();
    let goal = sim.model().site("goal0").unwrap();
    let error = InverseKinematics::new(&sim, palm, &[goal], &all_joints(&sim)).unwrap_err();
    assert!(matches!(&error, Error::NotBelow { site, palm } if site == "goal0" && palm == "palm"), "{error}");
    let error = InverseKinematics::new(&sim, palm, &tips, &[]).unwrap_err();
    assert!(matches!(&error, Error::NoJoint { site, .. } if site == "f0_tip"), "{error}");
    let mut ik = InverseKinematics::new(&sim, palm, &tips, &all_joints(&sim)).unwrap();
    assert!(ik.solve(&pose(&sim, palm), &[Vector3::zeros()]).is_err());
    let ball = ARM.replace(
        "<joint name=\"elbow\" axis=\"0 0 1\" range=\"-2.5 2.5\" limited=\"true\"/>",
        "<joint name=\"elbow\" type=\"ball\"/>",
    );
    let sim = self::sim(&ball);
    let tip = sim.model().site("tip").unwrap();
    let error = InverseKinematics::new(&sim, sim.model().body("palm").unwrap(), &[tip], &all_joints(&sim)).unwrap_err();
    assert!(matches!(&error, Error::Joint { joint } if joint == "elbow"), "{error}");
}
