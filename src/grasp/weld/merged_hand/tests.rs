//! Closed forms, and a dense oracle.

use super::*;
use nalgebra::{Rotation3, Vector3};

/// Rows of a contact at `p` with axes `r`: three forces, three torques.
fn maps(p: &Vector3<f64>, r: &Rotation3<f64>) -> Vec<Vector6<f64>> {
    (0..6)
        .map(|i| {
            let axis = r.matrix().column(i % 3).into_owned();
            let (f, t) = if i < 3 { (axis, p.cross(&axis)) } else { (Vector3::zeros(), axis) };
            Vector6::new(f.x, f.y, f.z, t.x, t.y, t.z)
        })
        .collect()
}

fn rotation(seed: f64) -> Rotation3<f64> {
    Rotation3::from_euler_angles(seed.sin(), (2.0 * seed).cos(), 3.0 * seed)
}

/// HandInverseInertia `B B^T` of rank 2, as a finger of two joints has it.
fn mobility(seed: f64) -> Vec<f64> {
    let b = |i: usize, j: usize| (seed + 1.7 * i as f64 + 0.9 * j as f64).sin();
    (0..36).map(|e| b(e / 6, 0) * b(e % 6, 0) + b(e / 6, 1) * b(e % 6, 1)).collect()
}

/// Joints that carry the palm.
const BASE: usize = 2;

fn base(seed: f64) -> Vec<f64> {
    (0..6 * BASE).map(|e| (2.1 * seed + e as f64).cos()).collect()
}

const RESISTANCE: [f64; 6] = [0.1, 0.02, 0.03, 0.4, 0.5, 0.6];

fn hand(turn: &Rotation3<f64>, order: &[usize]) -> MergedHand {
    let mut merged = MergedHand::default();
    merged.begin(BASE);
    for &i in order {
        let seed = i as f64;
        let p = turn * Vector3::new(seed.cos(), seed.sin(), 0.3 * seed);
        let r = turn * rotation(seed);
        merged.add_finger(&mobility(seed), &base(seed), &maps(&p, &r), &RESISTANCE, 0..6);
    }
    assert!(merged.finish());
    merged
}

/// n equal springs `k` (no joints, so `k = 1/R`) on three sides of a sphere of radius `r`: K is known.
#[test]
fn impedance_of_springs_around_a_sphere_has_its_closed_form() {
    let (k, r) = (40.0, 0.05);
    let mut merged = MergedHand::default();
    merged.begin(0);
    for i in 0..6 {
        let sign = if i < 3 { 1.0 } else { -1.0 };
        let mut p = Vector3::zeros();
        p[i % 3] = sign * r;
        let rows = maps(&p, &Rotation3::identity());
        // without joints, coupled or not
        merged.add_finger(&[0.0; 9], &[], &rows[..3], &[1.0 / k; 3], 0..i / 2);
    }
    assert!(merged.finish());
    // six isotropic springs: 6 k against translation; four of them at arm r against each rotation
    let mut expected = Matrix6::zeros();
    for i in 0..3 {
        expected[(i, i)] = 6.0 * k;
        expected[(i + 3, i + 3)] = 4.0 * k * r * r;
    }
    assert!((merged.impedance() - expected).amax() < 1e-12 * 6.0 * k);
    // springs alone: all of the compliance is the contacts' own
    let inverse = expected.try_inverse().unwrap();
    assert!((merged.softness() - inverse).amax() < 1e-10 * inverse.amax());
}

#[test]
fn a_rigid_motion_of_all_effectors_is_the_merged_parts_own_without_internal_force() {
    let mut merged = hand(&Rotation3::identity(), &[0, 1, 2, 3]);
    let twist = Vector6::new(0.3, -0.2, 0.5, 1.1, 0.7, -0.4);
    let rows: Vec<f64> = merged.maps.iter().map(|g| g.dot(&twist)).collect();
    assert!((merged.merge(&rows) - twist).norm() < 1e-10);
    let mut internal = Vec::new();
    merged.internal(&rows, &mut internal);
    assert!(linalg::norm(&internal) < 1e-9);
}

#[test]
fn shares_of_a_wrench_sum_to_it_and_the_internal_forces_to_nothing() {
    let mut merged = hand(&Rotation3::identity(), &[0, 1, 2]);
    let lambda = Vector6::new(1.0, 2.0, -0.5, 0.1, -0.3, 0.2);
    let forces: Vec<f64> = (0..18).map(|i| merged.share(i).dot(&lambda)).collect();
    assert!((merged.wrench(&forces) - lambda).norm() < 1e-10);
    let d: Vec<f64> = (0..18).map(|i| (i as f64).cos()).collect();
    let mut internal = Vec::new();
    merged.internal(&d, &mut internal);
    assert!(linalg::norm(&internal) > 0.1);
    assert!(merged.wrench(&internal).norm() < 1e-9 * linalg::norm(&internal));
}

