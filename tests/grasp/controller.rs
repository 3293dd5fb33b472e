//! The grasp controller on a real hand: latching, holding, letting go.

use crate::claw::Claw;
use mujoco_grasp::grasp::{Error, GraspId, GraspSpec, Grasps, Phase};
use mujoco_grasp::mujoco::{Integrator, Model, Simulation};
use nalgebra::Vector3;

const GRAVITY: f64 = 9.81;

#[test]
fn latches_once_the_quality_is_good_and_keeps_holding() {
    for model in ["claw.xml", "claw4.xml"] {
        let mut claw = Claw::closed(model);
        assert_eq!(claw.grasp().phase(), Phase::Ungrasped);
        let start = claw.offset();
        claw.run(1.0);
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        assert_eq!(claw.grasp().contacts().len(), 5);
        assert!((claw.offset() - start).norm() < 1e-4, "{model} moved {}", claw.offset() - start);
    }
}

/// Latching and releasing a still grasp changes the target's acceleration by less than 1 % of g.
#[test]
fn both_swaps_are_bumpless() {
    for model in ["claw.xml", "claw4.xml"] {
        let mut claw = Claw::closed(model);
        claw.sim.set_noslip_iterations(100).expect("a number of iterations");
        claw.run_in_full_mode(1.0);
        let before = claw.acceleration();
        claw.grasps[GraspId::FIRST].allow_latch(true);
        let (mut worst, mut last) = (0.0f64, before);
        for _ in 0..100 {
            claw.step();
            worst = worst.max((claw.acceleration() - last).norm());
            last = claw.acceleration();
        }
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        assert!(worst < 0.01 * GRAVITY, "{model}: latch changes the acceleration by {worst} m/s^2");
        claw.grasps[GraspId::FIRST].release();
        claw.grasps[GraspId::FIRST].allow_latch(false);
        let mut worst = 0.0f64;
        for _ in 0..100 {
            claw.step();
            worst = worst.max((claw.acceleration() - last).norm());
            last = claw.acceleration();
        }
        assert_eq!(claw.grasp().phase(), Phase::Ungrasped);
        assert!(worst < 0.01 * GRAVITY, "{model}: release changes the acceleration by {worst} m/s^2");
    }
}

/// The grasp's contact forces are those of the engine's converged solve, contact by contact, while a push moves the target.
#[test]
fn contact_forces_follow_the_engine_under_a_push() {
    for (model, push) in [("claw.xml", [0.0, 1.0, 0.0]), ("claw.xml", [3.0, 0.0, 0.0]), ("claw4.xml", [-2.0, 0.0, 1.0])]
    {
        let mut full = Claw::closed(model);
        full.sim.set_noslip_iterations(100).expect("a number of iterations");
        full.run_in_full_mode(0.2);
        let mut latched = full.clone();
        latched.grasps[GraspId::FIRST].allow_latch(true);
        latched.run(0.2);
        full.run_in_full_mode(0.2);
        assert_eq!(latched.grasp().phase(), Phase::Grasped);
        let (mut moved, mut apart, mut forces, mut differences) = (0.0f64, 0.0f64, 0.0, 0.0);
        let start = full.offset();
        for _ in 0..500 {
            for claw in [&mut full, &mut latched] {
                claw.push(Vector3::from(push));
                claw.step();
            }
            moved = moved.max((full.offset() - start).norm());
            apart = apart.max((full.offset() - latched.offset()).norm());
            // link by link: a contact may be born a step earlier in one of the two
            for link in full.grasp().links() {
                let force = |claw: &Claw| -> Vector3<f64> {
                    claw.grasp().contacts().iter().filter(|c| c.link_id == *link).map(|c| c.force).sum()
                };
                forces += force(&full).norm_squared();
                differences += (force(&full) - force(&latched)).norm_squared();
            }
        }
        assert_eq!(latched.grasp().phase(), Phase::Grasped);
        assert!(moved > 1e-3, "{model}: the push does nothing");
        assert!(apart < 0.01 * moved, "{model}: {apart} m apart after {moved} m");
        let error = (differences / forces).sqrt();
        assert!(error < 0.01, "{model}: contact forces differ by {error}");
    }
}

