//! Outcomes and comparisons of made-up trajectories whose numbers are known in closed form.

use mujoco_grasp::scenario::compare::compare;
use mujoco_grasp::scenario::outcome::{Outcome, Summary, lost_at, median, summarize};
use mujoco_grasp::scenario::trajectory::{Sample, Trajectory};
use nalgebra::{UnitQuaternion, Vector3};

const STEP: f64 = 0.01;
const FROM: f64 = 1.0;

fn sample(time: f64) -> Sample {
    Sample {
        time,
        position: Vector3::new(0.1, 0.2, 0.3),
        rotation: UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1),
        frozen: false,
        grasped: false,
        quality: 0.5,
        touching: true,
        gripped: true,
        penetration: 0.0,
        slip: 0.0,
        step_ns: 1000,
    }
}

/// 0 to 5 s; `change` sees the time since `FROM`.
fn trajectory(forces: [f64; 2], change: impl Fn(f64, &mut Sample)) -> Trajectory {
    let mut trajectory = Trajectory::new(vec!["a".into(), "b".into()], 501);
    for k in 0..=500 {
        let mut s = sample(f64::from(k) * STEP);
        change(s.time - FROM, &mut s);
        trajectory.push(s, &forces);
    }
    trajectory
}

fn summary(change: impl Fn(f64, &mut Sample)) -> Summary {
    summarize(&trajectory([1.0, 2.0], change), FROM, None)
}

/// A push from 1 s to 2 s after `FROM` that moves the target to `peak`, and back to `rest`.
fn bump(peak: f64, rest: f64) -> impl Fn(f64, &mut Sample) {
    move |t, s| {
        s.position.x += if t < 1.0 {
            0.0
        } else if t < 2.0 {
            peak
        } else {
            rest
        }
    }
}

#[test]
fn a_still_target_is_held() {
    let s = summary(|_, _| ());
    assert_eq!(s.outcome, Some(Outcome::Held));
    assert_eq!((s.peak_motion_m, s.final_offset_m, s.creep_m_per_s), (Some(0.0), Some(0.0), Some(0.0)));
    assert_eq!((s.latched_at_s, s.released_at_s, s.quality_at_latch_n, s.slip_onset_s), (None, None, None, None));
    assert_eq!((s.normal_force_total_n, s.step_us_median), (Some(3.0), Some(1.0)));
}

#[test]
fn held_is_within_two_millimetres_or_a_tenth_of_the_peak() {
    assert_eq!(summary(bump(0.010, 0.0019)).outcome, Some(Outcome::Held));
    assert_eq!(summary(bump(0.010, 0.0021)).outcome, Some(Outcome::Slid));
    assert_eq!(summary(bump(0.040, 0.0039)).outcome, Some(Outcome::Held));
    assert_eq!(summary(bump(0.040, 0.0041)).outcome, Some(Outcome::Slid));
    let s = summary(bump(0.040, 0.0041));
    assert!((s.peak_motion_m.unwrap() - 0.040).abs() < 1e-12 && (s.final_offset_m.unwrap() - 0.0041).abs() < 1e-12);
}

#[test]
fn lost_is_five_centimetres_or_no_contact_at_the_end() {
    assert_eq!(summary(bump(0.0499, 0.0)).outcome, Some(Outcome::Held));
    assert_eq!(summary(bump(0.0501, 0.0)).outcome, Some(Outcome::Lost));
    assert_eq!(summary(|t, s| s.touching = !(0.5..3.0).contains(&t)).outcome, Some(Outcome::Held));
    let gone = |t: f64, s: &mut Sample| s.touching = t < 3.0;
    assert_eq!(summary(gone).outcome, Some(Outcome::Lost));
    assert_eq!(summary(gone).creep_m_per_s, None);
    assert_eq!(lost_at(&trajectory([0.0; 2], gone), FROM), Some(400));
    assert_eq!(lost_at(&trajectory([0.0; 2], bump(0.06, 0.06)), FROM), Some(200));
    assert_eq!(lost_at(&trajectory([0.0; 2], bump(0.01, 0.0)), FROM), None);
    assert_eq!(summary(|_, s| s.touching = false).outcome, Some(Outcome::Lost));
}

#[test]
fn motion_before_measuring_does_not_count() {
    let s = summary(|t, s| s.position.y += if t < -1e-6 { 1.0 } else { 0.0 });
    assert_eq!((s.outcome, s.peak_motion_m), (Some(Outcome::Held), Some(0.0)));
}

