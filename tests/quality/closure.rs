//! Force closure and equilibrium against known cases.

use crate::support::{Random, contact, equator, faces, on_sphere, tetrahedron};
use mujoco_grasp::grasp::metrics::closure::{BalancingForce, NormalForces, equilibrium, force_closure, load_factor};
use mujoco_grasp::grasp::metrics::quality::ferrari_canny;
use mujoco_grasp::grasp::monitor::wrench::LoadedContact;
use nalgebra::{Rotation3, Vector3, Vector6};

const SOFT: [f64; 5] = [0.5, 0.5, 0.005, 0.0001, 0.0001];

fn closed(contacts: &[LoadedContact]) -> bool {
    force_closure(contacts, &Vector3::zeros()).expect("a verified answer")
}

fn balance(contacts: &[LoadedContact], external: &Vector6<f64>, limit: NormalForces) -> Option<Vec<BalancingForce>> {
    let com = Vector3::zeros();
    let forces = equilibrium(contacts, &com, external, limit).expect("a verified answer")?;
    // Whatever was asked: the forces balance, and respect every cone and bound.
    let size = forces.iter().map(|f| f.force.norm()).fold(0.0, f64::max);
    let mut total = *external;
    for (c, f) in contacts.iter().zip(&forces) {
        let torque = c.position.cross(&f.force) + f.torque;
        total += Vector6::new(f.force.x, f.force.y, f.force.z, torque.x, torque.y, torque.z);
        let pressed = f.force.dot(&c.normal);
        let parts = [
            f.force.dot(&c.tangents[0]),
            f.force.dot(&c.tangents[1]),
            f.torque.dot(&c.normal),
            f.torque.dot(&c.tangents[0]),
            f.torque.dot(&c.tangents[1]),
        ];
        let mut used = 0.0;
        for (k, part) in parts.iter().enumerate() {
            if k + 1 < c.condim && c.friction[k] > 0.0 {
                used += (part / c.friction[k]).powi(2);
            } else {
                assert!(part.abs() < 1e-9, "component {k} has no friction");
            }
        }
        assert!(used.sqrt() <= pressed + 1e-6 * size, "outside the cone");
        if limit == NormalForces::Live {
            assert!(pressed <= c.normal_force * (1.0 + 1e-6));
        }
    }
    assert!(total.norm() <= 1e-6 * (1.0 + size), "unbalanced by {total}");
    Some(forces)
}

fn force(x: f64, y: f64, z: f64) -> Vector6<f64> {
    Vector6::new(x, y, z, 0.0, 0.0, 0.0)
}

fn torque(x: f64, y: f64, z: f64) -> Vector6<f64> {
    Vector6::new(0.0, 0.0, 0.0, x, y, z)
}

/// Two contacts at x = -a, a whose normals are turned by `angle` about y, the same way up.
fn tilted(angle: f64, condim: usize, friction: [f64; 5]) -> Vec<LoadedContact> {
    [-1.0, 1.0]
        .iter()
        .map(|&side| {
            let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), side * angle);
            let normal = turn * Vector3::new(-side, 0.0, 0.0);
            contact(Vector3::new(0.03 * side, 0.0, 0.0), normal, condim, friction, 1.0)
        })
        .collect()
}

#[test]
fn soft_antipodal_fingers_close_exactly_while_their_line_is_within_both_cones() {
    let edge = SOFT[0].atan();
    for (angle, expected) in
        [(0.0, true), (0.9 * edge, true), (0.999 * edge, true), (1.001 * edge, false), (1.2 * edge, false)]
    {
        assert_eq!(closed(&tilted(angle, 4, SOFT)), expected, "at {angle}");
        assert_eq!(closed(&tilted(-angle, 6, SOFT)), expected, "at {angle}");
        assert!(!closed(&tilted(angle, 3, SOFT)), "hard fingers, rank 5");
    }
    assert!(!closed(&tilted(edge, 4, SOFT)), "on the boundary");
}

#[test]
fn hard_fingers_close_from_three_on() {
    for n in [3, 4, 5, 9] {
        assert!(closed(&on_sphere(&equator(n), 0.04, 3, SOFT, 1.0)));
        assert!(!closed(&on_sphere(&equator(n), 0.04, 1, SOFT, 1.0)), "frictionless");
    }
    assert!(closed(&on_sphere(&tetrahedron(), 0.04, 3, SOFT, 1.0)));
    assert!(closed(&on_sphere(&faces(), 0.04, 3, SOFT, 1.0)));
    let frictionless = on_sphere(&equator(3), 0.04, 3, [0.0; 5], 1.0);
    assert!(!closed(&frictionless), "condim 3 with no friction");
}

