//! What no measure of a grasp may depend on.

use crate::support::{Random, moved};
use mujoco_grasp::grasp::metrics::closure::force_closure;
use mujoco_grasp::grasp::metrics::quality::{Gram, QualityReport, min_singular_value, report};
use mujoco_grasp::grasp::monitor::wrench::LoadedContact;
use nalgebra::{Rotation3, Unit, Vector3, Vector6};
use proptest::prelude::*;

fn turned(v: &Vector6<f64>, turn: &Rotation3<f64>) -> Vector6<f64> {
    let f = turn * v.fixed_rows::<3>(0);
    let t = turn * v.fixed_rows::<3>(3);
    Vector6::new(f.x, f.y, f.z, t.x, t.y, t.z)
}

fn numbers(q: &QualityReport) -> [f64; 4] {
    // The volume's sixth root, as all others in newtons.
    [q.min_singular_value_n, q.ferrari_canny_n, q.hull_volume.powf(1.0 / 6.0), q.isotropy]
}

fn same(a: &QualityReport, b: &QualityReport, scale: f64) {
    for (k, (x, y)) in numbers(a).into_iter().zip(numbers(b)).enumerate() {
        let factor = if k == 3 { 1.0 } else { scale };
        assert!((x * factor - y).abs() <= 1e-5 * (y.abs() + 1e-3), "measure {k}: {x} * {factor} is not {y}");
    }
    assert_eq!(a.force_closure, b.force_closure);
    assert_eq!(a.contacts, b.contacts);
}

fn weight() -> Vector6<f64> {
    Vector6::new(0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
}

fn grasp(seed: u64, count: usize, condim: usize) -> (Vec<LoadedContact>, Vector3<f64>) {
    let mut random = Random::new(seed);
    let contacts = random.grasp(count, condim);
    (contacts, random.direction() * 0.01)
}

fn measure(contacts: &[LoadedContact], com: &Vector3<f64>, weight: &Vector6<f64>) -> QualityReport {
    report(contacts, com, weight).expect("a valid grasp")
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn pose_does_not_matter(
        seed in any::<u64>(), count in 2usize..7, condim in prop::sample::select(vec![1usize, 3, 4, 6]),
        angle in -3.0..3.0f64, shift in -2.0..2.0f64,
    ) {
        let (contacts, com) = grasp(seed, count, condim);
        let mut random = Random::new(seed ^ 1);
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(random.direction()), angle);
        let shift = random.direction() * shift;
        let away: Vec<_> = contacts.iter().map(|c| moved(c, &turn, &shift)).collect();
        let here = measure(&contacts, &com, &weight());
        let there = measure(&away, &(turn * com + shift), &turned(&weight(), &turn));
        same(&here, &there, 1.0);
        prop_assert_eq!(here.holds_own_weight, there.holds_own_weight);
    }

    #[test]
    fn order_does_not_matter(
        seed in any::<u64>(), count in 2usize..7, condim in prop::sample::select(vec![1usize, 3, 4, 6]),
        by in 1usize..6,
    ) {
        let (mut contacts, com) = grasp(seed, count, condim);
        let before = measure(&contacts, &com, &weight());
        contacts.rotate_left(by % count);
        contacts.swap(0, 1);
        let after = measure(&contacts, &com, &weight());
        same(&before, &after, 1.0);
        prop_assert_eq!(before.holds_own_weight, after.holds_own_weight);
    }

    #[test]
    fn forces_scale_all_measures_linearly(
        seed in any::<u64>(), count in 3usize..7, condim in prop::sample::select(vec![3usize, 4, 6]),
        factor in 0.01..100.0f64,
    ) {
        let (contacts, com) = grasp(seed, count, condim);
        let harder: Vec<_> = contacts
            .iter()
            .map(|c| LoadedContact { normal_force: c.normal_force * factor, force: c.force * factor, ..*c })
            .collect();
        same(
            &measure(&contacts, &com, &weight()),
            &measure(&harder, &com, &(weight() * factor)),
            factor,
        );
    }

    #[test]
    fn size_does_not_matter_when_torsional_lengths_grow_along(
        seed in any::<u64>(), count in 2usize..7, condim in prop::sample::select(vec![3usize, 4, 6]),
        factor in 0.01..100.0f64,
    ) {
        let (contacts, com) = grasp(seed, count, condim);
        let larger: Vec<_> = contacts
            .iter()
            .map(|c| {
                let [a, b, spin, roll, roll2] = c.friction;
                let friction = [a, b, spin * factor, roll * factor, roll2 * factor];
                LoadedContact { position: c.position * factor, friction, ..*c }
            })
            .collect();
        same(
            &measure(&contacts, &com, &weight()),
            &measure(&larger, &(com * factor), &weight()),
            1.0,
        );
    }

    #[test]
    fn the_choice_of_equal_tangents_does_not_matter(
        seed in any::<u64>(), count in 2usize..7, condim in prop::sample::select(vec![3usize, 4, 6]),
        angle in -3.0..3.0f64,
    ) {
        let (mut contacts, com) = grasp(seed, count, condim);
        for c in &mut contacts {
            c.friction = [c.friction[0], c.friction[0], c.friction[2], c.friction[3], c.friction[3]];
        }
        let spun: Vec<_> = contacts
            .iter()
            .map(|c| {
                let turn = Rotation3::from_axis_angle(&Unit::new_normalize(c.normal), angle);
                LoadedContact { tangents: c.tangents.map(|t| turn * t), ..*c }
            })
            .collect();
        let q = |contacts: &[LoadedContact]| min_singular_value(contacts, &com).expect("a valid grasp");
        prop_assert!((q(&contacts) - q(&spun)).abs() <= 1e-9 * (1.0 + q(&contacts)));
        prop_assert_eq!(
            force_closure(&contacts, &com).expect("a valid grasp"),
            force_closure(&spun, &com).expect("a valid grasp")
        );
    }

    #[test]
    fn at_a_fixed_length_pressing_one_contact_harder_never_lowers_q(
        seed in any::<u64>(), count in 3usize..7, which in 0usize..3, more in 1.0..5.0f64,
    ) {
        // G G' grows in every direction.
        let (mut contacts, com) = grasp(seed, count, 4);
        let all = |contacts: &[LoadedContact]| {
            let mut gram = Gram::new(com, 0.03);
            contacts.iter().for_each(|c| gram.add(c));
            gram.min_singular_value()
        };
        let before = all(&contacts);
        contacts[which].normal_force *= more;
        prop_assert!(all(&contacts) >= before * (1.0 - 1e-9));
    }
}
