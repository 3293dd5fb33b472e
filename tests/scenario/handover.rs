//! Two hands and one baton: handed over, and held between both, in full mode and in grasp mode.

use mujoco_grasp::grasp::{GraspId, Limits, Phase};
use mujoco_grasp::scenario::outcome::Outcome;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::run::{Observer, Options, Pair, Run, run_all};
use mujoco_grasp::scenario::runner::{Mode, Runner};
use nalgebra::Vector3;

const GRAVITY: f64 = 9.81;
const BOTH: [Mode; 2] = [Mode::Full, Mode::Grasp];

fn runs(pair: &Pair) -> (&Run, &Run) {
    (pair.full.as_ref().expect("a full run"), pair.grasp.as_ref().expect("a grasp run"))
}

#[test]
fn the_baton_goes_from_hand_to_hand_alike_in_both_modes() {
    let plan = Plan::load("handover").expect("a built-in scenario");
    // after the scene's 200 iterations full mode of 3.17.0 is not converged: 9.4 um and 1.5 % apart, 3 um and 0.5 % after 1000
    let converged = Options { noslip: Some(1000) };
    let pairs = run_all(&plan, &BOTH, &[None], converged, &Observer::NOBODY).expect("runs");
    let (full, grasp) = runs(&pairs[0]);
    assert!(full.error.is_none() && grasp.error.is_none());

    // the left hand latches as it is let to, and is released once it has opened, at 5.5 to 6 s
    assert_eq!(grasp.summary.latched_at_s, Some(1.65));
    let released = grasp.summary.released_at_s.expect("a release");
    assert!((5.5..6.0).contains(&released), "released at {released} s");
    // the right one latches while the left one holds, and never lets go
    let right = &grasp.others[0];
    assert!(right.summary.latched_at_s.is_some_and(|t| (3.6..4.2).contains(&t)), "{:?}", right.summary);
    assert_eq!(right.summary.released_at_s, None);

    let compare = pairs[0].compare.as_ref().expect("a comparison");
    assert!(compare.same_outcome && compare.others[0].same_outcome);
    assert_eq!(full.summary.outcome, Some(Outcome::Lost));
    assert_eq!(full.others[0].summary.outcome, Some(Outcome::Held));
    let rmse = compare.others[0].position_rmse_m.expect("a motion");
    let force = compare.others[0].normal_force_relative_error.expect("forces");
    println!("right hand: position rmse {:.4} mm, normal forces {:.2} %", 1e3 * rmse, 1e2 * force);
    assert!(rmse < 1e-5 && force < 0.02, "{compare:?}");

    let last = |run: &Run| run.others[0].trajectory.samples().last().expect("a sample").position;
    assert!((last(full) - last(grasp)).norm() < 2e-5);
}

#[test]
fn two_hands_hold_the_baton_alike_in_both_modes() {
    let plan = Plan::load("two-hands").expect("a built-in scenario");
    // under the twist full mode is not converged after the scene's 200 iterations: 5.5 % of its normal forces from 1000
    let converged = Options { noslip: Some(1000) };
    for (push, options, outcome) in [
        ("side", Options::default(), Outcome::Held),
        ("twist", converged, Outcome::Held),
        ("pull", Options::default(), Outcome::Lost),
    ] {
        let pushes = plan.select_pushes(push).expect("a push");
        let pair = &run_all(&plan, &BOTH, &pushes, options, &Observer::NOBODY).expect("runs")[0];
        let (full, grasp) = runs(pair);
        let compare = pair.compare.as_ref().expect("a comparison");
        for (summary, compare) in [(&full.summary, compare), (&full.others[0].summary, &compare.others[0])] {
            assert_eq!(summary.outcome, Some(outcome), "{}", pair.push);
            assert!(compare.same_outcome, "{}: {compare:?}", pair.push);
            let (motion, force) = (compare.relative_error, compare.normal_force_relative_error);
            println!("{}: relative error {motion:?}, normal forces {force:?}", pair.push);
            assert!(motion.is_some_and(|e| e < 0.01) && force.is_some_and(|e| e < 0.02), "{}: {compare:?}", pair.push);
        }
        let latched = |run: &Run| run.summary.latched_at_s.zip(run.others[0].summary.latched_at_s);
        assert!(latched(grasp).is_some() && latched(full).is_none());
    }
}