#[test]
fn phases_and_quality_at_the_latch() {
    let s = summary(|t, s| {
        s.grasped = (-0.5..2.0 - 1e-9).contains(&t) || t > 3.0;
        s.quality = 0.5 + t;
    });
    assert!((s.latched_at_s.unwrap() - 0.5).abs() < 1e-12);
    assert!((s.released_at_s.unwrap() - 3.0).abs() < 1e-12);
    assert!(s.quality_at_latch_n.unwrap().abs() < 1e-12);
}

#[test]
fn creep_is_the_mean_speed_of_the_last_second_if_nothing_pushes() {
    let drift = |t: f64, s: &mut Sample| s.position.z += if t > 2.0 { 1e-3 * (t - 2.0) } else { 0.0 };
    assert!((summary(drift).creep_m_per_s.unwrap() - 1e-3).abs() < 1e-9);
    let t = trajectory([0.0; 2], drift);
    assert!(summarize(&t, FROM, Some(4.0)).creep_m_per_s.is_some());
    assert_eq!(summarize(&t, FROM, Some(4.5)).creep_m_per_s, None);
    // Less than a second is measured at all.
    assert_eq!(summarize(&t, 4.5, None).creep_m_per_s, None);
}

#[test]
fn slip_onset_penetration_and_unreached_measuring() {
    let s = summary(|t, s| {
        s.slip = 0.001 * t;
        s.penetration = if t < 0.0 { 1.0 } else { 1e-3 * t };
    });
    assert!((s.slip_onset_s.unwrap() - (FROM + 1.0 + STEP)).abs() < 1e-9);
    assert!((s.max_penetration_m.unwrap() - 4e-3).abs() < 1e-12);
    let s = summarize(&trajectory([1.0; 2], |_, _| ()), 6.0, None);
    assert_eq!((s.outcome, s.peak_motion_m, s.normal_force_total_n), (None, None, None));
}

#[test]
fn medians() {
    assert_eq!(median(vec![]), None);
    assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
    assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), Some(2.5));
}

fn compared(a: &Trajectory, b: &Trajectory) -> mujoco_grasp::scenario::compare::Comparison {
    let (sa, sb) = (summarize(a, FROM, None), summarize(b, FROM, None));
    compare((a, &sa), (b, &sb), FROM)
}

#[test]
fn a_run_compared_with_itself_differs_by_nothing() {
    let a = trajectory([1.0, 2.0], bump(0.02, 0.0));
    let c = compared(&a, &a);
    assert!(c.same_outcome);
    assert_eq!((c.position_rmse_m, c.relative_error), (Some(0.0), Some(0.0)));
    assert_eq!((c.rotation_rmse_rad, c.normal_force_relative_error), (Some(0.0), Some(0.0)));
}

#[test]
fn errors_are_root_mean_squares_over_the_window() {
    let a = trajectory([1.0, 2.0], bump(0.02, 0.0));
    let b = trajectory([1.3, 2.4], |t, s| {
        // Another pose before and at the start of measuring: only the motion since then counts.
        s.position += Vector3::new(1.0, 2.0, 3.0);
        bump(0.023, 0.0)(t, s);
        if t >= 1.0 {
            s.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.1) * s.rotation;
        }
    });
    let c = compared(&a, &b);
    let window = 401.0_f64;
    // 100 samples of the bump, 301 of the turn.
    assert!((c.position_rmse_m.unwrap() - 0.003 * (100.0 / window).sqrt()).abs() < 1e-12);
    assert!((c.relative_error.unwrap() - c.position_rmse_m.unwrap() / 0.02).abs() < 1e-12);
    assert!((c.rotation_rmse_rad.unwrap() - 0.1 * (301.0 / window).sqrt()).abs() < 1e-9);
    assert!((c.normal_force_relative_error.unwrap() - (0.25_f64 / 5.0).sqrt()).abs() < 1e-12);
}

#[test]
fn small_peaks_count_as_two_millimetres() {
    let a = trajectory([1.0; 2], bump(0.0005, 0.0));
    let b = trajectory([1.0; 2], bump(0.0006, 0.0));
    let c = compared(&a, &b);
    assert!((c.relative_error.unwrap() - c.position_rmse_m.unwrap() / 0.002).abs() < 1e-15);
}

