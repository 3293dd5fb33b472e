//! Against the engine's own solver.

use crate::grasp::{GraspId, GraspSpec, Grasps, Limits, Phase, weld_xml};
use crate::mujoco::{Model, Simulation};
use crate::scenario::plan::Plan;
use crate::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;

/// The target's motion and the forces on it, in either way, from the same state on: a push, and its end.
fn follows_the_engine(sim: &Simulation, grasps: &Grasps, push: Vector3<f64>, steps: usize) {
    let run = |idle: bool| {
        let (mut sim, mut grasps) = (sim.clone(), grasps.clone());
        sim.set_iterations(200).expect("a number");
        sim.set_tolerance(0.0).expect("a tolerance");
        grasps.bounded_rows.idle = idle;
        let target = grasps[GraspId::FIRST].target();
        let before = grasps.bounded_rows.solved;
        let steps: Vec<_> = (0..400)
            .map(|step| {
                let force = if (100..100 + steps).contains(&step) { push } else { Vector3::zeros() };
                sim.set_body_wrench(target, &force, &Vector3::zeros()).expect("a wrench");
                grasps.step(&mut sim).expect("a step");
                let wrench = grasps[GraspId::FIRST].merged_wrench().expect("a merged grasp");
                (
                    sim.qpos().to_vec(),
                    sim.body_position(target),
                    wrench.fixed_rows::<3>(0).norm(),
                    sim.efc_state().to_vec(),
                )
            })
            .collect();
        assert_eq!(grasps.bounded_rows.solved - before, if idle { 0 } else { 400 });
        steps
    };
    let (direct, engine) = (run(false), run(true));
    let moved = engine.iter().map(|e| (e.1 - engine[0].1).norm()).fold(0.0, f64::max);
    assert!(moved > 1e-5, "the push moves the target by {moved}");
    for (step, (a, b)) in direct.iter().zip(&engine).enumerate() {
        let apart = a.0.iter().zip(&b.0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-5 * moved, "step {step}: {apart} apart, moved by {moved}");
        assert!((a.2 - b.2).abs() < 1e-5 * b.2, "step {step}: {} N, {} N", a.2, b.2);
        assert_eq!(a.3, b.3, "step {step}");
    }
}

#[test]
fn the_clutch_is_as_the_engines_own_solver_has_it() {
    for limits in [Limits::Box, Limits::Rigid] {
        let plan = Plan::load_with("clutch", Some(limits)).expect("a built-in scenario");
        let mut runner = Runner::new(&plan, Mode::Grasp, None).expect("a runner");
        runner.advance_to(plan.timeline.measure_from()).expect("a hold");
        let (mut sim, grasps) = runner.into_parts();
        sim.set_noslip_iterations(0).expect("a number");
        follows_the_engine(&sim, &grasps, Vector3::new(0.0, -1.5, -0.5), 150);
    }
}

/// With joints at their limits, friction losses that are overcome, an equality, and a box at its bound.
#[test]
fn so_is_a_claw_with_all_kinds_of_rows() {
    let xml = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/claw.xml")).expect("a file");
    let lossy = xml.replace(
        "<joint damping=\"0.05\" armature=\"0\"/>",
        "<joint damping=\"0.05\" armature=\"0\" frictionloss=\"0.003\"/>",
    );
    assert_ne!(lossy, xml);
    let tie = "<equality><joint joint1=\"f0_dip\" joint2=\"f1_dip\"/></equality>";
    let extra = format!("{tie}{}</mujoco>", weld_xml("object", None));
    let model = Model::from_xml_string(&lossy.replace("</mujoco>", &extra)).expect("a model");
    for (limits, push, steps) in [(Limits::Box, -2.0, 150), (Limits::Box, -8.0, 20), (Limits::Rigid, -8.0, 150)] {
        let mut sim = Simulation::new(&model).expect("a simulation");
        let key = sim.model().keyframe("open").expect("a keyframe");
        sim.reset_to_keyframe(key).expect("a reset");
        sim.set_noslip_iterations(0).expect("a number");
        let body = |name| sim.model().body(name).expect("a body");
        let mut spec = GraspSpec::new(body("object"), body("palm"));
        spec.limits = limits;
        let mut grasps = Grasps::of(&sim, &spec).expect("a grasp");
        close(&mut sim, &mut grasps);
        follows_the_engine(&sim, &grasps, Vector3::new(0.3, 0.0, push), steps);
    }
}

/// Closes the claw on its ball, which is held in place until then.
fn close(sim: &mut Simulation, grasps: &mut Grasps) {
    let open = sim.ctrl().to_vec();
    let object = grasps[GraspId::FIRST].target();
    let joint = sim.model().free_joint_of(object).expect("a free joint");
    let (q, v) = (sim.model().jnt_qposadr()[joint.index()] as usize, sim.model().jnt_dofadr()[joint.index()] as usize);
    let start = sim.qpos()[q..q + 7].to_vec();
    let names: Vec<String> = sim.model().actuators().map(|a| sim.model().label(a)).collect();
    while grasps[GraspId::FIRST].phase() == Phase::Ungrasped || sim.time() < 3.2 {
        assert!(sim.time() < 5.0, "it does not latch");
        grasps[GraspId::FIRST].allow_latch(sim.time() > 3.0);
        if sim.time() < 2.0 {
            sim.qpos_mut()[q..q + 7].copy_from_slice(&start);
            sim.qvel_mut()[v..v + 6].fill(0.0);
            let part = (sim.time() / 1.6).min(1.0);
            for (i, name) in names.iter().enumerate() {
                let goal = [("mcp", 0.45), ("pip", 0.75), ("dip", 0.3)]
                    .iter()
                    .find(|(j, _)| name.contains(j))
                    .map_or(0.0, |g| g.1);
                sim.ctrl_mut()[i] = open[i] + part * (goal - open[i]);
            }
        }
        grasps.step(sim).expect("a step");
    }
}
