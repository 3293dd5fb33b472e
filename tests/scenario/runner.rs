//! The runner, step by step: pin, schedule, fingertip goals, pushes, several grasps.

use mujoco_grasp::grasp::{Limits, Phase, weld_xml};
use mujoco_grasp::mujoco::Model;
use mujoco_grasp::scenario::actuator::PositionActuator;
use mujoco_grasp::scenario::file::ScenarioFile;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;
use std::path::Path;

fn load(name: &str) -> Plan {
    Plan::load(&format!("tests/data/{name}")).unwrap()
}

#[test]
fn a_pinned_target_stays_where_it_is_in_the_world_and_nothing_latches() {
    for mode in [Mode::Full, Mode::Grasp] {
        let plan = load("claw.toml");
        let mut runner = Runner::new(&plan, mode, None).unwrap();
        let ball = plan.model.body("object").unwrap();
        let (start, mass) = (runner.sim().body_position(ball), runner.sim().model().body_mass()[ball.index()]);
        let mut squeezed = false;
        while runner.time() < 2.0 - 1e-9 {
            let sample = runner.step().unwrap();
            assert_eq!(runner.sim().body_position(ball), start, "{}", sample.time);
            assert!(!sample.grasped && runner.grasp().phase() == Phase::Ungrasped && !runner.grasp().would_latch());
            squeezed |= sample.quality > runner.grasp().latch_quality();
        }
        assert!(squeezed, "only the pin keeps it from latching");
        // Then it is free, with its own inertia, and the fingers hold it.
        let sample = runner.step().unwrap();
        let dof = runner.sim().model().body_dofadr()[ball.index()] as usize;
        assert_eq!(runner.sim().model().dof_armature()[dof], 0.0);
        assert!((runner.sim().model().dof_M0()[dof] - mass).abs() < 1e-12);
        assert_eq!(sample.time, 2.0);
        runner.advance_to(2.5).unwrap();
        assert!((runner.sim().body_position(ball) - start).norm() < 3e-3);
        assert_ne!(runner.sim().body_position(ball), start);
    }
}

#[test]
fn the_fingers_press_on_a_pinned_target_with_what_their_springs_say() {
    // The pin must feel like a wall: five equal fingers press equally, and steadily.
    let plan = load("claw.toml");
    let mut runner = Runner::new(&plan, Mode::Full, None).unwrap();
    runner.advance_to(1.98).unwrap();
    let mut last = None;
    for _ in 0..5 {
        runner.step().unwrap();
        let forces: Vec<f64> = runner.normal_forces().iter().copied().filter(|f| *f > 0.0).collect();
        assert_eq!(forces.len(), 5);
        assert!(forces.iter().all(|f| (f / forces[0] - 1.0).abs() < 1e-3), "{forces:?}");
        let change = last.map_or(0.0, |l: f64| (l - forces[0]).abs());
        assert!(change < 1e-3, "{change} N in one step");
        last = Some(forces[0]);
    }
}

