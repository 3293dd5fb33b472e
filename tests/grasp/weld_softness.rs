//! Springs and dampers that the user gives to the axes of the weld, in the forms "box" and "rigid".

use crate::claw::Claw;
use mujoco_grasp::grasp::{Error, GraspId, GraspSpec, Grasps, Limits, Phase, weld_xml};
use mujoco_grasp::mujoco::{Model, Simulation};
use nalgebra::Vector3;

/// Impedance, the same at all displacements: the law of the axis is linear.
const IMPEDANCE: f64 = 0.9;
const SOLIMP: [f64; 5] = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0];
/// What a soft axis is to have \[N/m, N s/m\].
const STIFFNESS: f64 = 2000.0;
const DAMPING: f64 = 40.0;
/// Axis along the fingers, in which the ball can move against them without leaving them.
const ALONG: usize = 2;

/// `solref` of an axis with that stiffness and damping between ball and palm: MuJoCo's are per inverse weight, times
/// `1 - d` (at rest `f = K d x / R`, `R = (1 - d) / d A`, `K = k / d^2`).
fn solref(sim: &Simulation) -> [f64; 2] {
    let weight = |name| sim.model().body_invweight0()[2 * sim.model().body(name).expect("a body").index()];
    let scale = (1.0 - IMPEDANCE) * (weight("object") + weight("palm"));
    [-STIFFNESS * scale, -DAMPING * scale]
}

fn held(change: impl Fn(&Simulation, &mut GraspSpec)) -> Claw {
    let mut claw = Claw::closed_as("claw4.xml", |sim, spec| {
        spec.limits = Limits::Box;
        change(sim, spec);
    });
    claw.run(0.5);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    claw
}

/// How far a force moves the ball in the palm's frame, at rest \[m\].
fn deflection(claw: &Claw, force: Vector3<f64>) -> Vector3<f64> {
    let mut claw = claw.clone();
    let start = claw.offset();
    claw.push(force);
    claw.run(1.0);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    assert!(claw.acceleration().norm() < 1e-3, "not at rest: {}", claw.acceleration());
    claw.offset() - start
}

/// The axis along the fingers may slip and is soft; the others are as the contacts are.
fn soft_along(sim: &Simulation, spec: &mut GraspSpec) {
    spec.relaxed = std::array::from_fn(|axis| axis == ALONG);
    (spec.relaxed_solref, spec.relaxed_solimp) = (Some(solref(sim)), Some(SOLIMP));
}

#[test]
fn a_soft_axis_deflects_by_force_over_stiffness_and_the_others_do_not() {
    let soft = held(soft_along);
    let hard = held(|_, spec| spec.relaxed = [false; 6]);
    for force in [0.4, -0.4] {
        let push = Vector3::new(0.0, 0.0, force);
        let (soft, hard) = (deflection(&soft, push), deflection(&hard, push));
        let expected = force / STIFFNESS;
        assert!((soft[ALONG] - expected).abs() < 0.01 * expected.abs(), "{soft}, not {expected}");
        assert!(soft.xy().norm() < 0.01 * expected.abs(), "{soft}");
        assert!((hard[ALONG] - expected).abs() > 0.1 * expected.abs(), "{hard}");
    }
    for push in [Vector3::new(0.4, 0.0, 0.0), Vector3::new(0.0, -0.4, 0.0)] {
        let (soft, hard) = (deflection(&soft, push), deflection(&hard, push));
        assert!((soft - hard).norm() < 0.02 * hard.norm(), "{soft} {hard}");
    }
}

/// The displacement since the latch goes on where poses are frozen.
#[test]
fn a_soft_axis_swings_on_frozen_geometry_as_with_whole_steps() {
    let mut frozen = held(soft_along);
    let mut whole = frozen.clone();
    let (start, before) = (frozen.offset(), frozen.grasps.frozen_steps());
    let (mut moved, mut apart) = (0.0f64, 0.0f64);
    for _ in 0..50 {
        for claw in [&mut frozen, &mut whole] {
            claw.push(Vector3::new(0.0, 0.0, 0.4));
        }
        frozen.grasps.steps(&mut frozen.sim, 10).expect("steps");
        (0..10).for_each(|_| whole.step());
        moved = moved.max((whole.offset() - start).norm());
        apart = apart.max((frozen.offset() - whole.offset()).norm());
    }
    let share = (frozen.grasps.frozen_steps() - before) as f64 / 500.0;
    assert!(share > 0.6, "{share} of the steps were frozen");
    // without that the spring is no longer felt, and it is a fifth off
    assert!(moved > 2e-4 && apart < 0.03 * moved, "{apart} m apart, of {moved} m");
}

/// `solref` and `solimp` are those of all axes without bounds.
#[test]
fn rigid_axes_have_a_softness_of_their_own() {
    let soft = held(|sim, spec| {
        spec.limits = Limits::Rigid;
        (spec.solref, spec.solimp) = (Some(solref(sim)), Some(SOLIMP));
        // of no meaning here
        spec.relaxed_solref = Some([0.5, 1.0]);
    });
    for axis in 0..3 {
        let mut push = Vector3::zeros();
        push[axis] = 0.4;
        let moved = deflection(&soft, push);
        assert!((moved[axis] - 0.4 / STIFFNESS).abs() < 0.01 * 0.4 / STIFFNESS, "{moved} under {push}");
    }
}

