//! Latch and release of the built-in grasps at rest: the accelerations of target and palm change by less than 1 % of g, and
//! where a merged grasp lets go by less than 0.1 %.

use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Limits, Phase};
use mujoco_grasp::mujoco::{BodyId, Simulation};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;

const GRAVITY: f64 = 9.81;
const STEPS: usize = 100;

/// Acceleration of a body from three steps.
#[derive(Default)]
struct Accelerometer(Vec<Vector3<f64>>);

impl Accelerometer {
    /// Change of the acceleration over the last step \[m/s^2\]; 0 until four steps are seen.
    fn change(&mut self, sim: &Simulation, body: BodyId) -> f64 {
        self.0.push(sim.body_position(body));
        match *self.0 {
            [.., a, b, c, d] => (d - 3.0 * (c - b) - a).norm() / sim.model().timestep().powi(2),
            _ => 0.0,
        }
    }
}

/// Largest change of the acceleration of target or palm from step to step, at the latch and at the release \[m/s^2\].
fn bumps(scenario: &str, limits: Limits) -> [f64; 2] {
    let plan = Plan::load_with(scenario, Some(limits)).expect("a built-in scenario");
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
    spec.limits = limits;
    spec.latch_quality = Some(0.8 * grasps[GraspId::FIRST].quality());
    grasps = Grasps::of(&sim, &spec).expect("a grasp");
    let palm = grasps[GraspId::FIRST].palm();
    let (mut of_target, mut of_palm) = (Accelerometer::default(), Accelerometer::default());
    let mut worst = |latch: bool| {
        grasps[GraspId::FIRST].allow_latch(latch);
        if !latch {
            grasps[GraspId::FIRST].release();
        }
        let mut worst = 0.0f64;
        for _ in 0..STEPS {
            grasps.step(&mut sim).expect("a step");
            worst = worst.max(of_target.change(&sim, target)).max(of_palm.change(&sim, palm));
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
        let [latch, release] = bumps(scenario, Limits::Cones);
        let percent = |bump: f64| 100.0 * bump / GRAVITY;
        println!("{scenario}: latch {:.1e} % of g, release {:.1e} % of g", percent(latch), percent(release));
        assert!(latch < 0.01 * GRAVITY && release < 0.01 * GRAVITY, "{scenario}: {latch} and {release} m/s^2");
    }
}

/// The fingers go on where they are, and each contact with the force that it had in the merged grasp.
#[test]
fn merged_grasps_latch_and_release_without_a_bump() {
    for (scenario, limits) in
        ["clutch", "pinch"].into_iter().flat_map(|scenario| [(scenario, Limits::Box), (scenario, Limits::Rigid)])
    {
        let [latch, release] = bumps(scenario, limits);
        println!("{scenario} {limits:?}: latch {:.1e} g, release {:.1e} g", latch / GRAVITY, release / GRAVITY);
        assert!(latch < 0.01 * GRAVITY && release < 0.001 * GRAVITY, "{scenario} {limits:?}: {latch}, {release} m/s^2");
    }
}
