//! The weld with the merged effectors, with the thesis's bounds ("box") and without ("rigid").

use crate::claw::Claw;
use mujoco_grasp::grasp::{Error, GraspContact, GraspId, GraspSpec, Grasps, Limits, Phase, weld_xml};
use mujoco_grasp::mujoco::{Cone, JacobianStorage, Model, Simulation};
use nalgebra::{UnitQuaternion, Vector3};

const GRAVITY: f64 = 9.81;
const MERGED: [Limits; 2] = [Limits::Box, Limits::Rigid];

fn held(file: &str, limits: Limits) -> Claw {
    let mut claw = Claw::closed_as(file, |_, spec| spec.limits = limits);
    claw.run(0.2);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    claw
}

/// The largest change of the target's acceleration from step to step.
fn worst_jump(claw: &mut Claw, steps: usize) -> f64 {
    let (mut worst, mut last) = (0.0f64, claw.acceleration());
    for _ in 0..steps {
        claw.step();
        worst = worst.max((claw.acceleration() - last).norm());
        last = claw.acceleration();
    }
    worst
}

#[test]
fn both_swaps_of_a_still_grasp_are_bumpless() {
    for limits in MERGED {
        for (file, cone) in [("claw.xml", Cone::Elliptic), ("claw4.xml", Cone::Elliptic), ("claw.xml", Cone::Pyramidal)]
        {
            let mut claw = Claw::closed_as(file, |sim, spec| {
                spec.limits = limits;
                sim.set_noslip_iterations(100).expect("a number of iterations");
                sim.set_cone(cone).expect("a cone");
            });
            claw.run_in_full_mode(1.0);
            claw.grasps[GraspId::FIRST].allow_latch(true);
            let latch = worst_jump(&mut claw, 100);
            assert_eq!(claw.grasp().phase(), Phase::Grasped);
            assert!(latch < 0.01 * GRAVITY, "{limits:?} {file} {cone:?}: latch changes the acceleration by {latch}");
            claw.grasps[GraspId::FIRST].release();
            claw.grasps[GraspId::FIRST].allow_latch(false);
            let release = worst_jump(&mut claw, 100);
            assert_eq!(claw.grasp().phase(), Phase::Ungrasped);
            assert!(
                release < 0.01 * GRAVITY,
                "{limits:?} {file} {cone:?}: release changes the acceleration by {release}"
            );
        }
    }
}

#[test]
fn a_still_grasp_does_not_creep_and_carries_the_weight() {
    for limits in MERGED {
        let mut claw = held("claw4.xml", limits);
        claw.run(2.0);
        let start = claw.offset();
        claw.run(5.0);
        let creep = (claw.offset() - start).norm() / 5.0;
        assert!(creep < 1e-6, "{limits:?}: {creep} m/s");
        let wrench = claw.grasp().merged_wrench().expect("a merged grasp");
        assert!((wrench[2] - 0.2 * GRAVITY).abs() < 1e-3, "{limits:?}: {wrench}");
        // the weld's rows and the contacts say the same
        let sum: Vector3<f64> = claw.grasp().contacts().iter().map(|c| c.force).sum();
        assert!((sum - wrench.fixed_rows::<3>(0)).norm() < 1e-3, "{sum} {wrench}");
        let dof = claw.target_dof();
        assert!((claw.sim.qfrc_constraint()[dof + 2] - 0.2 * GRAVITY).abs() < 1e-3);
    }
}

/// While every contact sticks, the merged grasp is the engine's own solution: a push and its end.
#[test]
fn follows_the_engine_while_all_contacts_stick() {
    for limits in MERGED {
        for push in [[1.0, 0.0, 0.0], [0.0, 3.0, 0.0], [-1.8, 1.5, 1.87], [0.0, 0.0, -3.0]] {
            let mut fast = Claw::closed_as("claw.xml", |sim, spec| {
                spec.limits = limits;
                sim.set_noslip_iterations(100).expect("a number of iterations");
            });
            let mut full = fast.clone();
            full.grasps[GraspId::FIRST].allow_latch(false);
            fast.run(0.2);
            full.run(0.2);
            assert_eq!((fast.grasp().phase(), full.grasp().phase()), (Phase::Grasped, Phase::Ungrasped));
            let start = full.offset();
            let (mut squares, mut peak) = (0.0, 0.0f64);
            let (mut wrong, mut all) = (0.0, 0.0);
            for step in 0..1000 {
                let force = if step < 500 { Vector3::from(push) } else { Vector3::zeros() };
                for claw in [&mut fast, &mut full] {
                    claw.push(force);
                    claw.step();
                }
                squares += (fast.offset() - full.offset()).norm_squared();
                peak = peak.max((full.offset() - start).norm());
                for b in full.grasp().contacts() {
                    let same = |a: &&GraspContact| a.geoms == b.geoms;
                    let a = fast.grasp().contacts().iter().find(same).expect("the same contacts");
                    wrong += (a.force - b.force).norm_squared();
                    all += b.force.norm_squared();
                }
            }
            assert_eq!(fast.grasp().phase(), Phase::Grasped);
            let rms = (squares / 1000.0f64).sqrt();
            assert!(peak > 3e-4, "{push:?} moves the target by {peak}");
            assert!(rms < 0.01 * peak + 4e-5, "{limits:?} {push:?}: {rms} of {peak}");
            assert!((wrong / all).sqrt() < 0.05, "{limits:?} {push:?}: forces off by {}", (wrong / all).sqrt());
        }
    }
}

