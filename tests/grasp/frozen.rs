//! Steps on frozen geometry: the same grasp at a fraction of the work, and whole steps wherever that would not be so.

use crate::bits::bits;
use crate::claw::Claw;
use mujoco_grasp::grasp::{FROZEN_TOLERANCE, GraspId, Grasps, Limits, Phase};
use mujoco_grasp::mujoco::{PairCollider, Simulation};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;

/// Latched and at rest, with its grasps.
fn held(scenario: &str, limits: Limits) -> (Simulation, Grasps) {
    let plan = Plan::load_with(scenario, Some(limits)).expect("a built-in scenario");
    let mut runner = Runner::new(&plan, Mode::Grasp, None).expect("a runner");
    runner.advance_to(plan.timeline.measure_from()).expect("a hold");
    let (sim, grasps) = runner.into_parts();
    assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped);
    (sim, grasps)
}

/// The largest difference of the positions of two simulations.
fn apart(a: &Simulation, b: &Simulation) -> f64 {
    a.qpos().iter().zip(b.qpos()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// What has come of a push of 100 steps, after 250.
struct Pushed {
    /// Share of the steps that were frozen.
    frozen: f64,
    /// Steps with poses of their own and the inertia of an earlier one.
    kept: usize,
    /// The largest difference from whole steps, and of what is pushed from what is not.
    worst: f64,
    moved: f64,
}

fn pushed(mut sim: Simulation, mut grasps: Grasps, push: f64) -> Pushed {
    let mut whole = (sim.clone(), grasps.clone());
    let mut untouched = (sim.clone(), grasps.clone());
    let target = grasps[GraspId::FIRST].target().index();
    let before = grasps.frozen_steps();
    let (mut worst, mut moved, mut kept) = (0.0f64, 0.0f64, 0);
    for k in 0..250 {
        let made = (sim.xpos().to_vec(), sim.qLDiagInv().to_vec());
        let force = if k < 100 { push } else { 0.0 };
        sim.xfrc_applied_mut()[6 * target + 1] = force;
        whole.0.xfrc_applied_mut()[6 * target + 1] = force;
        grasps.substep(&mut sim).expect("a step");
        kept += usize::from(sim.xpos() != made.0 && sim.qLDiagInv() == made.1);
        whole.1.step(&mut whole.0).expect("a step");
        untouched.1.step(&mut untouched.0).expect("a step");
        worst = worst.max(apart(&sim, &whole.0));
        moved = moved.max(apart(&untouched.0, &whole.0));
    }
    for held in [&grasps, &whole.1] {
        assert_eq!(held[GraspId::FIRST].phase(), Phase::Grasped);
    }
    assert!(moved > 2e-5, "the push moves nothing, {moved} m");
    Pushed { frozen: (grasps.frozen_steps() - before) as f64 / 250.0, kept, worst, moved }
}

#[test]
fn a_pushed_target_moves_on_frozen_geometry_as_with_whole_steps() {
    // what spins between two fingers has nothing but friction to hold it: where it comes to rest is less certain
    let scenes = [("clutch", 0.4, 0.4, 0.0), ("pinch", 0.02, 0.4, 2.5e-4)];
    let tolerances = [(1e-3, 5e-3), (FROZEN_TOLERANCE, 1e-2)];
    let each = scenes.into_iter().flat_map(|scene| tolerances.map(|tolerance| (scene, tolerance)));
    for ((scenario, push, share, neutral), (tolerance, error)) in each {
        let (sim, mut grasps) = held(scenario, Limits::Cones);
        grasps.set_frozen_tolerance(tolerance);
        let Pushed { frozen, kept, worst, moved } = pushed(sim, grasps, push);
        println!(
            "{scenario}, {tolerance} rad: {worst} m apart, of {moved} m; {frozen} frozen, {kept} with a kept inertia"
        );
        assert!(frozen > share, "{scenario}: {frozen} of the steps were frozen");
        assert!(kept > 0, "{scenario}: no whole step kept its inertia");
        assert!(worst < error * moved + neutral, "{scenario}: {worst} m apart, of {moved} m that the push moves");
    }
}

/// The weld's rows stay, their references are computed anew; without bounds and with.
#[test]
fn a_merged_grasp_moves_on_frozen_geometry_as_with_whole_steps() {
    let scenes = [("clutch", Limits::Rigid, 0.4), ("clutch", Limits::Box, 0.4), ("pinch", Limits::Box, 0.3)];
    for (scenario, limits, push) in scenes {
        let (mut sim, grasps) = held(scenario, limits);
        sim.set_noslip_iterations(0).expect("no iterations");
        let Pushed { frozen, worst, moved, .. } = pushed(sim, grasps, push);
        println!("{scenario}, {limits:?}: {worst} m apart, of {moved} m; {frozen} frozen");
        assert!(frozen > 0.4, "{scenario}, {limits:?}: {frozen} of the steps were frozen");
        assert!(worst < 1e-2 * moved, "{scenario}, {limits:?}: {worst} m apart, of {moved} m that the push moves");
    }
}

#[test]
fn several_steps_end_as_single_ones_do_and_with_tolerance_0_are_the_same_bit_for_bit() {
    let (mut sim, mut grasps) = held("clutch", Limits::Cones);
    let mut single = (sim.clone(), grasps.clone());
    grasps.set_frozen_tolerance(0.0);
    grasps.steps(&mut sim, 25).expect("steps");
    for _ in 0..25 {
        single.1.step(&mut single.0).expect("a step");
    }
    assert_eq!(bits(&sim, &grasps), bits(&single.0, &single.1));
    assert_eq!(grasps.frozen_steps(), single.1.frozen_steps());
    // what there is to see is of the last step, whatever came before it
    grasps.set_frozen_tolerance(FROZEN_TOLERANCE);
    for _ in 0..2 {
        grasps.substep(&mut sim).expect("a step");
    }
    grasps.step(&mut sim).expect("a step");
    let mut single = (sim.clone(), grasps.clone());
    let mut before_last = None;
    grasps.steps(&mut sim, 10).expect("steps");
    single.1.step(&mut single.0).expect("a clone's first step is a whole one");
    for k in 1..10 {
        before_last = Some(single.0.qpos().to_vec());
        if k < 9 { single.1.substep(&mut single.0) } else { single.1.step(&mut single.0) }.expect("a step");
    }
    assert!(grasps.frozen_steps() >= 9 && single.1.frozen_steps() >= 7);
    assert!(apart(&sim, &single.0) < 2e-5, "{} m", apart(&sim, &single.0));
    let mut fresh = single.0.clone();
    fresh.qpos_mut().copy_from_slice(&before_last.expect("a state"));
    fresh.kinematics().expect("poses");
    assert_eq!(fresh.xpos(), single.0.xpos());
    assert_eq!(fresh.geom_xmat(), single.0.geom_xmat());
}

#[test]
fn whatever_a_user_changes_between_steps_is_noticed() {
    let (sim, grasps) = held("clutch", Limits::Cones);
    let frozen_after = |change: &dyn Fn(&mut Simulation, &mut Grasps)| {
        let (mut sim, mut grasps) = (sim.clone(), grasps.clone());
        for _ in 0..2 {
            grasps.substep(&mut sim).expect("a step");
        }
        grasps.step(&mut sim).expect("a whole step");
        change(&mut sim, &mut grasps);
        let before = grasps.frozen_steps();
        grasps.substep(&mut sim).expect("a step");
        grasps.frozen_steps() > before
    };
    assert!(frozen_after(&|_, _| ()));
    assert!(frozen_after(&|sim, _| sim.ctrl_mut()[0] += 1e-3), "inputs are read in every step");
    assert!(frozen_after(&|sim, _| sim.qvel_mut()[0] += 1e-6));
    assert!(!frozen_after(&|sim, _| sim.qpos_mut()[0] += 1e-9));
    assert!(!frozen_after(&|sim, _| sim.dof_damping_mut()[0] *= 2.0));
    assert!(!frozen_after(&|sim, _| sim.geom_friction_mut()[0] *= 0.9));
    assert!(!frozen_after(&|sim, _| sim.set_noslip_iterations(3).expect("iterations")));
    assert!(!frozen_after(&|sim, _| sim.set_timestep(1e-3).expect("a time step")));
    assert!(!frozen_after(&|sim, _| sim.forward().expect("a forward pass")));
    assert!(!frozen_after(&|sim, _| {
        let state = sim.save();
        sim.restore(&state).expect("its own state");
    }));
    assert!(!frozen_after(&|sim, _| *sim = sim.clone()), "another simulation has another geometry");
    assert!(!frozen_after(&|sim, grasps| grasps.restore(&grasps.save()).map(|()| drop(sim.save())).expect("a state")));
    assert!(!frozen_after(&|_, grasps| grasps[GraspId::FIRST].release()));
    assert!(!frozen_after(&|_, grasps| grasps.set_frozen_tolerance(f64::NAN)));
}

#[test]
fn a_hand_that_opens_lets_go_on_frozen_geometry_when_it_does_with_whole_steps() {
    let released = |whole: bool| {
        let mut claw = Claw::closed("claw.xml");
        let mut grasps = claw.grasps.clone();
        for _ in 0..400 {
            grasps.step(&mut claw.sim).expect("a step");
        }
        assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped);
        let open = vec![0.0; claw.sim.ctrl().len()];
        for k in 0..2000_usize {
            for (i, open) in open.iter().enumerate() {
                let now = claw.sim.ctrl()[i];
                claw.sim.ctrl_mut()[i] = now + 0.002 * (open - now);
            }
            if whole { grasps.step(&mut claw.sim) } else { grasps.substep(&mut claw.sim) }.expect("a step");
            if grasps[GraspId::FIRST].phase() == Phase::Ungrasped {
                return (k, grasps.frozen_steps());
            }
        }
        panic!("the hand has not let go");
    };
    let ((whole, none), (frozen, some)) = (released(true), released(false));
    assert!(none == 0 && (some > 20 || !PairCollider::supported()), "{some} frozen steps");
    assert!(whole.abs_diff(frozen) <= 10, "let go after {whole} whole steps, after {frozen} with frozen ones");
}

/// Ten thousand times, at rest and under a steady load: no bump, and after 40 s the target is where whole steps have it, with the
/// energy that they leave.
#[test]
fn going_in_and_out_of_frozen_geometry_is_no_bump() {
    for load in [0.0, 0.4] {
        let (mut sim, mut grasps) = held("clutch", Limits::Cones);
        sim.set_energy_enabled(true);
        let target = grasps[GraspId::FIRST].target();
        let joint = sim.model().free_joint_of(target).expect("a free joint");
        let adr = sim.model().jnt_qposadr()[joint.index()] as usize;
        let place = |sim: &Simulation| Vector3::from_column_slice(&sim.qpos()[adr..adr + 3]);
        sim.xfrc_applied_mut()[6 * target.index() + 1] = load;
        // until it has come to rest under the load
        for _ in 0..1000 {
            grasps.step(&mut sim).expect("a step");
        }
        let (step, before) = (sim.model().timestep(), grasps.frozen_steps());
        let mut whole = (sim.clone(), grasps.clone());
        let mut path = [place(&sim); 3];
        let mut worst = 0.0f64;
        for k in 0..10_000 {
            grasps.steps(&mut sim, 2).expect("a frozen step and a whole one");
            path = [path[1], path[2], place(&sim)];
            if k >= 2 {
                worst = worst.max((path[2] - 2.0 * path[1] + path[0]).norm() / (2.0 * step).powi(2));
            }
        }
        for _ in 0..20_000 {
            whole.1.step(&mut whole.0).expect("a step");
        }
        let frozen = grasps.frozen_steps() - before;
        let drift = (place(&sim) - place(&whole.0)).norm();
        let [energy, reference] = [&sim, &whole.0].map(|sim| sim.energy().iter().sum::<f64>());
        println!("{load} N: {frozen} goings, {worst} m/s^2, {drift} m and {} J from whole steps", energy - reference);
        assert!(frozen > 9_500, "{load} N: {frozen} of 10000");
        assert!(worst < 1e-3 * 9.81, "{load} N: a bump of {worst} m/s^2");
        assert!(drift < 1e-9, "{load} N: {drift} m from where whole steps have come to in 40 s");
        assert!((energy - reference).abs() < 1e-9, "{load} N: {energy} J, not {reference}");
    }
}

/// Contact points that roll three times as far as their bodies move, and are found a few steps late, keep up a trembling of 1 mm/s
/// (MuJoCo 2.2.2, where they are found by iterations). Whole steps bring it to rest, and at rest steps are frozen again.
#[test]
fn a_trembling_that_late_contacts_keep_up_ends() {
    let plan = Plan::load(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/rail.toml")).expect("a scenario");
    let mut runner = Runner::new(&plan, Mode::Grasp, None).expect("a runner");
    runner.advance_to(plan.timeline.duration).expect("a hold");
    let (mut sim, mut grasps) = runner.into_parts();
    assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped);
    let before = grasps.frozen_steps();
    let mut fastest = 0.0f64;
    for _ in 0..200 {
        grasps.substep(&mut sim).expect("a step");
        fastest = sim.qvel().iter().fold(fastest, |fastest, v| v.abs().max(fastest));
    }
    let frozen = grasps.frozen_steps() - before;
    assert!(fastest < 5e-5, "{fastest} m/s or rad/s");
    assert!(frozen > 150, "{frozen} of 200 steps were frozen");
}

/// Friction losses with a noslip pass are for the engine's solver, and so is every step beside them.
#[test]
fn a_merged_grasp_beside_rows_of_the_engines_solver_is_stepped_whole() {
    for (noslip, frozen) in [(0, true), (5, false)] {
        let mut claw = Claw::closed_as("claw.xml", |sim, spec| {
            spec.limits = Limits::Rigid;
            sim.set_noslip_iterations(noslip).expect("iterations");
            sim.dof_frictionloss_mut()[0] = 1e-3;
        });
        claw.run(0.5);
        let before = claw.grasps.frozen_steps();
        claw.grasps.steps(&mut claw.sim, 10).expect("steps");
        assert_eq!(claw.grasps.frozen_steps() > before, frozen, "noslip {noslip}");
    }
}