#[test]
fn a_still_hand_does_not_creep() {
    let mut claw = Claw::closed("claw4.xml");
    claw.run(3.0);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    let start = claw.offset();
    claw.run(10.0);
    let creep = (claw.offset() - start).norm() / 10.0;
    assert!(creep < 1e-6, "{creep} m/s");
}

#[test]
fn opening_the_hand_releases_and_drops_the_target() {
    let mut claw = Claw::closed("claw.xml");
    claw.run(0.5);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    let start = claw.offset();
    claw.open();
    claw.run(1.0);
    assert_eq!(claw.grasp().phase(), Phase::Ungrasped);
    assert!(claw.grasp().contacts().is_empty());
    assert!((claw.offset() - start).z < -0.05, "the ball did not fall");
}

/// What a user sees of the grasp in mjData is what the contacts would have been: a constraint force that moves the target.
#[test]
fn grasp_forces_count_as_constraint_forces() {
    let mut claw = Claw::closed("claw.xml");
    claw.run(1.0);
    let dof = claw.target_dof();
    let up = claw.sim.qfrc_constraint()[dof + 2];
    assert!((up - 0.2 * GRAVITY).abs() < 1e-3, "{up} N hold the ball");
    assert!((claw.sim.qfrc_smooth()[dof + 2] + 0.2 * GRAVITY).abs() < 1e-9);
    assert!(claw.sim.qacc()[dof..dof + 6].iter().all(|a| a.abs() < 1e-3));
}

/// The same run twice, and from a copy in the middle: the same bits.
#[test]
fn grasped_runs_are_reproducible() {
    let mut first = Claw::closed("claw4.xml");
    first.push(Vector3::new(0.5, 0.5, 0.0));
    first.run(0.3);
    let mut second = first.clone();
    first.run(0.3);
    second.run(0.3);
    assert_eq!(first.sim.qpos(), second.sim.qpos());
    assert_eq!(first.sim.qvel(), second.sim.qvel());
}

const TWO_FINGERS: &str = r#"<mujoco><option integrator="Euler"/><worldbody>
  <body name="palm"><joint type="slide" axis="0 0 1"/><geom size=".02"/>
    <body name="left" pos="-.05 0 0"><joint type="slide" axis="1 0 0"/><geom size=".01"/></body>
    <body name="right" pos=".05 0 0"><joint type="slide" axis="1 0 0"/><geom size=".01"/></body>
  </body>
  <body name="ball" pos="0 0 .1"><freejoint/><geom size=".02"/></body>
  <body name="wall" pos="1 0 0"><geom size=".02"/></body>
</worldbody></mujoco>"#;

fn rejected(target: &str, palm: &str, effectors: &[&str], change: impl Fn(&mut GraspSpec)) -> String {
    let model = Model::from_xml_string(TWO_FINGERS).expect("a model");
    let sim = Simulation::new(&model).expect("a simulation");
    let body = |name: &str| sim.model().body(name).expect("a body");
    let mut spec = GraspSpec::new(body(target), body(palm));
    spec.effectors = effectors.iter().map(|e| body(e)).collect();
    change(&mut spec);
    Grasps::of(&sim, &spec).expect_err("a bad grasp").to_string()
}

#[test]
fn bad_grasps_are_named() {
    let same = |_: &mut GraspSpec| ();
    let message = rejected("ball", "palm", &["ball"], same);
    assert!(message.contains("\"ball\"") && message.contains("is the target"), "{message}");
    let message = rejected("wall", "palm", &["left"], same);
    assert!(message.contains("\"wall\"") && message.contains("static"), "{message}");
    let message = rejected("left", "palm", &["right"], same);
    assert!(message.contains("same kinematic tree"), "{message}");
    let message = rejected("ball", "left", &["right"], same);
    assert!(message.contains("\"right\"") && message.contains("below"), "{message}");
    let message = rejected("ball", "right", &[], same);
    assert!(message.contains("no effectors"), "{message}");
    let message = rejected("ball", "world", &[], same);
    assert!(message.contains("name the links"), "{message}");
    let message = rejected("ball", "world", &["world"], same);
    assert!(message.contains("effector body \"world\" does not"), "{message}");
    let message = rejected("ball", "palm", &[], |s| s.latch_quality = Some(-1.0));
    assert!(message.contains("latch_quality") && message.contains("positive"), "{message}");
    let message = rejected("ball", "palm", &[], |s| {
        s.latch_quality = Some(0.1);
        s.release_quality = Some(0.2);
    });
    assert!(message.contains("release_quality") && message.contains("below"), "{message}");
    let message = rejected("ball", "palm", &[], |s| {
        s.palm = None;
    });
    assert!(message.contains("neither a palm nor effectors"), "{message}");
}

