//! A policy that moves every finger's target in every control step, for a minute: the same story as MuJoCo's own solve tells.

use crate::random::Random;
use mujoco_grasp::grasp::{GraspId, Grasps, Phase};
use mujoco_grasp::mujoco::{ActuatorId, Simulation};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// Of the policy \[s\], and steps of the simulation in one of its own.
const MINUTE: f64 = 60.0;
const SUBSTEPS: usize = 10;
/// How far targets go from where they were, and in one control step \[rad\].
const RANGE: f64 = 0.02;
const STRIDE: f64 = 0.002;

/// Where the target is in the palm.
fn held_at(sim: &Simulation, grasps: &Grasps) -> Isometry3<f64> {
    let pose = |body: usize| {
        let (p, q) = (&sim.xpos()[3 * body..3 * body + 3], &sim.xquat()[4 * body..4 * body + 4]);
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
        Isometry3::from_parts(Translation3::new(p[0], p[1], p[2]), turn)
    };
    let grasp = &grasps[GraspId::FIRST];
    pose(grasp.palm().index()).inv_mul(&pose(grasp.target().index()))
}

/// The target in the palm after every control step, and the share of steps on frozen geometry.
fn story(mode: Mode, tolerance: f64) -> (Vec<Isometry3<f64>>, f64) {
    let plan = Plan::load("clutch").expect("a built-in scenario").with_frozen_tolerance(Some(tolerance));
    let plan = plan.expect("a tolerance");
    let mut runner = Runner::new(&plan, mode, None).expect("a runner");
    runner.sim_mut().set_noslip_iterations(100).expect("iterations");
    runner.sim_mut().set_noslip_tolerance(0.0).expect("a tolerance");
    runner.advance_to(plan.timeline.measure_from()).expect("a hold");
    let (mut sim, mut grasps) = runner.into_parts();
    let names = ["thumb", "index", "middle", "ring", "little"];
    let model = sim.model();
    let of_a_finger = |a: &ActuatorId| names.iter().any(|name| model.label(*a).contains(name));
    let fingers: Vec<usize> = model.actuators().filter(of_a_finger).map(|a| a.index()).collect();
    assert!(fingers.len() >= 15, "{} finger actuators", fingers.len());
    let start = sim.ctrl().to_vec();
    let mut random = Random(7);
    let (mut path, before) = (Vec::new(), grasps.frozen_steps());
    let calls = (MINUTE / (SUBSTEPS as f64 * sim.model().timestep())).round() as usize;
    for _ in 0..calls {
        for &finger in &fingers {
            let to = sim.ctrl()[finger] + STRIDE * random.next();
            sim.ctrl_mut()[finger] = to.clamp(start[finger] - RANGE, start[finger] + RANGE);
        }
        if mode == Mode::Grasp {
            grasps.steps(&mut sim, SUBSTEPS).expect("steps");
            assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped);
        } else {
            (0..SUBSTEPS).try_for_each(|_| sim.step()).expect("steps");
        }
        path.push(held_at(&sim, &grasps));
    }
    (path, (grasps.frozen_steps() - before) as f64 / (calls * SUBSTEPS) as f64)
}

#[test]
fn a_policy_that_moves_every_finger_for_a_minute() {
    let full = story(Mode::Full, 0.0).0;
    let motion = full.iter().map(|p| (p.translation.vector - full[0].translation.vector).norm()).fold(0.0, f64::max);
    assert!(motion > 1e-3, "{motion} m");
    for tolerance in [0.0, mujoco_grasp::grasp::FROZEN_TOLERANCE] {
        let (grasp, frozen) = story(Mode::Grasp, tolerance);
        let square = full.iter().zip(&grasp).map(|(a, b)| (a.translation.vector - b.translation.vector).norm_squared());
        let apart = (square.sum::<f64>() / full.len() as f64).sqrt();
        let turned = full.iter().zip(&grasp).map(|(a, b)| a.rotation.angle_to(&b.rotation)).fold(0.0, f64::max);
        println!(
            "{tolerance}: moved {motion} m, apart {apart} m rms, {turned} rad at most, {frozen} of the steps frozen"
        );
        assert!(apart < 0.02 * motion, "{apart} m of {motion} m apart");
        assert!(turned < 0.02, "{turned} rad apart");
        assert!(tolerance == 0.0 && frozen == 0.0 || frozen > 0.3, "{frozen} of the steps were frozen");
    }
}
