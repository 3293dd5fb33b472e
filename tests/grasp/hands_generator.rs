//! Generated hands of all sizes compile, latch, hold, and have the contacts that were asked for.

#[allow(dead_code)] // the bench uses the rest
#[path = "../../benches/hands/hand.rs"]
mod hand;
#[allow(dead_code)]
#[path = "../../benches/hands/held.rs"]
mod held;

use hand::Hand;

fn check(fingers: usize, contacts_per_finger: usize, other_joints: usize) {
    let hand = Hand::new(fingers, contacts_per_finger, other_joints).expect("a size that there is");
    let plan = hand.plan().expect("a plan");
    let held = held::check(&hand, &plan).expect("a hand that holds");
    let moved = held.summary.peak_motion_m.expect("a motion");
    assert!(moved < 1e-4, "{}: the can has moved {moved} m in a hand at rest", hand.name());
}

#[test]
fn two_fingers_with_a_contact_each_hold() {
    check(2, 1, 20);
}

#[test]
fn five_fingers_hold_with_five_to_eighty_contacts() {
    for contacts in [1, 2, 3, 7, 16] {
        check(5, contacts, 20);
    }
}

#[test]
fn ten_fingers_hold_with_eighty_contacts() {
    check(10, 8, 20);
}

#[test]
fn two_hundred_other_joints_do_not_keep_a_hand_from_holding() {
    check(3, 2, 200);
}

#[test]
fn every_number_of_other_joints_makes_a_model_of_that_size() {
    for joints in [20, 24, 25, 111] {
        let hand = Hand::new(2, 1, joints).expect("a size that there is");
        assert_eq!(hand.plan().expect("a plan").model.nv(), hand.nv());
    }
}

#[test]
fn sizes_that_there_are_not_are_refused_with_those_that_there_are() {
    for (size, range) in [((1, 4, 20), "2 to 10"), ((5, 17, 20), "1 to 16"), ((5, 4, 19), "20 to 200")] {
        let error = Hand::new(size.0, size.1, size.2).expect_err("no such hand").to_string();
        assert!(error.contains(range), "{error}");
    }
}