/// The weld's rows give way while friction is solved without softness: held fixed, they let the baton drift by 4 mm.
///
/// The right hand knocks against the baton as it comes, at 3.424 s. In full mode and with cones the baton shifts by 0.3 mm in the
/// left hand and two of six contacts open; with bounds, also where no hand has cones, by 0.5 mm, and then a quality of 0.10 is left
/// with MuJoCo 2.2.2 and of 0 with 3.17.0, where the grasp is given up for 50 ms. So what counts for bounds is that both
/// hands are latched whenever both hold.
#[test]
fn a_hand_with_cones_and_a_hand_with_a_weld_hold_the_baton_together() {
    for (limits, cones) in [(Limits::Box, 0), (Limits::Box, 1), (Limits::Rigid, 0), (Limits::Rigid, 1)] {
        let mut plan = Plan::load_with("two-hands", Some(limits)).expect("a built-in scenario");
        plan.grasps[cones].limits = Limits::Cones;
        let pushes = plan.select_pushes("side").expect("a push");
        let pair = &run_all(&plan, &BOTH, &pushes, Options::default(), &Observer::NOBODY).expect("runs")[0];
        let (compare, grasp) = (pair.compare.as_ref().expect("a comparison"), pair.grasp.as_ref().expect("a run"));
        for (compare, summary) in [(compare, &grasp.summary), (&compare.others[0], &grasp.others[0].summary)] {
            assert!(limits == Limits::Box || summary.released_at_s.is_none(), "{limits:?}: {summary:?}");
            assert!(compare.same_outcome, "{limits:?}, cones for hand {cones}: {compare:?}");
            assert!(
                compare.position_rmse_m.is_some_and(|e| e < 1e-4),
                "{limits:?}, cones for hand {cones}: {compare:?}"
            );
        }
        for trajectory in [&grasp.trajectory, &grasp.others[0].trajectory] {
            let from = trajectory.index_at(plan.timeline.measure_from()).expect("a sample");
            let lost = trajectory.samples()[from..].iter().find(|s| !s.grasped);
            assert!(lost.is_none(), "{limits:?}, cones for hand {cones}: {lost:?}");
        }
    }
}

/// Largest change of the baton's acceleration from step to step \[m/s^2\] as one hand latches, then the other, and as they are
/// given back one by one, at rest.
#[test]
fn each_hand_latches_and_releases_without_a_bump() {
    let plan = Plan::load("two-hands").expect("a built-in scenario");
    let mut runner = Runner::new(&plan, Mode::Full, None).expect("a runner");
    runner.sim_mut().set_noslip_iterations(1000).expect("iterations");
    runner.sim_mut().set_noslip_tolerance(0.0).expect("a tolerance");
    runner.advance_to(4.7).expect("a hold");
    let (mut sim, mut grasps) = runner.into_parts();
    let dof = sim.model().body_dofadr()[grasps[GraspId::FIRST].target().index()] as usize;
    let acceleration = |sim: &mujoco_grasp::mujoco::Simulation| Vector3::from_column_slice(&sim.qacc()[dof..dof + 3]);
    let turns = [
        ("left latches", 0, true),
        ("right latches", 1, true),
        ("left releases", 0, false),
        ("right releases", 1, false),
    ];
    grasps.iter_mut().for_each(|g| g.allow_latch(false));
    let ids: Vec<GraspId> = grasps.ids().collect();
    for (what, hand, latch) in turns {
        let hand = ids[hand];
        grasps[hand].allow_latch(latch);
        if !latch {
            grasps[hand].release();
        }
        let (mut last, mut bump) = (acceleration(&sim), 0.0f64);
        for _ in 0..50 {
            grasps.step(&mut sim).expect("a step");
            let now = acceleration(&sim);
            bump = bump.max((now - last).norm());
            last = now;
        }
        assert_eq!(grasps[hand].phase() == Phase::Grasped, latch, "{what}");
        println!("{what}: {:.1e} % of g", 100.0 * bump / GRAVITY);
        assert!(bump < 0.01 * GRAVITY, "{what}: {bump} m/s^2");
    }
}
