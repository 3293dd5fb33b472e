//! Actuator targets over time.

use mujoco_grasp::scenario::control::{Entry, Schedule};

fn entry(time: f64, all: Option<f64>, set: &[(usize, f64)]) -> Entry {
    Entry { time, all, set: set.to_vec() }
}

fn at(schedule: &Schedule, time: f64) -> [f64; 3] {
    let mut ctrl = [f64::NAN; 3];
    schedule.apply(time, &mut ctrl);
    ctrl
}

#[test]
fn without_entries_everything_keeps_its_starting_value() {
    let schedule = Schedule::new(&[1.0, 2.0, 3.0], &[]);
    assert_eq!(at(&schedule, 0.0), [1.0, 2.0, 3.0]);
    assert_eq!(at(&schedule, 9.0), [1.0, 2.0, 3.0]);
}

#[test]
fn targets_are_linear_from_entry_to_entry() {
    let entries = [entry(1.0, None, &[(0, 2.0)]), entry(3.0, None, &[(0, -2.0)])];
    let schedule = Schedule::new(&[1.0, 0.0, 0.0], &entries);
    for (time, expected) in [(0.0, 1.0), (0.25, 1.25), (1.0, 2.0), (2.0, 0.0), (2.5, -1.0), (3.0, -2.0), (10.0, -2.0)] {
        assert!((at(&schedule, time)[0] - expected).abs() < 1e-15, "{time}");
    }
}

#[test]
fn an_actuator_that_an_entry_leaves_out_stays_on_its_last_target() {
    let entries =
        [entry(1.0, None, &[(0, 1.0), (1, 1.0)]), entry(2.0, None, &[(1, 5.0)]), entry(4.0, None, &[(0, 3.0)])];
    let schedule = Schedule::new(&[0.0; 3], &entries);
    assert_eq!(at(&schedule, 1.5), [1.0, 3.0, 0.0]);
    // Actuator 0 leaves its target only after the entry that left it out.
    assert_eq!(at(&schedule, 2.0)[0], 1.0);
    assert_eq!(at(&schedule, 3.0), [2.0, 5.0, 0.0]);
    assert_eq!(at(&schedule, 4.0), [3.0, 5.0, 0.0]);
}

#[test]
fn all_comes_before_set() {
    let schedule = Schedule::new(&[9.0; 3], &[entry(1.0, Some(0.0), &[(1, 4.0)])]);
    assert_eq!(at(&schedule, 1.0), [0.0, 4.0, 0.0]);
    assert_eq!(at(&schedule, 0.5), [4.5, 6.5, 4.5]);
}

#[test]
fn entries_count_in_order_of_time_and_equal_times_jump() {
    let sorted = [entry(1.0, None, &[(0, 1.0)]), entry(2.0, None, &[(0, 0.0)])];
    let reversed = [sorted[1].clone(), sorted[0].clone()];
    let (a, b) = (Schedule::new(&[0.0; 3], &sorted), Schedule::new(&[0.0; 3], &reversed));
    assert_eq!(at(&a, 1.5), at(&b, 1.5));
    assert_eq!(at(&a, 1.0)[0], 1.0);
    let jump = Schedule::new(&[0.0; 3], &[entry(1.0, None, &[(0, 1.0)]), entry(1.0, None, &[(0, 7.0)])]);
    assert!((at(&jump, 0.999_999)[0] - 1.0).abs() < 1e-5);
    assert_eq!(at(&jump, 1.0)[0], 7.0);
}

#[test]
fn an_entry_at_the_start_counts_at_once() {
    assert_eq!(at(&Schedule::new(&[1.0; 3], &[entry(0.0, Some(5.0), &[])]), 0.0), [5.0; 3]);
}

#[test]
fn inverse_kinematics_hands_over_where_it_stopped() {
    let entries = [entry(1.0, Some(1.0), &[]), entry(4.0, None, &[(0, 3.0)]), entry(6.0, Some(0.0), &[])];
    let mut schedule = Schedule::new(&[0.0; 3], &entries);
    schedule.continue_from(2.0, 0, 2.0);
    schedule.continue_from(2.0, 1, 8.0);
    // Actuator 0 is under way to the entry at 4 s, 1 stays until the one at 6 s, 2 never noticed.
    assert_eq!(at(&schedule, 2.0), [2.0, 8.0, 1.0]);
    assert_eq!(at(&schedule, 3.0), [2.5, 8.0, 1.0]);
    assert_eq!(at(&schedule, 5.0), [1.5, 4.0, 0.5]);
    assert_eq!(at(&schedule, 6.0), [0.0; 3]);
}