#[test]
fn a_push_acts_at_its_times_only() {
    let plan = load("claw.toml");
    let push = &plan.pushes[0];
    let mut runner = Runner::new(&plan, Mode::Full, Some(push)).unwrap();
    let at = 6 * push.body.index();
    let mut pushed = Vec::new();
    while !runner.is_over() {
        let time = runner.time();
        runner.step().unwrap();
        let wrench = &runner.sim().xfrc_applied()[at..at + 6];
        if wrench.iter().any(|w| *w != 0.0) {
            assert_eq!(wrench, [3.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
            pushed.push(time);
        }
    }
    assert_eq!((pushed.len(), pushed[0], pushed[499]), (500, 3.0, 3.998));
}

#[test]
fn controls_follow_the_schedule() {
    let plan = load("claw.toml");
    let mut runner = Runner::new(&plan, Mode::Full, None).unwrap();
    let mcp = plan.model.actuator("f0_mcp").unwrap().index();
    let mut seen = Vec::new();
    for time in [0.0, 0.8, 1.6, 3.0] {
        runner.advance_to(time).unwrap();
        runner.step().unwrap();
        seen.push(runner.sim().ctrl()[mcp]);
    }
    // From -0.3 in the keyframe to 0.45 at 1.6 s.
    for (seen, expected) in seen.iter().zip([-0.3, 0.075, 0.45, 0.45]) {
        assert!((seen - expected).abs() < 1e-12, "{seen} {expected}");
    }
}

#[test]
fn fingertips_reach_their_goals_press_until_the_quality_and_keep_their_targets() {
    let plan = load("claw_goals.toml");
    let mut runs = [Mode::Full, Mode::Grasp].map(|mode| Runner::new(&plan, mode, None).unwrap());
    let mut kept = Vec::new();
    for runner in &mut runs {
        let mut before = runner.sim().ctrl().to_vec();
        let mut frozen_at = None;
        while runner.time() < 4.0 {
            runner.step().unwrap();
            let ctrl = runner.sim().ctrl().to_vec();
            let change = ctrl.iter().zip(&before).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // 0.1 m/s is 0.2 mm a step, with fingers of 0.1 m.
            assert!(change < 0.02, "targets jump by {change} at {}", runner.time());
            let held = runner.grasp().phase() == Phase::Grasped || runner.grasp().would_latch();
            match frozen_at {
                None if held => frozen_at = Some(runner.time()),
                Some(_) => assert_eq!(change, 0.0, "targets move at {}", runner.time()),
                None => {}
            }
            before = ctrl;
        }
        assert!(frozen_at.is_some_and(|t| t > 3.0), "nothing froze");
        assert!(runner.grasp().quality() > 0.5 * runner.grasp().latch_quality());
        kept.push(before);
    }
    assert_eq!(kept[0], kept[1], "both modes hold the same targets");
    // The wrist is above the palm: no tip moves it.
    assert_eq!(kept[0][0], 0.0);
}

#[test]
fn commanded_tips_arrive_at_the_goal_sites() {
    let plan = load("claw_goals.toml");
    let mut runner = Runner::new(&plan, Mode::Full, None).unwrap();
    runner.advance_to(0.02).unwrap();
    // On the way.
    let (palm, points) = runner.trackers()[0].problem(runner.sim());
    let goal = |runner: &Runner, i: usize| runner.sim().site_position(plan.model.site(&format!("goal{i}")).unwrap());
    assert!((points[0] - goal(&runner, 0)).norm() > 1e-3);
    let mut solver = runner.trackers()[0].solver().clone();
    assert!(solver.solve(&palm, &points).unwrap().residual < 1e-6);
    // Arrived: pressed in by less than the rate times the time, and moved together against the load of the pin.
    runner.advance_to(1.0).unwrap();
    let (_, points) = runner.trackers()[0].problem(runner.sim());
    let ball = runner.sim().body_position(plan.model.body("object").unwrap());
    let inward: Vec<Vector3<f64>> = (0..5).map(|i| (ball - goal(&runner, i)).normalize()).collect();
    let moved: Vec<Vector3<f64>> = (0..5).map(|i| points[i] - goal(&runner, i)).collect();
    let pressed = (moved[0] - moved[2]).norm() / (inward[0] - inward[2]).norm();
    assert!((0.001..0.010).contains(&pressed), "{pressed}");
    let shift = moved[0] - pressed * inward[0];
    assert!(shift.norm() < 0.010 && shift.z > 0.0, "{shift}: the ball weighs on the pin");
    for (moved, inward) in moved.iter().zip(&inward) {
        assert!((moved - pressed * inward - shift).norm() < 1e-6);
    }
}

#[test]
fn the_fingers_carry_the_target_before_the_pin_goes() {
    let plan = load("claw_goals.toml");
    let mut runner = Runner::new(&plan, Mode::Full, None).unwrap();
    runner.advance_to(3.0).unwrap();
    let ball = plan.model.body("object").unwrap();
    let weight = 0.2 * 9.81;
    let carried: f64 = runner.grasp().contacts().iter().map(|c| c.force.z).sum();
    assert!((carried - weight).abs() < 0.02 * weight, "{carried} of {weight} N");
    let before = runner.sim().body_position(ball);
    runner.advance_to(3.5).unwrap();
    assert!((runner.sim().body_position(ball) - before).norm() < 1e-3, "it drops");
}

#[test]
fn position_actuators_are_found_with_their_gain_gear_and_bias() {
    let xml = r#"<mujoco><worldbody><body><joint name="a"/><geom size=".1"/>
        <body><joint name="b"/><geom size=".1"/><body><joint name="c"/><geom size=".1"/></body></body></body></worldbody>
      <actuator>
        <motor joint="a"/>
        <general joint="a" gear="2" gaintype="fixed" gainprm="3" biastype="affine" biasprm="0.6 -5 -0.1"/>
        <position joint="b" kp="7"/>
        <velocity joint="c"/>
      </actuator></mujoco>"#;
    let model = Model::from_xml_string(xml).unwrap();
    let of = |name: &str| PositionActuator::of(&model, model.joint(name).unwrap());
    // 3 ctrl + 0.6 - 5 (2 q) = 0
    let a = of("a").unwrap();
    assert_eq!(a.index, 1);
    assert!((a.scale - 10.0 / 3.0).abs() < 1e-12 && (a.offset + 0.2).abs() < 1e-12);
    // The joint feels 2 (3 ctrl + ...).
    assert!((a.compliance - 1.0 / 6.0).abs() < 1e-12);
    assert_eq!(of("b"), Some(PositionActuator { index: 2, scale: 1.0, offset: 0.0, compliance: 1.0 / 7.0 }));
    assert_eq!(of("c"), None);
}

/// Two claws side by side, each with its own ball.
fn two_claws(limits: [&str; 2]) -> Plan {
    let claw = std::fs::read_to_string("tests/data/claw.xml").unwrap();
    let between = |from: &str, to: &str| {
        let a = claw.find(from).unwrap();
        &claw[a..a + claw[a..].find(to).unwrap()]
    };
    let hand = between("<body name=\"palm\"", "  </worldbody>");
    let actuators = between("<actuator>", "</actuator>").replace("<actuator>", "");
    let renamed = |text: &str, k: usize| {
        let mut text = text.to_owned();
        for attribute in ["name", "joint"] {
            text = text.replace(&format!(" {attribute}=\""), &format!(" {attribute}=\"h{k}_"));
        }
        text
    };
    let moved = |k: usize| {
        renamed(hand, k).replacen("pos=\"0 0 0.38\"", &format!("pos=\"{k} 0 0.38\""), 1).replacen(
            "pos=\"0 0 0.3\"",
            &format!("pos=\"{k} 0 0.3\""),
            1,
        )
    };
    let xml = format!(
        "<mujoco>{}<worldbody>{}{}</worldbody><actuator>{}{}</actuator>{}{}</mujoco>",
        between("<compiler", "<worldbody>"),
        moved(0),
        moved(1),
        renamed(&actuators, 0),
        renamed(&actuators, 1),
        weld_xml("h0_object", Some("h0_palm")),
        weld_xml("h1_object", None)
    );
    let mut set = String::new();
    for k in 0..2 {
        for i in 0..5 {
            set += &format!("h{k}_f{i}_mcp = 0.45, h{k}_f{i}_pip = 0.75, h{k}_f{i}_dip = 0.3, ");
        }
    }
    let toml = format!(
        "name = \"two\"\nmodel = \"two.xml\"\n[timeline]\nduration = 4.0\npin_until = 2.0\nmeasure_from = 2.5\n\
         [[grasp]]\ntarget = \"h0_object\"\npalm = \"h0_palm\"\nlimits = \"{}\"\n[[grasp]]\ntarget = \"h1_object\"\npalm = \"h1_palm\"\nlimits = \"{}\"\n\
         [[control]]\ntime = 0.2\nset = {{ {} }}\n[[control]]\ntime = 1.6\nset = {{ {} }}\n\
         [[push]]\nname = \"second\"\ntarget = \"h1_object\"\nstart = 2.6\nduration = 0.5\nforce = [2.0, 0.0, 0.0]\n",
        limits[0],
        limits[1],
        set.replace("0.45", "-0.3").replace("0.75", "0.0").trim_end_matches(", "),
        set.trim_end_matches(", ")
    );
    let path = Path::new("two.toml");
    Plan::new(&ScenarioFile::parse(&toml, path).unwrap(), path, Model::from_xml_string(&xml).unwrap()).unwrap()
}

#[test]
fn two_hands_latch_both_and_the_run_is_about_the_one_that_is_pushed() {
    for limits in [["cones"; 2], ["box"; 2], ["rigid", "box"], ["box", "cones"]] {
        two_hands(limits);
    }
}

fn two_hands(limits: [&str; 2]) {
    let plan = two_claws(limits);
    let mut runner = Runner::new(&plan, Mode::Grasp, Some(&plan.pushes[0])).unwrap();
    let mut trajectory = runner.trajectory();
    assert!(trajectory.links().iter().all(|l| l.starts_with("h1_f")));
    while !runner.is_over() {
        let sample = runner.step().unwrap();
        trajectory.push(sample, runner.normal_forces());
    }
    assert!(runner.grasps().iter().all(|g| g.phase() == Phase::Grasped));
    let from = trajectory.index_at(2.5).unwrap();
    let start = trajectory.samples()[from];
    let peak = trajectory.samples()[from..].iter().map(|s| (s.position - start.position).norm()).fold(0.0, f64::max);
    assert!((0.005..0.03).contains(&peak), "{limits:?}: {peak}");
    // The other hand's ball does not feel it.
    let other = plan.model.body("h0_object").unwrap();
    assert!((runner.sim().body_position(other).x).abs() < 1e-3);
}

/// A scenario is loaded with what every form of the constraint needs, from a file and built in.
#[test]
fn a_scenario_runs_with_any_limits() {
    for scenario in ["tests/data/claw.toml", "clutch"] {
        for limits in [Limits::Box, Limits::Rigid] {
            let plan = Plan::load_with(scenario, Some(limits)).unwrap();
            let runner = Runner::new(&plan, Mode::Grasp, None).unwrap();
            assert_eq!(runner.grasp().limits(), limits, "{scenario}");
        }
    }
}

#[test]
fn friction_that_is_no_number_while_latched_is_an_error_that_says_where() {
    let plan = load("claw.toml");
    for mode in [Mode::Full, Mode::Grasp] {
        for parameter in 0..3 {
            let mut runner = Runner::new(&plan, mode, None).unwrap();
            runner.advance_to(2.5).unwrap();
            assert_eq!(runner.grasp().phase() == Phase::Grasped, mode == Mode::Grasp);
            let object = runner.sim().model().geom("object").unwrap().index();
            runner.sim_mut().geom_friction_mut()[3 * object + parameter] = f64::NAN;
            let error = runner.step().unwrap_err().to_string();
            for part in [mode.name(), "2.500", "friction", "geom \"object\"", "finite"] {
                assert!(error.contains(part), "{part:?} is not in: {error}");
            }
            assert!(runner.grasp().contacts().is_empty(), "the refused contact is not listed");
        }
    }
}
