//! The examples run, and show what they say.

#[path = "../examples/control_loop.rs"]
mod control_loop;
#[path = "../examples/handover.rs"]
mod handover;
#[path = "../examples/live_forces.rs"]
mod live_forces;
#[path = "../examples/load_and_hold.rs"]
mod load_and_hold;
#[path = "../examples/save_replay.rs"]
mod save_replay;
#[path = "../examples/sweep.rs"]
mod sweep;

use mujoco_grasp::grasp::Phase;

/// Of the ball \[N\].
const WEIGHT: f64 = 0.1 * 9.81;

#[test]
fn load_and_hold_lifts_the_ball() {
    let held = load_and_hold::run().expect("a run");
    assert!(held.latched_at < 0.5 && held.quality > 0.0, "{held:?}");
    assert!((held.lift - WEIGHT).abs() < 0.01 * WEIGHT && held.height > 0.11, "{held:?}");
}

#[test]
fn the_controlled_grip_keeps_what_a_fixed_one_loses() {
    let controlled = control_loop::run(true).expect("a run");
    let alone = control_loop::run(false).expect("a run");
    assert!(controlled.kept && !alone.kept, "{controlled:?} {alone:?}");
    assert!(controlled.normal[1] > controlled.normal[0] + 1.0, "{controlled:?}");
}

#[test]
fn the_sweep_finds_one_threshold_in_both_modes() {
    let lifts = sweep::run().expect("a run");
    let held: Vec<[bool; 2]> = lifts.iter().map(|lift| lift.held()).collect();
    assert_eq!((held[0], held[held.len() - 1]), ([false; 2], [true; 2]), "{lifts:?}");
    assert!(held.iter().all(|[full, grasp]| full == grasp) && held.is_sorted(), "{lifts:?}");
}

#[test]
fn live_forces_show_both_phases_and_the_slide() {
    let readings = live_forces::run().expect("a run");
    for phase in [Phase::Ungrasped, Phase::Grasped] {
        assert!(readings.iter().any(|r| r.phase == phase && r.normal > 1.0), "{phase:?}: {readings:?}");
    }
    let slides = |r: &live_forces::Reading| r.sliding && r.slip > 1e-3 && r.tangential > 0.9 * r.normal;
    assert!(readings.iter().any(slides), "{readings:?}");
    let holds = |r: &live_forces::Reading| r.phase == Phase::Grasped && !r.sliding && r.slip < 1e-3;
    assert!(readings.iter().any(|r| holds(r) && r.time > 1.4), "{readings:?}");
}

#[test]
fn the_replay_is_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let (steps, different) = save_replay::run(&folder.path().join("snapshot.json")).expect("a run");
    assert!(steps > 500 && different == 0, "{different} of {steps}");
}

#[test]
fn the_baton_is_handed_over() {
    let (events, away) = handover::run().expect("a run");
    let story: Vec<_> = events.iter().map(|e| (e.hand, e.phase)).collect();
    let expected = [("left", Phase::Grasped), ("right", Phase::Grasped), ("left", Phase::Ungrasped)];
    assert_eq!(story, expected, "{events:?}");
    assert!(away < 0.07, "the baton is {away} m from the right palm");
}