#[test]
fn contacts_on_one_side_never_close() {
    let mut random = Random::new(8);
    for condim in [3, 4, 6] {
        let palm: Vec<_> = (0..6)
            .map(|_| {
                let at = Vector3::new(random.normal(), random.normal(), -1.0) * 0.03;
                contact(at, Vector3::z(), condim, SOFT, 1.0)
            })
            .collect();
        assert!(!closed(&palm));
        assert!(!closed(&palm[..1]));
    }
    assert!(!closed(&[]));
}

/// Form closure: seven frictionless contacts can hold a body that six never hold (Somov).
#[test]
fn six_frictionless_contacts_never_close_and_more_can() {
    let mut random = Random::new(21);
    let mut seen = 0;
    for _ in 0..60 {
        let contacts = random.grasp(14, 1);
        assert!(!closed(&contacts[..6]));
        seen += usize::from(closed(&contacts));
    }
    assert!(seen > 0, "no 14 frictionless contacts closed");
}

#[test]
fn closure_and_epsilon_agree_and_forces_play_no_part() {
    let mut random = Random::new(31);
    let mut seen = [0, 0];
    for round in 0..60 {
        let mut contacts = random.grasp(2 + round % 4, [3, 4, 6][round % 3]);
        let answer = closed(&contacts);
        seen[usize::from(answer)] += 1;
        // The hull's linearised cones lie within the exact ones.
        let epsilon = ferrari_canny(&contacts, &Vector3::zeros()).expect("a valid grasp");
        assert!(answer || epsilon == 0.0, "closed by edges, not by cones");
        // And the octagon contains the circle of its inner radius.
        if contacts[0].condim == 3 {
            let mut slippery = contacts.clone();
            for mu in slippery.iter_mut().flat_map(|c| &mut c.friction) {
                *mu *= (std::f64::consts::PI / 8.0).cos();
            }
            assert!(epsilon > 0.0 || !closed(&slippery), "closed, but epsilon 0");
        }
        contacts.iter_mut().for_each(|c| c.normal_force = 0.0);
        assert_eq!(closed(&contacts), answer);
    }
    assert!(seen[0] > 5 && seen[1] > 5, "{seen:?}");
}

#[test]
fn force_closure_means_equilibrium_under_any_wrench() {
    let mut random = Random::new(41);
    let grasp = on_sphere(&equator(3), 0.04, 4, SOFT, 1.0);
    assert!(closed(&grasp));
    for _ in 0..20 {
        let f = random.direction() * 3.0;
        let t = random.direction() * 0.2;
        let wrench = Vector6::new(f.x, f.y, f.z, t.x, t.y, t.z);
        assert!(balance(&grasp, &wrench, NormalForces::Unlimited).is_some());
    }
    let hard = on_sphere(&equator(2), 0.04, 3, SOFT, 1.0);
    assert!(balance(&hard, &force(0.3, 2.0, -1.0), NormalForces::Unlimited).is_some());
    assert!(balance(&hard, &torque(0.0, 0.1, 0.0), NormalForces::Unlimited).is_some());
    assert!(balance(&hard, &torque(0.01, 0.0, 0.0), NormalForces::Unlimited).is_none());
}

