//! Latch and release of the built-in grasps at rest: the target's acceleration changes by less than 1 % of g.

use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Phase};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;

const GRAVITY: f64 = 9.81;
const STEPS: usize = 100;

/// Largest change of the target's acceleration from step to step, at the latch and at the release \[m/s^2\].
fn bumps(scenario: &str) -> [f64; 2] {
    let plan = Plan::load(scenario).expect("a built-in scenario");
    let mut runner = Runner::new(&plan, Mode::Full, None).expect("a runner");
    // the reference that grasp mode takes over from neither creeps nor is left unconverged
    runner.sim_mut().set_noslip_iterations(100).expect("iterations");
    runner.sim_mut().set_noslip_tolerance(0.0).expect("a tolerance");
    runner.advance_to(plan.timeline.measure_from()).expect("a hold");
    let (mut sim, mut grasps) = runner.into_parts();
    let target = grasps[GraspId::FIRST].target();
    // the thesis's ball settles at a quality just below the one at which it was latched
    let mut spec = GraspSpec::new(target, grasps[GraspId::FIRST].palm());
    spec.effectors = grasps[GraspId::FIRST].links().to_vec();
    spec.latch_quality = Some(0.8 * grasps[GraspId::FIRST].quality());
    grasps = Grasps::of(&sim, &spec).expect("a grasp");
    let dof = sim.model().body_dofadr()[target.index()] as usize;
    let mut worst = |latch: bool| {
        grasps[GraspId::FIRST].allow_latch(latch);
        if !latch {
            grasps[GraspId::FIRST].release();
        }
        let mut last = Vector3::from_column_slice(&sim.qacc()[dof..dof + 3]);
        let mut worst = 0.0f64;
        for _ in 0..STEPS {
            grasps.step(&mut sim).expect("a step");
            let now = Vector3::from_column_slice(&sim.qacc()[dof..dof + 3]);
            worst = worst.max((now - last).norm());
            last = now;
        }
        assert_eq!(grasps[GraspId::FIRST].phase() == Phase::Grasped, latch);
        worst
    };
    let at_rest = worst(false);
    assert!(at_rest < 0.001 * GRAVITY, "{scenario} is not at rest: {at_rest} m/s^2");
    [worst(true), worst(false)]
}

#[test]
fn clutch_and_pinch_latch_and_release_without_a_bump() {
    for scenario in ["clutch", "pinch"] {
        let [latch, release] = bumps(scenario);
        let percent = |bump: f64| 100.0 * bump / GRAVITY;
        println!("{scenario}: latch {:.1e} % of g, release {:.1e} % of g", percent(latch), percent(release));
        assert!(latch < 0.01 * GRAVITY && release < 0.01 * GRAVITY, "{scenario}: {latch} and {release} m/s^2");
    }
}
