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
    /// Numbers of the rows that move with joints, finger by finger.
    coupled: Vec<usize>,
    maps: Vec<Vector6<f64>>,
    resistances: Vec<f64>,
    /// Rows of `k G^T`, and of `k G^T K^-1` once finished.
    shares: Vec<Vector6<f64>>,
    base: Base,
    impedance: Matrix6<f64>,
    /// `k` of the finger of some right-hand sides, side by side.
    columns: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Finger {
    /// First of its coupled rows, and their number.
    first: usize,
    rows: usize,
    factor: usize,
}

/// What the fingers have in common: the joints that carry the palm.
#[derive(Clone, Debug, Default)]
struct Base {
    joints: usize,
    /// `B`, coupled rows x joints.
    rows: Vec<f64>,
    /// `k B` of the fingers' own `k`.
    stiff: Vec<f64>,
    /// Cholesky factor of `I + B^T k B`.
    factor: Vec<f64>,
    /// `(I + B^T k B)^-1 B^T k G^T`, joints x 6.
    coupling: Vec<f64>,
    column: Vec<f64>,
}

impl MergedHand {
    /// Starts anew, for a palm that `base_joints` joints carry.
    pub fn begin(&mut self, base_joints: usize) {
        self.fingers.clear();
        self.factors.clear();
        self.coupled.clear();
        self.maps.clear();
        self.resistances.clear();
        self.shares.clear();
        self.base.joints = base_joints;
        self.base.rows.clear();
        self.impedance = Matrix6::zeros();
    }

    /// Adds the rows of a finger's contacts: each row's wrench of a unit force on the target, and its resistance `R > 0`.
    /// Of the rows `coupled`, which move with joints, the finger's own `mobility` `J M_ff^-1 J^T` (n x n, row-major; 1/kg,
    /// 1/(kg m), 1/(kg m^2)) and the rows of `B` (n x base joints).
    pub fn add_finger(
        &mut self,
        mobility: &[f64],
        base: &[f64],
        maps: &[Vector6<f64>],
        resistances: &[f64],
        coupled: impl Iterator<Item = usize>,
    ) {
        let (first, factor, row) = (self.coupled.len(), self.factors.len(), self.maps.len());
        self.maps.extend_from_slice(maps);
        self.resistances.extend_from_slice(resistances);
        self.coupled.extend(coupled.map(|i| row + i));
        let n = self.coupled.len() - first;
        self.fingers.push(Finger { first, rows: n, factor });
        self.base.rows.extend_from_slice(base);
        self.factors.extend_from_slice(&mobility[..n * n]);
        let l = &mut self.factors[factor..];
        for (i, &row) in self.coupled[first..].iter().enumerate() {
            l[i * n + i] += self.resistances[row];
        }
        linalg::cholesky(l, n);
    }

    /// Forms `K^-1`; false if the contacts do not resist all six motions of the target.
    #[must_use]
    pub fn finish(&mut self) -> bool {
        self.shares.clear();
        self.shares.extend(self.maps.iter().zip(&self.resistances).map(|(g, r)| g / *r));
        self.stiffen_fingers();
        self.stiffen_base();
        let impedance: Matrix6<f64> = self.maps.iter().zip(&self.shares).map(|(g, kg)| g * kg.transpose()).sum();
        self.impedance = (impedance + impedance.transpose()) * 0.5;
        let Some(factor) = self.impedance.cholesky() else { return false };
        let compliance = factor.inverse();
        for share in &mut self.shares {
            *share = compliance * *share;
        }
        true
    }

    /// `k G^T` and `k B` with the palm held.
    fn stiffen_fingers(&mut self) {
        let p = self.base.joints;
        let width = 6 + p;
        self.base.stiff.clear();
        for &Finger { first, rows, factor } in &self.fingers {
            self.columns.clear();
            for i in first..first + rows {
                self.columns.extend_from_slice(self.maps[self.coupled[i]].as_slice());
                self.columns.extend_from_slice(&self.base.rows[i * p..(i + 1) * p]);
            }
            solve_rows(&self.factors[factor..factor + rows * rows], rows, &mut self.columns, width);
            for (line, &row) in self.columns.chunks_exact(width).zip(&self.coupled[first..]) {
                self.shares[row].copy_from_slice(&line[..6]);
                self.base.stiff.extend_from_slice(&line[6..]);
            }
        }
    }

    /// Lets the palm go: `k G^T` of all.
    fn stiffen_base(&mut self) {
        let p = self.base.joints;
        if p == 0 {
            return;
        }
        let Base { rows, stiff, factor, coupling, .. } = &mut self.base;
        factor.clear();
        factor.resize(p * p, 0.0);
        coupling.clear();
        coupling.resize(6 * p, 0.0);
        for j in 0..p {
            factor[j * p + j] = 1.0;
        }
        for ((b, kb), &row) in rows.chunks_exact(p).zip(stiff.chunks_exact(p)).zip(&self.coupled) {
            for (j, b) in b.iter().enumerate() {
                linalg::axpy(*b, &kb[..=j], &mut factor[j * p..=j * p + j]);
                linalg::axpy(*b, self.shares[row].as_slice(), &mut coupling[6 * j..6 * j + 6]);
            }
        }
        linalg::cholesky(factor, p);
        solve_rows(factor, p, coupling, 6);
        for (kb, &row) in stiff.chunks_exact(p).zip(&self.coupled) {
            for (kb, coupling) in kb.iter().zip(coupling.chunks_exact(6)) {
                linalg::axpy(-kb, coupling, self.shares[row].as_mut_slice());
            }
        }
    }

    /// `x <- k x`.
    fn stiffen(&mut self, x: &mut [f64]) {
        let p = self.base.joints;
        self.columns.clear();
        self.columns.extend(self.coupled.iter().map(|&row| x[row]));
        for &Finger { first, rows, factor } in &self.fingers {
            let own = &mut self.columns[first..first + rows];
            linalg::cholesky_backsolve(&self.factors[factor..factor + rows * rows], rows, own);
        }
        for (x, r) in x.iter_mut().zip(&self.resistances) {
            *x /= r;
        }
        let Base { rows, factor, stiff, column, .. } = &mut self.base;
        column.clear();
        column.resize(p, 0.0);
        if p > 0 {
            for (b, kx) in rows.chunks_exact(p).zip(&self.columns) {
                linalg::axpy(*kx, b, column);
            }
            linalg::cholesky_backsolve(factor, p, column);
        }
        for (i, (&row, kx)) in self.coupled.iter().zip(&self.columns).enumerate() {
            x[row] = kx - linalg::dot(&stiff[i * p..(i + 1) * p], column);
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

/// Solves `L L' X = B` in place, `X` of n rows of `width` numbers.
fn solve_rows(l: &[f64], n: usize, x: &mut [f64], width: usize) {
    for i in 0..n {
        let (known, own) = x.split_at_mut(i * width);
        let own = &mut own[..width];
        for (j, known) in known.chunks_exact(width).enumerate() {
            linalg::axpy(-l[i * n + j], known, own);
        }
        own.iter_mut().for_each(|x| *x /= l[i * n + i]);
    }
    for i in (0..n).rev() {
        let (others, own) = x.split_at_mut(i * width);
        let own = &mut own[..width];
        own.iter_mut().for_each(|x| *x /= l[i * n + i]);
        for (j, other) in others.chunks_exact_mut(width).enumerate() {
            linalg::axpy(-l[i * n + j], own, other);
        }
    }
}

#[cfg(test)]
mod tests;
