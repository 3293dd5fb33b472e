//! The thesis's quality in the hot loop: `G G'` gathered contact by contact, without allocating.

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::grasp::monitor::wrench::{LoadedContact, contact_radius, inverse};

/// Singular values below this fraction of the largest are rounding: `G G'`, whose eigenvalues are their squares, cannot
/// tell them from zero.
pub const RANK_TOLERANCE: f64 = 1e-7;
/// The same for eigenvalues.
const RANK_FLOOR: f64 = RANK_TOLERANCE * RANK_TOLERANCE;

/// `G G'` of a grasp, G as `metrics::quality` defines it \[N\].
///
/// Its eigenvalues are the squares of G's singular values, so values below [`RANK_TOLERANCE`] of the largest are lost in
/// rounding and count as 0. Nothing is checked here: a number that is not finite gives Q = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gram {
    /// Force-force, torque-force and torque-torque blocks.
    ff: Matrix3<f64>,
    tf: Matrix3<f64>,
    tt: Matrix3<f64>,
    com: Vector3<f64>,
    per_length: f64,
}

impl Gram {
    /// An empty grasp of a target with its centre of mass at `com` (world, m); torques will be divided by `length`
    /// \[m\], see [`contact_radius`]. With a length of 0 torques do not count and Q is 0.
    pub fn new(com: Vector3<f64>, length: f64) -> Self {
        Gram { ff: Matrix3::zeros(), tf: Matrix3::zeros(), tt: Matrix3::zeros(), com, per_length: inverse(length) }
    }

    /// The grasp by `contacts`, its length their [`contact_radius`].
    pub fn of(contacts: &[LoadedContact], com: &Vector3<f64>) -> Self {
        let mut gram = Gram::new(*com, contact_radius(contacts));
        for contact in contacts {
            gram.add(contact);
        }
        gram
    }

    /// Adds a contact's basis forces.
    pub fn add(&mut self, contact: &LoadedContact) {
        let [n, t1, t2] = [&contact.normal, &contact.tangents[0], &contact.tangents[1]];
        let push = contact.normal_force * contact.normal_force;
        // Both members of a symmetric pair: twice the square.
        let pair = |row: usize| 2.0 * push * contact.friction[row] * contact.friction[row];
        let mut forces = outer(n, push);
        if contact.condim >= 3 {
            forces += outer(t1, pair(0)) + outer(t2, pair(1));
        }
        // A force F has the torque S F, S = [r]x / length.
        let s = ((contact.position - self.com) * self.per_length).cross_matrix();
        let torques = s * forces;
        self.ff += forces;
        self.tf += torques;
        self.tt += torques * s.transpose();
        let couples = self.per_length * self.per_length;
        if contact.condim >= 4 {
            self.tt += outer(n, pair(2) * couples);
        }
        if contact.condim >= 6 {
            self.tt += outer(t1, pair(3) * couples) + outer(t2, pair(4) * couples);
        }
    }

    /// `G G'` \[N^2\].
    pub fn matrix(&self) -> Matrix6<f64> {
        let mut matrix = Matrix6::zeros();
        matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.ff);
        matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&self.tf);
        matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(&self.tf.transpose());
        matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.tt);
        matrix
    }

    /// Q \[N\].
    pub fn min_singular_value(&self) -> f64 {
        let Some(values) = eigenvalues(&self.rows()) else {
            return 0.0;
        };
        let largest = values.iter().copied().fold(0.0, f64::max);
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        if least > RANK_FLOOR * largest { least.sqrt() } else { 0.0 }
    }

    /// Whether Q > `quality` \[N\], by one Cholesky factorisation of `G G' - quality^2 I`: for the test against a
    /// threshold in every step. A negative `quality` is always exceeded.
    pub fn exceeds(&self, quality: f64) -> bool {
        if quality.is_nan() || quality < 0.0 {
            return quality < 0.0;
        }
        let floor = RANK_FLOOR * (self.ff.trace() + self.tt.trace());
        let shift = (quality * quality).max(floor);
        let mut l = self.rows();
        for j in 0..6 {
            let mut pivot = l[j][j] - shift;
            for known in &l[j][..j] {
                pivot -= known * known;
            }
            // Not `pivot <= 0`: a NaN must fail.
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            let scale = pivot.sqrt().recip();
            for i in j + 1..6 {
                let mut entry = l[i][j];
                for (a, b) in l[i][..j].iter().zip(&l[j][..j]) {
                    entry -= a * b;
                }
                l[i][j] = entry * scale;
            }
        }
        true
    }

    /// `G G'` row by row; above the diagonal only the blocks' own upper triangles are filled, nobody reads there.
    fn rows(&self) -> [[f64; 6]; 6] {
        let mut rows = [[0.0; 6]; 6];
        for i in 0..3 {
            for j in 0..3 {
                rows[i][j] = self.ff[(i, j)];
                rows[3 + i][j] = self.tf[(i, j)];
                rows[3 + i][3 + j] = self.tt[(i, j)];
            }
        }
        rows
    }
}

/// `weight v v'`.
fn outer(v: &Vector3<f64>, weight: f64) -> Matrix3<f64> {
    v * (v * weight).transpose()
}

/// Eigenvalues of a symmetric matrix, of which the lower triangle is read, in no order; None if it is not finite.
/// Cyclic Jacobi rotations: no allocation, always an end, and small eigenvalues of definite matrices stay accurate.
fn eigenvalues(lower: &[[f64; 6]; 6]) -> Option<[f64; 6]> {
    let mut a = *lower;
    let size: f64 = a.iter().enumerate().flat_map(|(i, row)| &row[..=i]).map(|x| x.abs()).sum();
    if !size.is_finite() {
        return None;
    }
    // An entry this small moves no eigenvalue above the floor by more than rounding does.
    let negligible = 1e-17 * size;
    // Convergence is quadratic: five or six sweeps do, twenty are a safe end.
    for _ in 0..20 {
        let mut done = true;
        for p in 1..6 {
            for q in 0..p {
                if a[p][q].abs() > negligible {
                    done = false;
                    rotate(&mut a, p, q);
                }
            }
        }
        if done {
            break;
        }
    }
    Some(std::array::from_fn(|k| a[k][k]))
}

/// The Jacobi rotation that makes `a[p][q]`, p > q, zero.
#[inline]
fn rotate(a: &mut [[f64; 6]; 6], p: usize, q: usize) {
    let off = a[p][q];
    let theta = (a[q][q] - a[p][p]) / (2.0 * off);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = (t * t + 1.0).sqrt().recip();
    let s = t * c;
    a[p][p] -= t * off;
    a[q][q] += t * off;
    a[p][q] = 0.0;
    for k in 0..6 {
        if k == p || k == q {
            continue;
        }
        let (pi, pj) = if k < p { (p, k) } else { (k, p) };
        let (qi, qj) = if k < q { (q, k) } else { (k, q) };
        let (x, y) = (a[pi][pj], a[qi][qj]);
        a[pi][pj] = c * x - s * y;
        a[qi][qj] = s * x + c * y;
    }
}