/// The forces solve the whole problem: `(J M^-1 J^T + R) f = u - G^T a` for all rows, balance on the target.
#[test]
fn internal_forces_and_shares_are_the_stick_solution_of_the_whole_grasp() {
    let mut merged = hand(&Rotation3::identity(), &[0, 1, 2]);
    let inertia = Matrix6::from_diagonal(&Vector6::new(0.2, 0.2, 0.2, 1e-3, 2e-3, 3e-3)) * 100.0;
    let smooth = Vector6::new(0.0, 0.0, -9.81, 0.1, 0.0, 0.2);
    let u: Vec<f64> = (0..18).map(|i| (1.3 * i as f64).sin()).collect();
    // oracle: dense block elimination of [Mo, -G; G^T, W] [a; f] = [Mo a0; u]
    let size = 6 + 18;
    let mut a = nalgebra::DMatrix::<f64>::zeros(size, size);
    let mut b = nalgebra::DVector::<f64>::zeros(size);
    a.view_mut((0, 0), (6, 6)).copy_from(&inertia);
    b.rows_mut(0, 6).copy_from(&(inertia * smooth));
    for i in 0..18 {
        for axis in 0..6 {
            a[(axis, 6 + i)] = -merged.maps[i][axis];
            a[(6 + i, axis)] = merged.maps[i][axis];
        }
        let w = mobility((i / 6) as f64);
        for j in 0..6 {
            a[(6 + i, 6 + 6 * (i / 6) + j)] += w[6 * (i % 6) + j];
        }
        a[(6 + i, 6 + i)] += RESISTANCE[i % 6];
        b[6 + i] = u[i];
        for j in 0..18 {
            let rows = [i, j].map(|i| base((i / 6) as f64)[BASE * (i % 6)..][..BASE].to_vec());
            a[(6 + i, 6 + j)] += linalg::dot(&rows[0], &rows[1]);
        }
    }
    let oracle = a.lu().solve(&b).unwrap();
    // lambda = K (ubar - a), Mo (a - a0) = lambda
    let k = *merged.impedance();
    let target = (inertia + k).lu().solve(&(inertia * smooth + k * merged.merge(&u))).unwrap();
    let lambda = k * (merged.merge(&u) - target);
    let mut internal = Vec::new();
    merged.internal(&u, &mut internal);
    for i in 0..18 {
        let f = merged.share(i).dot(&lambda) - internal[i];
        assert!((f - oracle[6 + i]).abs() < 1e-8, "{i}: {f} {}", oracle[6 + i]);
    }
    assert!((target - oracle.rows(0, 6)).norm() < 1e-9);
}

#[test]
fn turning_the_world_turns_the_merged_part_and_order_changes_nothing() {
    let turn = rotation(0.77);
    let (still, turned) = (hand(&Rotation3::identity(), &[0, 1, 2, 3]), hand(&turn, &[0, 1, 2, 3]));
    let mut six = Matrix6::zeros();
    six.fixed_view_mut::<3, 3>(0, 0).copy_from(turn.matrix());
    six.fixed_view_mut::<3, 3>(3, 3).copy_from(turn.matrix());
    let scale = still.impedance().amax();
    assert!((six * still.impedance() * six.transpose() - turned.impedance()).amax() < 1e-12 * scale);
    for row in 0..24 {
        assert!((six * still.share(row) - turned.share(row)).norm() < 1e-9);
    }
    let reordered = hand(&Rotation3::identity(), &[2, 0, 3, 1]);
    assert!((still.impedance() - reordered.impedance()).amax() < 1e-12 * scale);
    assert!((still.share(12) - reordered.share(0)).norm() < 1e-9);
}

#[test]
fn contacts_that_leave_a_motion_free_have_no_inverse() {
    let mut merged = MergedHand::default();
    merged.begin(0);
    let rows = maps(&Vector3::new(0.1, 0.0, 0.0), &Rotation3::identity());
    merged.add_finger(&[0.0; 9], &[], &rows[..3], &[0.1; 3], 0..3);
    assert!(!merged.finish(), "one hard contact holds three motions of six");
}