#[test]
fn an_integrator_that_solves_contacts_within_a_step_is_refused() {
    let model = Model::from_xml_string(TWO_FINGERS).expect("a model");
    let mut sim = Simulation::new(&model).expect("a simulation");
    sim.set_integrator(Integrator::Rk4).expect("RK4");
    let spec = GraspSpec::new(sim.model().body("ball").expect("ball"), sim.model().body("palm").expect("palm"));
    assert!(matches!(Grasps::of(&sim, &spec), Err(Error::Integrator)));
}

#[test]
fn a_hand_that_touches_nothing_never_latches() {
    let model = Model::from_xml_string(TWO_FINGERS).expect("a model");
    let mut sim = Simulation::new(&model).expect("a simulation");
    let mut spec = GraspSpec::new(sim.model().body("ball").expect("ball"), sim.model().body("palm").expect("palm"));
    spec.latch_quality = Some(1e-9);
    spec.release_quality = Some(0.0);
    let mut grasps = Grasps::of(&sim, &spec).expect("a grasp");
    for _ in 0..100 {
        grasps.step(&mut sim).expect("a step");
        assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Ungrasped);
    }
    assert_eq!(grasps[GraspId::FIRST].quality(), 0.0);
}

/// It stayed in the warm start, and every step after was refused.
#[test]
fn a_bad_number_is_refused_by_its_name_and_the_grasp_goes_on_once_it_is_put_right() {
    let load = |claw: &mut Claw, x: f64| {
        let target = claw.grasp().target().index();
        claw.sim.xfrc_applied_mut()[6 * target + 1] = x;
        6 * target + 1
    };
    for (bad, substep) in [(f64::NAN, false), (f64::NAN, true), (1e300, false), (1e300, true)] {
        let mut claw = Claw::closed("claw.xml");
        claw.run(1.0);
        // the second begins on frozen geometry
        claw.grasps.substep(&mut claw.sim).expect("a step");
        let (start, time) = (claw.offset(), claw.sim.time());
        let entry = load(&mut claw, bad);
        let step = if substep { Grasps::substep } else { Grasps::step };
        for _ in 0..3 {
            let error = step(&mut claw.grasps, &mut claw.sim).expect_err("a bad number").to_string();
            let wanted = if bad.is_nan() { format!("xfrc_applied[{entry}] is NaN") } else { "a load".to_owned() };
            assert!(error.contains(&wanted), "{error}");
            assert_eq!(claw.sim.time(), time);
        }
        load(&mut claw, 0.0);
        claw.run(0.5);
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        assert!((claw.offset() - start).norm() < 1e-5, "{bad}: moved {}", claw.offset() - start);
    }
}

/// Forces that are no numbers were remembered, and every step after was refused.
#[test]
fn monitoring_forces_that_are_no_numbers_is_an_error_and_leaves_nothing() {
    let mut claw = Claw::closed("claw.xml");
    claw.run_in_full_mode(0.5);
    let saved = claw.sim.save();
    let target = claw.grasp().target().index();
    claw.sim.xfrc_applied_mut()[6 * target] = f64::NAN;
    claw.sim.forward().expect("the engine does not look");
    assert!(matches!(claw.grasps.monitor(&claw.sim), Err(Error::Diverged { .. })));
    claw.sim.restore(&saved).expect("a state");
    claw.grasps[GraspId::FIRST].allow_latch(true);
    claw.run(0.5);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
}
