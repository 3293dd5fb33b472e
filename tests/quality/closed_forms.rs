//! Q against closed forms, and its two implementations against each other.

use crate::support::{Random, contact, equator, faces, on_sphere, tetrahedron};
use mujoco_grasp::grasp::metrics::quality::{Gram, basis_wrenches, isotropy, min_singular_value, singular_values};
use mujoco_grasp::grasp::monitor::wrench::{LoadedContact, contact_radius};
use mujoco_grasp::grasp::{default_latch_quality, default_release_quality};
use nalgebra::{Matrix6, Vector3};

const A: f64 = 0.04;
const MU: f64 = 0.8;
const SPIN: f64 = 0.01;
const F: f64 = 2.5;
const SOFT: [f64; 5] = [MU, MU, SPIN, 0.0005, 0.0005];

fn quality(contacts: &[LoadedContact]) -> f64 {
    let reference = min_singular_value(contacts, &Vector3::zeros()).expect("a valid grasp");
    let gram = Gram::of(contacts, &Vector3::zeros());
    let fast = gram.min_singular_value();
    let largest = singular_values(contacts, &Vector3::zeros()).expect("a valid grasp")[0];
    assert!((fast - reference).abs() <= 1e-7 * largest, "{fast} against {reference}");
    if reference > 0.0 {
        assert!(gram.exceeds(reference * (1.0 - 1e-6)));
        assert!(!gram.exceeds(reference * (1.0 + 1e-6)));
    } else {
        assert!(!gram.exceeds(0.0));
    }
    reference
}

fn close(value: f64, expected: f64) {
    assert!((value - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{value} is not {expected}");
}

#[test]
fn two_hard_fingers_have_rank_five_and_no_quality() {
    let pinch = on_sphere(&equator(2), A, 3, SOFT, F);
    let values = singular_values(&pinch, &Vector3::zeros()).expect("a valid grasp");
    assert_eq!(values[5], 0.0);
    assert!(values[4] > 0.1);
    assert_eq!(quality(&pinch), 0.0);
}

#[test]
fn two_soft_fingers() {
    let q = |friction| quality(&on_sphere(&equator(2), A, 4, friction, F));
    // Weakest in torsion, in sliding, and between the fingers.
    close(q(SOFT), F * 2.0 * SPIN / A);
    close(q([0.1, 0.1, 0.05, 0.0, 0.0]), F * 2.0 * 0.1);
    close(q([2.0, 2.0, 0.05, 0.0, 0.0]), F * 2f64.sqrt());
}

#[test]
fn rolling_friction_of_two_fingers_counts_like_torsion() {
    // Frictionless but for couples: tau_y, tau_z get 4 (mu_r / a)^2, but no force but f_x exists.
    let rolling = on_sphere(&equator(2), A, 6, [0.0, 0.0, SPIN, 0.02, 0.02], F);
    let values = singular_values(&rolling, &Vector3::zeros()).expect("a valid grasp");
    let couple = |mu: f64| 2.0 * mu / A * F;
    for (value, expected) in values.iter().zip([2f64.sqrt() * F, couple(0.02), couple(0.02), couple(SPIN), 0.0, 0.0]) {
        close(*value, expected);
    }
}

#[test]
fn fingers_around_an_equator() {
    for n in [3, 4, 5, 8] {
        let grasp = on_sphere(&equator(n), A, 3, SOFT, F);
        close(quality(&grasp), (n as f64).sqrt() * MU * F);
    }
}

#[test]
fn three_fingers_with_strong_friction_and_torsion_are_weakest_in_their_plane() {
    // Torsion makes every torque strong; 3/2 (1 + 2 mu^2) in the plane is then less than 6 mu^2 across it.
    let grasp = on_sphere(&equator(3), A, 4, [2.0, 2.0, 10.0, 0.0, 0.0], F);
    close(quality(&grasp), F * (1.5f64 * (1.0 + 2.0 * 4.0)).sqrt());
}

#[test]
fn four_fingers_at_a_tetrahedrons_corners() {
    let q = |mu| quality(&on_sphere(&tetrahedron(), A, 3, [mu, mu, 0.0, 0.0, 0.0], F));
    close(q(MU), F * 4.0 * MU / 3f64.sqrt());
    close(q(0.2), F * 4.0 * 0.2 / 3f64.sqrt());
    // Torsion adds 8/3 (mu_t / a)^2 to each torque; then forces are weakest.
    let soft = on_sphere(&tetrahedron(), A, 4, [MU, MU, A, 0.0, 0.0], F);
    close(quality(&soft), F * ((4.0 + 16.0 * MU * MU) / 3.0).sqrt());
    close(
        isotropy(&soft, &Vector3::zeros()).expect("a valid grasp"),
        ((4.0 + 16.0 * MU * MU) / (16.0 * MU * MU + 8.0)).sqrt(),
    );
}

#[test]
fn six_contacts_on_a_cubes_faces() {
    let grasp = on_sphere(&faces(), A, 3, SOFT, F);
    close(quality(&grasp), F * 2.0 * 2f64.sqrt() * MU);
    close(isotropy(&grasp, &Vector3::zeros()).expect("a valid grasp"), (8.0 * MU * MU / (2.0 + 8.0 * MU * MU)).sqrt());
}

#[test]
fn frictionless_fingers_on_a_sphere_cannot_turn_it() {
    let grasp = on_sphere(&faces(), A, 1, SOFT, F);
    let values = singular_values(&grasp, &Vector3::zeros()).expect("a valid grasp");
    close(values[2], 2f64.sqrt() * F);
    assert_eq!(values[3..], [0.0; 3]);
}

#[test]
fn seven_frictionless_contacts_can_have_quality() {
    let mut random = Random::new(3);
    assert!(quality(&random.grasp(7, 1)) > 0.0);
}

#[test]
fn degenerate_grasps_have_no_quality() {
    assert_eq!(quality(&[]), 0.0);
    let one = contact(Vector3::new(0.3, 0.1, 0.2), Vector3::x(), 6, SOFT, F);
    assert_eq!(quality(&[one]), 0.0);
    let elsewhere = LoadedContact { normal: -one.normal, ..one };
    assert_eq!(quality(&[one, elsewhere]), 0.0, "contacts on one spot");
    let unloaded: Vec<_> = on_sphere(&equator(5), A, 4, SOFT, 0.0);
    assert_eq!(quality(&unloaded), 0.0);
}

#[test]
fn the_radius_is_the_mean_distance_and_ignores_unloaded_contacts() {
    let mut grasp = on_sphere(&equator(3), A, 3, SOFT, F);
    close(contact_radius(&grasp), A);
    let before = quality(&grasp);
    grasp.push(contact(Vector3::new(1.0, 0.0, 0.0), -Vector3::x(), 3, SOFT, 0.0));
    close(contact_radius(&grasp), A);
    close(quality(&grasp), before);
}

#[test]
fn gram_agrees_with_the_decomposition_on_random_grasps() {
    let mut random = Random::new(7);
    let mut positive = 0;
    for round in 0..300 {
        let count = 1 + round % 8;
        let condim = [1, 3, 4, 6][round % 4];
        positive += usize::from(quality(&random.grasp(count, condim)) > 0.0);
    }
    assert!(positive > 120, "only {positive} grasps had full rank");
}

#[test]
fn numbers_that_are_not_finite_have_no_quality_in_the_hot_loop() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut grasp = on_sphere(&equator(5), A, 3, SOFT, F);
        grasp[2].normal_force = bad;
        let gram = Gram::of(&grasp, &Vector3::zeros());
        assert_eq!(gram.min_singular_value(), 0.0);
        assert!(!gram.exceeds(0.1));
        assert!(min_singular_value(&grasp, &Vector3::zeros()).is_err());
    }
    let sound = Gram::of(&on_sphere(&equator(5), A, 3, SOFT, F), &Vector3::zeros());
    assert!(!sound.exceeds(f64::NAN));
    assert!(sound.exceeds(-1.0));
    assert!(sound.exceeds(0.0));
}

