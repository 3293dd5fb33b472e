//! The merged effectors of the thesis: many fingers as one part, whose twist is the fit to theirs that their impedances
//! weigh.
//!
//! Where contacts stick, the hand answers an acceleration `d` of their rows with the forces `k d` on the target,
//! `k = (J M^-1 J^T + R)^-1`, `J` the rows' Jacobian over the hand's joints and `R` what is soft in the contacts
//! themselves. With the grasp map `G` (row force -> wrench on the target)
//!
//! ```text
//! K    = G k G^T            impedance of the hand, as the target feels it
//! V_c  = K^-1 G k J qvel    twist of the merged part
//! f    = k G^T K^-1 lambda  what the contacts carry of the wrench lambda across the grasp
//! ```
//!
//! and the rest of the contact forces, the internal force, is [`MergedHand::internal`].
//!
//! Fingers meet in the palm only: `J M^-1 J^T` is a block for each finger, of its own joints with the palm held, plus
//! `B B^T` of the few joints between world and palm. So `k` is inverted finger by finger, and the palm's part comes in by
//! the Woodbury identity. (Without it, the impedance of each finger for itself, the internal force of a hand on a light arm is
//! wrong: the wrench across the grasp accelerates the palm, and the fingers' inertia answers that.)

use crate::grasp::linalg;
use nalgebra::{Matrix6, Vector6};

/// Impedances of one step, merged. Buffers are kept, so that a warm step allocates nothing.
#[derive(Clone, Debug, Default)]
pub struct MergedHand {
    fingers: Vec<Finger>,
    /// Cholesky factors of the fingers' own `J M_ff^-1 J^T + R`, one after the other.
    factors: Vec<f64>,
    maps: Vec<Vector6<f64>>,
    resistances: Vec<f64>,
    /// Rows of `k G^T`, and of `k G^T K^-1` once finished.
    shares: Vec<Vector6<f64>>,
    base: Base,
    impedance: Matrix6<f64>,
    column: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Finger {
    first: usize,
    rows: usize,
    factor: usize,
}

/// What the fingers have in common: the joints that carry the palm.
#[derive(Clone, Debug, Default)]
struct Base {
    joints: usize,
    /// `B`, rows x joints.
    rows: Vec<f64>,
    /// `k B` of the fingers' own `k`.
    stiff: Vec<f64>,
    /// Cholesky factor of `I + B^T k B`.
    factor: Vec<f64>,
    column: Vec<f64>,
}

impl MergedHand {
    /// Starts anew, for a palm that `base_joints` joints carry.
    pub fn begin(&mut self, base_joints: usize) {
        self.fingers.clear();
        self.factors.clear();
        self.maps.clear();
        self.resistances.clear();
        self.shares.clear();
        self.base.joints = base_joints;
        self.base.rows.clear();
        self.impedance = Matrix6::zeros();
    }

    /// Adds a finger with `n` contact rows: its own `mobility` `J M_ff^-1 J^T` (n x n, row-major; 1/kg, 1/(kg m),
    /// 1/(kg m^2)), its rows of `B` (n x base joints), each row's wrench of a unit force on the target, and each row's
    /// resistance `R > 0`.
    pub fn add_finger(&mut self, mobility: &[f64], base: &[f64], maps: &[Vector6<f64>], resistances: &[f64]) {
        let n = maps.len();
        let (first, factor) = (self.maps.len(), self.factors.len());
        self.fingers.push(Finger { first, rows: n, factor });
        self.maps.extend_from_slice(maps);
        self.resistances.extend_from_slice(resistances);
        self.base.rows.extend_from_slice(base);
        self.factors.extend_from_slice(&mobility[..n * n]);
        let l = &mut self.factors[factor..];
        for (i, r) in resistances.iter().enumerate() {
            l[i * n + i] += r;
        }
        linalg::cholesky(l, n);
    }

    /// Forms `K^-1`; false if the contacts do not resist all six motions of the target.
    #[must_use]
    pub fn finish(&mut self) -> bool {
        self.finish_base();
        self.shares.clear();
        self.shares.resize(self.maps.len(), Vector6::zeros());
        let mut column = std::mem::take(&mut self.column);
        for axis in 0..6 {
            column.clear();
            column.extend(self.maps.iter().map(|g| g[axis]));
            self.stiffen(&mut column);
            for (share, &x) in self.shares.iter_mut().zip(&column) {
                share[axis] = x;
            }
        }
        self.column = column;
        let impedance: Matrix6<f64> = self.maps.iter().zip(&self.shares).map(|(g, kg)| g * kg.transpose()).sum();
        self.impedance = (impedance + impedance.transpose()) * 0.5;
        let Some(factor) = self.impedance.cholesky() else { return false };
        let compliance = factor.inverse();
        for share in &mut self.shares {
            *share = compliance * *share;
        }
        true
    }

