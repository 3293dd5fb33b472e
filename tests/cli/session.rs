//! What is done in the window, without a window: a session that replays bit for bit.

use crate::program::data;
use mujoco_grasp::grasp::{GraspId, Phase};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use mujoco_grasp::view::{Action, Recording, Session};
use nalgebra::Vector3;

/// Steps of the claw after which its grasp is latched: the pin goes at 2 s.
pub const LATCHED: u64 = 1100;

pub fn claw() -> Plan {
    Plan::load(&data("claw.toml")).unwrap()
}

fn push(force: [f64; 3]) -> Action {
    Action::Push { body: "object".to_owned(), force, torque: [0.0; 3] }
}

/// Steps until `step`.
pub fn run(session: &mut Session, step: u64) {
    while session.steps() < step {
        session.step().unwrap();
    }
}

fn phase(session: &Session) -> Phase {
    session.grasps()[GraspId::FIRST].phase()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

// ------------------------------------------------------------------------------------------------ the session

#[test]
fn a_session_is_the_run_of_its_scenario_with_the_same_pushes_bit_for_bit() {
    let plan = claw();
    let mut session = Session::new(&plan).unwrap();
    let mut runner = Runner::new(&plan, Mode::Grasp, None).unwrap();
    let body = plan.model.body("object").unwrap();
    for step in 0..LATCHED + 200 {
        let force = Vector3::new(1.5, 0.25, -0.5);
        match step {
            LATCHED => {
                session.act(push(force.into())).unwrap();
                runner.sim_mut().set_body_wrench(body, &force, &Vector3::zeros()).unwrap();
            }
            1200 => {
                session.act(Action::Release).unwrap();
                runner.sim_mut().set_body_wrench(body, &Vector3::zeros(), &Vector3::zeros()).unwrap();
            }
            _ => {}
        }
        session.step().unwrap();
        runner.step().unwrap();
        assert_eq!(bits(session.sim().qpos()), bits(runner.sim().qpos()), "step {step}");
    }
    assert_eq!(phase(&session), Phase::Grasped);
}

/// Holds, slips, is lost, and is latched again after a reset; in between the modes are switched.
fn story(plan: &Plan) -> Session {
    let mut session = Session::new(plan).unwrap();
    let place = |session: &Session| session.sim().qpos()[..3].to_vec();
    run(&mut session, LATCHED);
    assert_eq!(phase(&session), Phase::Grasped, "latched");
    let held = place(&session);
    let moved = |session: &Session| {
        let now = place(session);
        (0..3).map(|i| (now[i] - held[i]).powi(2)).sum::<f64>().sqrt()
    };
    session.act(push([0.0, 0.0, -1.0])).unwrap();
    run(&mut session, 1300);
    assert_eq!(phase(&session), Phase::Grasped);
    let after_small = moved(&session);
    session.act(Action::Mode(Mode::Full)).unwrap();
    assert_eq!((session.mode(), phase(&session)), (Mode::Full, Phase::Ungrasped));
    run(&mut session, 1400);
    assert_eq!(phase(&session), Phase::Ungrasped, "full mode only watches");
    assert!(session.sim().contact_count() > 0 && moved(&session) < 0.005, "held by the engine's own solve");
    session.act(Action::Mode(Mode::Grasp)).unwrap();
    run(&mut session, 1500);
    assert_eq!(phase(&session), Phase::Grasped, "latched again");
    session.act(push([0.0, 0.0, -40.0])).unwrap();
    run(&mut session, 1700);
    assert_eq!(phase(&session), Phase::Ungrasped, "lost");
    assert!(moved(&session) > 0.05 && after_small < 0.005, "{} and {after_small}", moved(&session));
    session.act(Action::Reset).unwrap();
    assert_eq!(session.time(), 0.0);
    run(&mut session, 1700 + LATCHED);
    assert_eq!(phase(&session), Phase::Grasped, "latched after the reset");
    session
}

#[test]
fn a_recorded_story_is_replayed_bit_for_bit_and_another_is_not() {
    let plan = claw();
    let session = story(&plan);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("story.json");
    Recording::of(&session).write(&file).unwrap();
    let recording = Recording::read(&file, &plan).unwrap();
    assert_eq!(recording, Recording::of(&session));
    let replayed = recording.replay(&plan).unwrap();
    assert_eq!(replayed.digest(), session.digest());
    assert_eq!(bits(replayed.sim().qpos()), bits(session.sim().qpos()));

    let mut other = recording.clone();
    other.events[0].action = push([0.0, 0.0, -1.0 - f64::EPSILON]);
    assert_ne!(other.replay(&plan).unwrap().digest(), session.digest(), "a last bit of one push");
    let mut other = recording;
    other.events[0].step += 1;
    assert_ne!(other.replay(&plan).unwrap().digest(), session.digest(), "a step later");
}

#[test]
fn a_session_that_is_switched_to_full_mode_at_once_is_the_engines_own() {
    let plan = claw();
    let mut session = Session::new(&plan).unwrap();
    session.act(Action::Mode(Mode::Full)).unwrap();
    let mut runner = Runner::new(&plan, Mode::Full, None).unwrap();
    for _ in 0..LATCHED {
        session.step().unwrap();
        runner.step().unwrap();
    }
    assert_eq!(bits(session.sim().qpos()), bits(runner.sim().qpos()));
}

#[test]
fn the_solver_settings_of_a_merged_grasp_do_not_outlive_a_switch_to_full_mode() {
    let plan = Plan::load_with(&data("claw.toml"), Some(mujoco_grasp::grasp::Limits::Box)).unwrap();
    let mut session = Session::new(&plan).unwrap();
    let own = session.sim().model().noslip_iterations();
    run(&mut session, LATCHED);
    assert_eq!(phase(&session), Phase::Grasped);
    assert_ne!(session.sim().model().noslip_iterations(), own, "a merged grasp has changed it");
    session.act(Action::Mode(Mode::Full)).unwrap();
    assert_eq!(session.sim().model().noslip_iterations(), own);
    run(&mut session, LATCHED + 50);
    assert_eq!(session.sim().model().noslip_iterations(), own);
}

#[test]
fn pushes_that_make_no_sense_are_refused_and_change_nothing() {
    let mut session = Session::new(&claw()).unwrap();
    let unknown = Action::Push { body: "objct".to_owned(), force: [0.0; 3], torque: [0.0; 3] };
    let message = session.act(unknown).unwrap_err().to_string();
    assert!(message.contains("objct") && message.contains("object"), "{message}");
    let message = session.act(push([0.0, f64::NAN, 0.0])).unwrap_err().to_string();
    assert!(message.contains("finite"), "{message}");
    assert!(session.events().is_empty());
    assert!(session.sim().xfrc_applied().iter().all(|x| *x == 0.0));
}

#[test]
fn a_push_that_goes_on_is_noted_once() {
    let mut session = Session::new(&claw()).unwrap();
    let body = session.sim().model().body("object").unwrap();
    session.push(Some((body, nalgebra::Vector6::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))).unwrap();
    session.push(Some((body, nalgebra::Vector6::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))).unwrap();
    assert_eq!(session.events().len(), 1, "the same push is noted once");
    session.push(None).unwrap();
    session.push(None).unwrap();
    let actions: Vec<&Action> = session.events().iter().map(|e| &e.action).collect();
    assert_eq!(actions, [&push([1.0, 0.0, 0.0]), &Action::Release]);
}