/// 12 N along the fingers: the contacts slide and the ball is lost, with a weld it is not; and with bounds it is lost at
/// 9 N already, which the contacts hold.
#[test]
fn box_slips_at_its_bound_and_rigid_never_does() {
    let push = |limits, force: f64| {
        let mut claw = held("claw.xml", limits);
        let start = claw.offset();
        claw.push(Vector3::new(0.0, 0.0, -force));
        claw.run(1.0);
        (claw.grasp().phase() == Phase::Grasped, (claw.offset() - start).norm())
    };
    let (kept, moved) = push(Limits::Rigid, 12.0);
    assert!(kept && moved < 3e-3, "rigid moved by {moved}");
    assert!(!push(Limits::Cones, 12.0).0);
    assert!(push(Limits::Cones, 9.0).0);
    let (kept, moved) = push(Limits::Box, 9.0);
    assert!(!kept && moved > 0.05, "box moved by {moved}");
    assert!(push(Limits::Box, 5.0).0);
}

/// Thesis Eqs. 4.1 and 4.3: no more than `sum mu_i f_i . n_i` of the step before, and just that while it slips.
#[test]
fn the_force_across_a_slipping_box_is_its_bound() {
    let mut claw = held("claw.xml", Limits::Box);
    claw.push(Vector3::new(0.0, 0.0, -9.0));
    let mut at_bound = 0;
    for _ in 0..30 {
        let bound = claw.grasp().bounds().expect("a box").force;
        let normals: f64 = claw.grasp().contacts().iter().map(|c| c.normal_force()).sum();
        assert!((bound - normals).abs() < 1e-9, "mu is 1: {bound} {normals}");
        claw.step();
        let force = claw.grasp().merged_wrench().expect("a box")[2];
        assert!(force <= bound * (1.0 + 1e-9), "{force} above {bound}");
        at_bound += usize::from(force >= bound * (1.0 - 1e-9));
    }
    assert!(at_bound >= 15, "at its bound in {at_bound} of 30 steps");
    assert!(claw.grasp().contacts().iter().all(|c| c.is_sliding()));
}

#[test]
fn a_slip_does_not_spring_back() {
    let mut claw = held("claw.xml", Limits::Box);
    let start = claw.offset();
    claw.push(Vector3::new(0.0, 0.0, -8.0));
    claw.run(0.04);
    claw.push(Vector3::zeros());
    claw.run(0.1);
    let slipped = (start - claw.offset()).z;
    claw.run(2.0);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    let stays = (start - claw.offset()).z;
    assert!(slipped > 2e-3 && (stays - slipped).abs() < 0.05 * slipped, "{slipped} then {stays}");
}

/// Only relaxed axes have bounds, and they are those of the target's frame turned by `axes`.
#[test]
fn only_the_relaxed_axes_slip() {
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let lost = |relaxed: [bool; 6], axes| {
        let mut claw = Claw::closed_as("claw.xml", |_, spec| {
            (spec.limits, spec.relaxed, spec.axes) = (Limits::Box, relaxed, axes);
        });
        claw.run(0.2);
        let count = relaxed.iter().filter(|r| **r).count();
        assert_eq!((claw.sim.ne(), claw.sim.nf()), (6 - count, count), "rigid rows come first");
        claw.push(Vector3::new(0.0, 0.0, -10.0));
        claw.run(0.5);
        claw.grasp().phase() == Phase::Ungrasped
    };
    let only = |axis: usize| std::array::from_fn(|i| i == axis);
    let straight = UnitQuaternion::identity();
    assert!(lost(only(2), straight), "the axis of the push");
    assert!(!lost(only(1), straight) && !lost(only(4), straight) && !lost([false; 6], straight));
    // turned by 90 degrees about x, the second axis is the world's z
    assert!(lost(only(1), quarter) && !lost(only(2), quarter));
}

#[test]
fn opening_the_hand_releases_and_drops_the_target() {
    for limits in MERGED {
        let mut claw = held("claw.xml", limits);
        let start = claw.offset();
        claw.open();
        claw.run(1.0);
        assert_eq!(claw.grasp().phase(), Phase::Ungrasped, "{limits:?}");
        assert!(claw.grasp().merged_wrench().is_none() && claw.grasp().bounds().is_none());
        assert!((claw.offset() - start).z < -0.05, "{limits:?}: the ball did not fall");
    }
}