/// The derivation of the default threshold: grasps that can just carry their target.
#[test]
fn grasps_that_can_just_carry_the_target_reach_the_default_threshold() {
    let weight = 1.962;
    let latch = default_latch_quality(weight);
    assert!(default_release_quality(latch) < latch);
    for n in [3, 4, 5, 10, 20] {
        for mu in [0.2, 0.5, 1.0] {
            let force = weight / (n as f64 * mu);
            let q = quality(&on_sphere(&equator(n), A, 3, [mu, mu, 0.0, 0.0, 0.0], force));
            close(q, weight / (n as f64).sqrt());
            assert!(q > latch);
        }
    }
    for a in [0.004, 0.02, 0.0499] {
        // MuJoCo's default friction.
        let friction = [1.0, 1.0, 0.005, 0.0001, 0.0001];
        let q = quality(&on_sphere(&equator(2), a, 4, friction, weight / 2.0));
        assert!(q > latch, "{q} at radius {a}");
    }
}

#[test]
fn the_gram_matrix_is_the_grasp_matrix_times_its_transpose() {
    let mut random = Random::new(17);
    for condim in [1, 3, 4, 6] {
        let contacts = random.grasp(4, condim);
        let com = random.direction() * 0.02;
        let columns = basis_wrenches(&contacts, &com).expect("a valid grasp");
        // A normal force, and both members of every friction pair.
        assert_eq!(columns.len(), 4 * (1 + 2 * (condim - 1)));
        let product: Matrix6<f64> = columns.iter().map(|w| w * w.transpose()).sum();
        let gram = Gram::of(&contacts, &com);
        assert!((gram.matrix() - product).norm() <= 1e-13 * product.norm());
    }
}