#[test]
fn the_least_normal_forces_that_carry_a_weight() {
    // Three fingers around an equator: 3 mu f = W.
    let grasp = on_sphere(&equator(3), 0.04, 3, SOFT, 1.0);
    let forces = balance(&grasp, &force(0.0, 0.0, -3.0), NormalForces::Unlimited).expect("held");
    let total: f64 = grasp.iter().zip(&forces).map(|(c, f)| c.normal.dot(&f.force)).sum();
    assert!((total - 3.0 / SOFT[0]).abs() < 1e-5, "{total}");
    // A palm holds what presses on it, and by friction what pulls along it, but nothing that pulls away.
    let palm = [contact(Vector3::new(0.0, 0.0, -0.03), Vector3::z(), 3, SOFT, 1.0)];
    let forces = balance(&palm, &force(0.0, 0.0, -2.0), NormalForces::Unlimited).expect("held");
    assert!((forces[0].force - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-6);
    assert!(balance(&palm, &force(0.0, 0.0, 2.0), NormalForces::Unlimited).is_none());
    assert!(balance(&palm, &force(1.0, 0.0, 0.0), NormalForces::Unlimited).is_none());
}

#[test]
fn the_load_factor_is_the_live_friction_over_the_weight() {
    for (f, weight) in [(2.0, 1.0), (2.0, 3.0), (0.02, 0.05), (800.0, 100.0)] {
        let grasp = on_sphere(&equator(3), 0.04, 3, SOFT, f);
        let load = force(0.0, 0.0, -weight);
        let factor = load_factor(&grasp, &Vector3::zeros(), &load).expect("a verified answer");
        let expected = 3.0 * SOFT[0] * f / weight;
        assert!((factor / expected - 1.0).abs() < 1e-5, "{factor} is not {expected}");
        let held = balance(&grasp, &load, NormalForces::Live).is_some();
        assert_eq!(held, expected >= 1.0);
        assert!(balance(&grasp, &load, NormalForces::Unlimited).is_some());
    }
}

#[test]
fn torsion_carries_what_its_coefficient_says() {
    let pinch = on_sphere(&equator(2), 0.03, 4, SOFT, 4.0);
    let factor = |wrench| load_factor(&pinch, &Vector3::zeros(), &wrench).expect("verified");
    assert!((factor(torque(0.01, 0.0, 0.0)) - 2.0 * 4.0 * SOFT[2] / 0.01).abs() < 1e-4);
    assert!((factor(force(0.0, 1.0, 0.0)) - 2.0 * 4.0 * SOFT[0]).abs() < 1e-4);
    // Both at once: an ellipse, (F / mu)^2 + (T / mu_t)^2 = (2 f)^2.
    let both = force(0.0, 1.0, 0.0) + torque(0.01, 0.0, 0.0);
    let expected = 8.0 / ((1.0 / SOFT[0]).powi(2) + (0.01 / SOFT[2]).powi(2)).sqrt();
    assert!((factor(both) - expected).abs() < 1e-4);
    // Along the line between the fingers: the live force of one of them.
    assert!((factor(force(1.0, 0.0, 0.0)) - 4.0).abs() < 1e-4);
}

#[test]
fn unloaded_contacts_hold_nothing_by_live_forces() {
    let grasp = on_sphere(&equator(4), 0.04, 4, SOFT, 0.0);
    let weight = force(0.0, 0.0, -1.0);
    assert_eq!(load_factor(&grasp, &Vector3::zeros(), &weight).expect("verified"), 0.0);
    assert!(balance(&grasp, &weight, NormalForces::Live).is_none());
    assert!(balance(&[], &weight, NormalForces::Unlimited).is_none());
}

#[test]
fn without_an_external_wrench_nothing_is_needed() {
    let grasp = on_sphere(&equator(3), 0.04, 3, SOFT, 1.0);
    let none = Vector6::zeros();
    for limit in [NormalForces::Unlimited, NormalForces::Live] {
        let forces = balance(&grasp, &none, limit).expect("held");
        assert!(forces.iter().all(|f| f.force.norm() == 0.0 && f.torque.norm() == 0.0));
    }
    assert_eq!(load_factor(&grasp, &Vector3::zeros(), &none).expect("verified"), f64::INFINITY);
}

/// Live forces of a target at rest are themselves an equilibrium: the factor is at least 1 whatever the geometry.
#[test]
fn forces_that_balance_a_wrench_are_found_to_balance_it() {
    let mut random = Random::new(51);
    for round in 0..60 {
        let condim = [1, 3, 4, 6][round % 4];
        let contacts: Vec<LoadedContact> = random
            .grasp(1 + round % 7, condim)
            .into_iter()
            .map(|mut c| {
                // A random force within the cone, deeper or less deep.
                let share = random.uniform() / 5f64.sqrt();
                for (row, mu) in c.friction.iter().enumerate().take(condim - 1) {
                    let size = share * mu * c.normal_force * (2.0 * random.uniform() - 1.0);
                    match row {
                        0 | 1 => c.force += c.tangents[row] * size,
                        2 => c.torque += c.normal * size,
                        _ => c.torque += c.tangents[row - 3] * size,
                    }
                }
                c
            })
            .collect();
        let com = Vector3::zeros();
        let external = -contacts.iter().map(|c| c.wrench_about(&com)).sum::<Vector6<f64>>();
        let factor = load_factor(&contacts, &com, &external).expect("a verified answer");
        assert!(factor > 1.0 - 1e-5, "round {round}: {factor}");
        assert!(balance(&contacts, &external, NormalForces::Live).is_some());
        assert!(balance(&contacts, &external, NormalForces::Unlimited).is_some());
    }
}

#[test]
fn a_hard_pinch_pulled_in_any_direction_of_a_plane() {
    let pinch = on_sphere(&equator(2), 0.03, 3, SOFT, 1.0);
    for k in 0..12 {
        let angle = std::f64::consts::TAU * k as f64 / 12.0;
        let pull = force(angle.cos(), 0.0, angle.sin());
        let factor = load_factor(&pinch, &Vector3::zeros(), &pull).expect("verified");
        // Against x the near finger needs n1 - n2 = s |cos|; both carry z: mu (n1 + n2) >= s |sin| with equal shares
        // for no torque: each mu n_i >= s |sin| / 2, n1 <= 1.
        let (c, s) = (angle.cos().abs(), angle.sin().abs());
        let expected = 1.0 / (c + s / (2.0 * SOFT[0]));
        assert!((factor - expected).abs() < 1e-5, "{factor} is not {expected}");
    }
}