/// Up to its bound a soft axis is a spring; at its bound it slips, and then the spring takes it back by its own deflection.
#[test]
fn a_soft_axis_with_a_bound_yields_at_it() {
    let mut claw = held(soft_along);
    let start = claw.offset();
    claw.push(Vector3::new(0.0, 0.0, -0.4));
    claw.run(0.5);
    claw.push(Vector3::zeros());
    claw.run(0.5);
    assert!((claw.offset() - start).norm() < 5e-6, "within its bound it comes back: {}", claw.offset() - start);

    let bound = claw.grasp().bounds().expect("a box").force;
    let weight = claw.grasp().merged_wrench().expect("merged")[ALONG];
    claw.push(Vector3::new(0.0, 0.0, -(1.1 * bound - weight)));
    let mut held_back = 0.0f64;
    for _ in 0..24 {
        let bound = claw.grasp().bounds().expect("a box").force;
        claw.step();
        let force = claw.grasp().merged_wrench().expect("merged")[ALONG];
        assert!(force <= bound * (1.0 + 1e-9), "{force} above {bound}");
        held_back = held_back.max(force / bound);
    }
    assert!(held_back > 1.0 - 1e-9, "it slips: {held_back}");
    claw.push(Vector3::zeros());
    claw.run(0.05);
    let slipped = claw.offset();
    claw.run(1.0);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    let back = (claw.offset() - slipped).z;
    let spring = (bound - weight) / STIFFNESS;
    assert!((start - claw.offset()).z > 1e-3, "it has slipped for good: {}", start - claw.offset());
    assert!(back < 1.2 * spring, "the spring gives back {back}, not more than {spring}");
}

#[test]
fn a_latch_with_soft_axes_gives_no_bump() {
    let mut claw = Claw::closed_as("claw4.xml", |sim, spec| {
        sim.set_noslip_iterations(100).expect("a number of iterations");
        spec.limits = Limits::Box;
        soft_along(sim, spec);
        (spec.solref, spec.solimp) = (Some(solref(sim)), Some(SOLIMP));
    });
    claw.run_in_full_mode(1.0);
    claw.grasps[GraspId::FIRST].allow_latch(true);
    let mut last = claw.acceleration();
    for _ in 0..200 {
        claw.step();
        assert!((claw.acceleration() - last).norm() < 0.01 * 9.81, "{}", claw.acceleration() - last);
        last = claw.acceleration();
    }
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
}

#[test]
fn a_saved_state_has_the_displacement_of_soft_axes() {
    let mut claw = held(soft_along);
    claw.push(Vector3::new(0.1, 0.0, -0.4));
    claw.run(0.05);
    let (state, grasps) = (claw.sim.save(), claw.grasps.save());
    claw.run(0.1);
    let end = claw.sim.qpos().to_vec();
    claw.sim.restore(&state).expect("a state");
    claw.grasps.restore(&grasps).expect("a state");
    claw.run(0.1);
    assert_eq!(claw.sim.qpos(), end);
    // of a grasp without soft axes it is refused
    let mut other = held(|_, spec| spec.relaxed = std::array::from_fn(|axis| axis == ALONG));
    let error = other.grasps.restore(&grasps).expect_err("another spec").to_string();
    assert!(error.contains("softness"), "{error}");
}

#[test]
fn numbers_that_make_no_sense_are_refused_with_what_would_be_right() {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    let model = Model::from_xml_file_with(path, &weld_xml("object", None)).expect("the claw");
    let sim = Simulation::new(&model).expect("a simulation");
    let refused = |change: &dyn Fn(&mut GraspSpec), needed: &[&str]| {
        let body = |name| sim.model().body(name).expect("a body");
        let mut spec = GraspSpec::new(body("object"), body("palm"));
        spec.limits = Limits::Box;
        change(&mut spec);
        let error = Grasps::of(&sim, &spec).expect_err("a bad spec");
        assert!(matches!(error, Error::Softness { .. }), "{error}");
        let message = error.to_string();
        assert!(needed.iter().all(|needed| message.contains(needed)), "{message}");
    };
    refused(&|spec| spec.solref = Some([0.02, -1.0]), &["solref", "-1", "damping ratio", "-stiffness"]);
    refused(&|spec| spec.relaxed_solref = Some([f64::NAN, 1.0]), &["relaxed_solref", "NaN"]);
    refused(&|spec| spec.solimp = Some([0.9, 1.5, 0.001, 0.5, 2.0]), &["solimp", "1.5", "d_width", "between 0 and 1"]);
    refused(&|spec| spec.relaxed_solimp = Some([0.9, 0.9, -0.001, 0.5, 2.0]), &["relaxed_solimp", "width at least 0"]);
}