/// A dense Jacobian, and for bounded rows no noslip pass, for as long as the grasp is latched.
/// With one finger left the rows of the weld would hold the target by nothing, for the rest of the release time.
#[test]
fn a_weld_to_effectors_that_no_longer_resist_all_motions_is_given_up_at_once() {
    for limits in MERGED {
        let mut claw = Claw::closed_as("claw.xml", |_, spec| {
            spec.limits = limits;
            spec.release_time = 1e3;
        });
        claw.run(0.2);
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        claw.open();
        while claw.grasp().phase() == Phase::Grasped {
            assert!(claw.grasp().quality() > 0.0, "{limits:?}: still merged without quality");
            assert!(claw.sim.time() < 10.0, "{limits:?}: never given up");
            claw.step();
        }
        assert_eq!(claw.grasp().quality(), 0.0);
    }
}

#[test]
fn the_users_solver_settings_come_back() {
    let settings = |claw: &Claw| (claw.sim.model().noslip_iterations(), claw.sim.model().jacobian_storage());
    for (limits, noslip) in [(Limits::Box, 0), (Limits::Rigid, 7)] {
        let mut ends = Vec::new();
        for storage in [JacobianStorage::Sparse, JacobianStorage::Dense] {
            let mut claw = Claw::closed_as("claw.xml", |sim, spec| {
                spec.limits = limits;
                sim.set_noslip_iterations(7).expect("a number");
                sim.set_jacobian_storage(storage).expect("a storage");
            });
            claw.run(0.5);
            assert_eq!(claw.grasp().phase(), Phase::Grasped);
            assert_eq!(settings(&claw), (noslip, JacobianStorage::Dense));
            ends.push(claw.offset());
            let mut alone = claw.clone();
            alone.grasps.restore_settings(&mut alone.sim).expect("restoring");
            assert_eq!(settings(&alone), (7, storage));
            claw.grasps[GraspId::FIRST].release();
            claw.grasps[GraspId::FIRST].allow_latch(false);
            claw.step();
            assert_eq!(settings(&claw), (7, storage));
            let weld = claw.sim.model().equalities().last().expect("the weld");
            assert!(!claw.sim.is_equality_active(weld).expect("it exists"));
            assert_eq!(claw.sim.ne(), 0);
        }
        assert!((ends[0] - ends[1]).norm() < 1e-9, "{limits:?}: {ends:?}");
    }
}

fn claw_with(extra: &str) -> Simulation {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    Simulation::new(&Model::from_xml_file_with(path, extra).expect("the claw")).expect("a simulation")
}

fn grasp_of(sim: &Simulation, limits: Limits) -> Result<Grasps, Error> {
    let body = |name| sim.model().body(name).expect("a body");
    let mut spec = GraspSpec::new(body("object"), body("palm"));
    spec.limits = limits;
    Grasps::of(sim, &spec)
}

#[test]
fn a_model_without_its_weld_is_refused_with_advice() {
    let none = claw_with("");
    assert!(grasp_of(&none, Limits::Cones).is_ok());
    for limits in MERGED {
        let message = grasp_of(&none, limits).expect_err("no weld").to_string();
        assert!(
            message.contains("object") && message.contains(limits.name()) && message.contains("weld_xml"),
            "{message}"
        );
    }
    // one between other bodies does not count
    let other = claw_with("<equality><weld body1=\"f0_1\" body2=\"f1_1\" active=\"false\"/></equality>");
    assert!(matches!(grasp_of(&other, Limits::Box), Err(Error::NoWeld { .. })));
    let active = claw_with("<equality><weld body1=\"palm\" body2=\"object\"/></equality>");
    assert!(matches!(grasp_of(&active, Limits::Rigid), Err(Error::WeldActive(_))));
    // with the hand on its other side, in either order
    assert!(grasp_of(&claw_with(&weld_xml("object", Some("f3_3"))), Limits::Box).is_ok());
    let turned = claw_with("<equality><weld body1=\"object\" body2=\"palm\" active=\"false\"/></equality>");
    assert!(grasp_of(&turned, Limits::Box).is_ok());
}

/// Equality constraints of the user's own stay what they are; the weld has to come after them.
#[test]
fn other_equality_constraints_stay_in_force() {
    let tie = "<equality><joint joint1=\"f0_dip\" joint2=\"f1_dip\"/></equality>";
    for (extra, sound) in
        [(format!("{tie}{}", weld_xml("object", None)), true), (format!("{}{tie}", weld_xml("object", None)), false)]
    {
        let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
        let model = Model::from_xml_file_with(path, &extra).expect("the claw");
        let mut claw = Claw::closed_from(&model, |_, spec| spec.limits = Limits::Box);
        let error = (0..100).find_map(|_| claw.try_step().err());
        match error {
            None => {
                assert!(sound && claw.grasp().phase() == Phase::Grasped && (claw.sim.ne(), claw.sim.nf()) == (1, 6))
            }
            Some(error) => assert!(!sound && matches!(error, Error::WeldRows { .. }), "{error}"),
        }
        let angle = |name| {
            claw.sim.qpos()[claw.sim.model().jnt_qposadr()[claw.sim.model().joint(name).expect("it").index()] as usize]
        };
        assert!((angle("f0_dip") - angle("f1_dip")).abs() < 1e-3);
    }
}