    fn finish_base(&mut self) {
        let (p, rows) = (self.base.joints, self.maps.len());
        let Base { rows: b, stiff, factor, column, .. } = &mut self.base;
        stiff.clear();
        stiff.resize(rows * p, 0.0);
        for j in 0..p {
            column.clear();
            column.extend((0..rows).map(|i| b[i * p + j]));
            solve_fingers(&self.fingers, &self.factors, column);
            for (i, x) in column.iter().enumerate() {
                stiff[i * p + j] = *x;
            }
        }
        factor.clear();
        factor.resize(p * p, 0.0);
        for j in 0..p {
            factor[j * p + j] = 1.0;
        }
        for i in 0..rows {
            for j in 0..p {
                linalg::axpy(b[i * p + j], &stiff[i * p..(i + 1) * p], &mut factor[j * p..(j + 1) * p]);
            }
        }
        linalg::cholesky(factor, p);
    }

    /// `x <- k x`.
    fn stiffen(&mut self, x: &mut [f64]) {
        let p = self.base.joints;
        let Base { stiff, factor, column, .. } = &mut self.base;
        column.clear();
        column.resize(p, 0.0);
        if p > 0 {
            for (row, &x) in stiff.chunks_exact(p).zip(x.iter()) {
                linalg::axpy(x, row, column);
            }
            linalg::cholesky_backsolve(factor, p, column);
        }
        solve_fingers(&self.fingers, &self.factors, x);
        if p > 0 {
            for (row, x) in stiff.chunks_exact(p).zip(x.iter_mut()) {
                *x -= linalg::dot(row, column);
            }
        }
    }

    /// `K`, world axes about the point of the maps.
    #[cfg(test)]
    pub fn impedance(&self) -> &Matrix6<f64> {
        &self.impedance
    }

    /// `K^-1 G k` of row `row`: what it adds to the merged part per unit of its own motion, and, transposed, the force
    /// that it carries of a wrench across the grasp.
    pub fn share(&self, row: usize) -> &Vector6<f64> {
        &self.shares[row]
    }

    /// Resistance of row `row`.
    pub fn resistance(&self, row: usize) -> f64 {
        self.resistances[row]
    }

    /// `K^-1 G k x`: motions `x` of the rows as one motion of the merged part.
    pub fn merge(&self, x: &[f64]) -> Vector6<f64> {
        self.shares.iter().zip(x).map(|(share, &x)| share * x).sum()
    }

    /// `G f`: the wrench of row forces on the target.
    #[cfg(test)]
    pub fn wrench(&self, forces: &[f64]) -> Vector6<f64> {
        self.maps.iter().zip(forces).map(|(g, &f)| g * f).sum()
    }

    /// Softness of the contacts as the merged part has it, `K^-1 G k R k G^T K^-1`.
    pub fn softness(&self) -> Matrix6<f64> {
        self.shares.iter().zip(&self.resistances).map(|(share, &r)| share * share.transpose() * r).sum()
    }

    /// The internal, which no row across the grasp can see: `fint = k (G^T K^-1 G k d - d)` for motions `d` that the rows
    /// resist. It acts on the fingers; the contacts' force on the target is its opposite, and sums to no wrench.
    pub fn internal(&mut self, d: &[f64], out: &mut Vec<f64>) {
        let mean = self.merge(d);
        out.clear();
        out.extend(self.maps.iter().zip(d).map(|(g, &d)| g.dot(&mean) - d));
        self.stiffen(out);
    }
}

/// `x <- k x`, each finger for itself.
fn solve_fingers(fingers: &[Finger], factors: &[f64], x: &mut [f64]) {
    for &Finger { first, rows, factor } in fingers {
        linalg::cholesky_backsolve(&factors[factor..factor + rows * rows], rows, &mut x[first..first + rows]);
    }
}

#[cfg(test)]
mod tests {
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
            merged.add_finger(&mobility(seed), &base(seed), &maps(&p, &r), &RESISTANCE);
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
            merged.add_finger(&[0.0; 9], &[], &rows[..3], &[1.0 / k; 3]);
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
        merged.add_finger(&[0.0; 9], &[], &rows[..3], &[0.1; 3]);
        assert!(!merged.finish(), "one hard contact holds three motions of six");
    }
}