#[test]
fn the_window_ends_with_the_first_loss_in_either_mode() {
    let a = trajectory([1.0; 2], |t, s| s.position.x -= if t > 2.005 { 0.1 * (t - 2.0) } else { 0.0 });
    let b = trajectory([1.0; 2], |t, s| s.position.x -= if t > 2.005 { 0.2 * (t - 2.0) } else { 0.0 });
    // b is lost 0.25 s after a starts to move: 25 samples of error up to 25 mm, in a window of 226.
    let c = compared(&a, &b);
    let sum: f64 = (1..=25).map(|k| (0.1 * STEP * f64::from(k)).powi(2)).sum();
    assert!(c.same_outcome);
    assert!((c.position_rmse_m.unwrap() - (sum / 226.0).sqrt()).abs() < 1e-9, "{c:?}");
}

#[test]
fn nothing_to_compare_is_null() {
    let a = trajectory([0.0; 2], |_, _| ());
    let c = compared(&a, &a);
    assert_eq!(c.normal_force_relative_error, None);
    let empty = Trajectory::new(vec![], 0);
    let s = summarize(&empty, FROM, None);
    let c = compare((&empty, &s), (&empty, &s), FROM);
    assert!(!c.same_outcome && c.position_rmse_m.is_none());
}

#[test]
fn csv_has_the_columns_of_the_reference() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full-none.csv");
    trajectory([1.5, 2.5], |t, s| s.grasped = t > 0.0).write_csv(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let mut lines = text.lines();
    assert_eq!(
        lines.next().unwrap(),
        "time_s,px_m,py_m,pz_m,qw,qx,qy,qz,phase,quality_n,normal_force_n:a,normal_force_n:b"
    );
    let first: Vec<f64> = lines.next().unwrap().split(',').map(|v| v.parse().unwrap()).collect();
    assert_eq!((first.len(), first[0], first[1], first[8], first[9], first[10]), (12, 0.0, 0.1, 0.0, 0.5, 1.5));
    let last: Vec<f64> = lines.next_back().unwrap().split(',').map(|v| v.parse().unwrap()).collect();
    assert_eq!((last[0], last[8]), (5.0, 1.0));
    assert_eq!(text.lines().count(), 502);
}

#[test]
fn shares_are_of_the_time_until_the_last_touch() {
    // Touched until 3 s after measuring starts, latched for the first two of them, and from before.
    let s = summary(|t, s| {
        s.grasped = (-0.5..1.995).contains(&t);
        s.gripped = t < 2.995;
    });
    assert!((s.latched_share.unwrap() - 2.0 / 3.0).abs() < 1e-9, "{:?}", s.latched_share);
    assert_eq!(s.substructured_share, Some(0.0));
    let times: Vec<(f64, u8)> = s.changes.iter().map(|c| (c.time_s, c.phase)).collect();
    assert_eq!(times, [(0.5, 1), (3.0, 0)]);
}

#[test]
fn shares_that_do_not_exist_are_null() {
    let never = summary(|_, _| ());
    assert_eq!((never.latched_share, never.substructured_share), (Some(0.0), None));
    assert!(never.changes.is_empty());
    let untouched = summary(|_, s| s.gripped = false);
    assert_eq!((untouched.latched_share, untouched.substructured_share), (None, None));
    // Latched before measuring only: nothing of the measured time.
    let before = summary(|t, s| s.grasped = t < -0.5);
    assert_eq!((before.latched_share, before.substructured_share), (Some(0.0), None));
    assert_eq!(before.changes.len(), 2);
}

#[test]
fn a_comparison_without_a_latched_step_in_its_window_says_nothing() {
    let full = trajectory([1.0, 2.0], |_, _| ());
    let early = trajectory([1.0, 2.0], |t, s| s.grasped = t < -0.1);
    assert!(compared(&full, &early).vacuous, "given up before measuring");
    // The window ends where the target is lost.
    let late = trajectory([1.0, 2.0], |t, s| {
        s.position.x += if t < 1.0 { 0.0 } else { 1.0 };
        s.grasped = t > 1.5;
    });
    assert!(compared(&full, &late).vacuous, "latched after the loss");
    let once = trajectory([1.0, 2.0], |t, s| s.grasped = (0.295..0.305).contains(&t));
    assert!(!compared(&full, &once).vacuous);
}
