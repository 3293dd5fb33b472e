//! Newton's method with a line search on an [`Arrow`], its branches eliminated one by one.

#![allow(clippy::needless_range_loop)] // small matrices are read by their indices, as in the formulas

use super::{Arrow, Branch, ROOT, RootVector, Status};
use crate::grasp::contact::cost::MAX_ROWS;
use crate::grasp::linalg;
use nalgebra::{SMatrix, SVector};
use pulp::{Arch, Simd, WithSimd};

/// Gradient norm, relative to the largest term in it, below which a point counts as the minimum.
const TOLERANCE: f64 = 1e-6;
/// Newton iterations before giving up. Warm-started steps take one or two; while many contacts begin and cease to slide,
/// one step in some thousands takes 60 to 150. Giving up is dear: one step of unsolved friction puts the target up to
/// millimetres off.
const MAX_ITERATIONS: usize = 1000;
/// Sufficient decrease of the backtracking line search (Armijo).
const ARMIJO: f64 = 1e-4;
/// Halvings of the Newton step before the line search gives up.
const MAX_HALVINGS: usize = 40;

/// What a solve works on besides the contacts' rows.
struct Newton {
    gradient: RootVector,
    step: RootVector,
    hessian: [RootVector; ROOT],
}

/// A Newton step to be compiled for each kind of processor. (A closure would not do: the compiler may call it instead of
/// inlining it, and then it is compiled for the least of them.)
struct NewtonStep<'a> {
    arrow: &'a mut Arrow,
    newton: &'a mut Newton,
}

impl WithSimd for NewtonStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.arrow.newton_step_inline(self.newton);
    }
}

impl Arrow {
    /// Minimises from the start `z` and leaves the solution there.
    ///
    /// The first step takes every contact to be where it is expected on its cone. If it ends there and no contact
    /// slides, that step was the whole solve.
    pub fn solve(&mut self, z: &mut RootVector) -> Status {
        let rows = self.bias.len();
        for buffer in [&mut self.jar, &mut self.slope, &mut self.forces] {
            buffer.resize(rows, 0.0);
        }
        for buffer in [&mut self.own_gradient, &mut self.own_step] {
            buffer.resize(self.own.len(), 0.0);
        }
        self.stiff_rows.resize(self.own_rows.len(), 0.0);
        let mut newton = Newton { gradient: [0.0; ROOT], step: [0.0; ROOT], hessian: [[0.0; ROOT]; ROOT] };
        self.own_from_start();
        self.residuals(z);
        for b in &mut self.blocks {
            let active_set = b.response.active_set;
            b.cost.respond_in(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows], active_set, &mut b.response);
            b.store_force(&mut self.forces);
        }
        self.gradient(z, &mut newton.gradient);
        self.newton_step(&mut newton);
        self.advance(1.0, &newton.step, z);
        if self.respond().1 {
            return Status { iterations: 1, converged: true };
        }
        self.descend(&mut newton, z)
    }

    /// Newton with a line search from where `z` and `w` are.
    fn descend(&mut self, newton: &mut Newton, z: &mut RootVector) -> Status {
        let mut cost = self.respond().0 + self.inertial_cost(z);
        for iterations in 1..MAX_ITERATIONS {
            let scale = self.gradient(z, &mut newton.gradient);
            let size = linalg::norm(&newton.gradient).hypot(linalg::norm(&self.own_gradient));
            if size <= TOLERANCE * scale {
                return Status { iterations, converged: true };
            }
            self.newton_step(newton);
            let decrease =
                linalg::dot(&newton.gradient, &newton.step) + linalg::dot(&self.own_gradient, &self.own_step);
            let slack = 1e-14 * cost.abs();
            let mut length = 1.0;
            let mut accepted = None;
            self.advance(length, &newton.step, z);
            for _ in 0..MAX_HALVINGS {
                let (costs, affine) = self.respond();
                let trial = costs + self.inertial_cost(z);
                if trial <= cost + ARMIJO * length * decrease + slack {
                    accepted = Some((trial, affine && length == 1.0));
                    break;
                }
                length *= 0.5;
                self.advance(-length, &newton.step, z);
            }
            let Some((trial, exact)) = accepted else {
                // no descent left at this precision
                self.advance(-length, &newton.step, z);
                self.respond();
                return Status { iterations, converged: size <= 1e-6 * scale };
            };
            cost = trial;
            if exact {
                return Status { iterations: iterations + 1, converged: true };
            }
        }
        Status { iterations: MAX_ITERATIONS, converged: false }
    }

    /// `jar = bias + Y z + X w`
    fn residuals(&mut self, z: &RootVector) {
        for ((jar, bias), y) in self.jar.iter_mut().zip(&self.bias).zip(&self.root_rows) {
            *jar = bias + linalg::dot(y, z);
        }
        for branch in &self.branches {
            branch.add_own(&self.own_rows, &self.own, &mut self.jar);
        }
    }

    /// Moves `z`, `w` and the residuals along the Newton step.
    fn advance(&mut self, length: f64, step: &RootVector, z: &mut RootVector) {
        linalg::axpy(length, step, z);
        linalg::axpy(length, &self.own_step, &mut self.own);
        linalg::axpy(length, &self.slope, &mut self.jar);
    }

    /// Evaluates every cost; returns the summed cost and whether all active sets are those of before and affine.
    fn respond(&mut self) -> (f64, bool) {
        let (mut cost, mut affine) = (0.0, true);
        for b in &mut self.blocks {
            let before = b.response.active_set;
            b.cost.respond_into(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows], &mut b.response);
            b.store_force(&mut self.forces);
            affine &= b.response.active_set == before && before.is_affine();
            cost += b.response.cost;
        }
        (cost, affine)
    }

    fn inertial_cost(&self, z: &RootVector) -> f64 {
        0.5 * (linalg::dot(z, z) + linalg::dot(&self.own, &self.own))
    }

    /// `z - Y' f` and `w - X' f`; returns the size of the largest terms, against which gradients are judged.
    fn gradient(&mut self, z: &RootVector, gradient: &mut RootVector) -> f64 {
        *gradient = [0.0; ROOT];
        for (y, f) in self.root_rows.iter().zip(&self.forces) {
            linalg::axpy(*f, y, gradient);
        }
        let scale = linalg::norm(gradient).max(linalg::norm(z)).max(f64::MIN_POSITIVE);
        for (g, z) in gradient.iter_mut().zip(z) {
            *g = z - *g;
        }
        self.own_gradient.copy_from_slice(&self.own);
        for branch in &self.branches {
            let gradient = &mut self.own_gradient[branch.own0..branch.own0 + branch.width];
            for i in 0..branch.rows {
                linalg::axpy(-self.forces[branch.row0 + i], branch.own_row(&self.own_rows, i), gradient);
            }
        }
        scale.max(linalg::norm(&self.own))
    }

    /// Solves for the step of root and branches: `H step = -gradient`, with the widest vectors that the processor has.
    /// No operation is contracted or reordered for it: the result is the same on every processor.
    fn newton_step(&mut self, newton: &mut Newton) {
        Arch::new().dispatch(NewtonStep { arrow: self, newton });
    }

    #[inline(always)]
    fn newton_step_inline(&mut self, newton: &mut Newton) {
        newton.hessian = [[0.0; ROOT]; ROOT];
        for i in 0..ROOT {
            newton.hessian[i][i] = 1.0;
            newton.step[i] = -newton.gradient[i];
        }
        for k in 0..self.branches.len() {
            let branch = self.branches[k];
            match (branch.rows, branch.width) {
                // one contact of condim 3 or 4 is what most fingers have
                (3, 3) => self.eliminate_small::<3>(&branch, newton),
                (4, 4) => self.eliminate_small::<4>(&branch, newton),
                _ => self.eliminate(&branch, newton),
            }
        }
        // the root's Hessian is at least the identity: the factor exists
        linalg::cholesky_solve(&mut newton.hessian, &mut newton.step);
        for (slope, y) in self.slope.iter_mut().zip(&self.root_rows) {
            *slope = linalg::dot(y, &newton.step);
        }
        for k in 0..self.branches.len() {
            let branch = self.branches[k];
            self.step_back(&branch);
        }
    }

    /// A branch of as many unknowns as rows, by closed inverses: with `S = I + X' C X` it gives the root the stiffness
    /// `C - C X S^-1 X' C` and the pull `C X S^-1 g`.
    #[inline(always)]
    fn eliminate_small<const M: usize>(&mut self, branch: &Branch, newton: &mut Newton) {
        let mut c = SMatrix::<f64, M, M>::zeros();
        for b in &self.blocks[branch.blocks.0..branch.blocks.1] {
            let (at, first) = (b.row0 - branch.row0, b.first_row());
            for i in first..b.rows {
                for k in first..b.rows {
                    c[(at + i, at + k)] = b.response.hessian[(i - first) * MAX_ROWS + k - first];
                }
            }
        }
        let x = SMatrix::<f64, M, M>::from_row_slice(&self.own_rows[branch.x0..branch.x0 + M * M]);
        let cx = c * x;
        // at least the identity: never singular
        let inverse = (SMatrix::<f64, M, M>::identity() + x.tr_mul(&cx)).try_inverse().unwrap_or_else(SMatrix::zeros);
        let half = cx * inverse;
        let stiffness = c - half * cx.transpose();
        let gradient = SVector::<f64, M>::from_column_slice(&self.own_gradient[branch.own0..branch.own0 + M]);
        let pull = half * gradient;
        // symmetric: columns are rows
        self.factors[branch.square0..branch.square0 + M * M].copy_from_slice(inverse.as_slice());
        self.stiff_rows[branch.x0..branch.x0 + M * M].copy_from_slice(cx.transpose().as_slice());
        let rows = &self.root_rows[branch.row0..branch.row0 + M];
        for i in 0..M {
            let mut coupled = [0.0; ROOT];
            for j in 0..M {
                for k in 0..ROOT {
                    coupled[k] += stiffness[(i, j)] * rows[j][k];
                }
            }
            add_outer(&rows[i], &coupled, &mut newton.hessian);
            linalg::axpy(pull[i], &rows[i], &mut newton.step);
        }
    }

    /// Any branch, by a Cholesky factor of `S`.
    #[inline(always)]
    fn eliminate(&mut self, branch: &Branch, newton: &mut Newton) {
        let (m, n) = (branch.rows, branch.width);
        let stiff_rows = &mut self.stiff_rows[branch.x0..branch.x0 + m * n];
        stiff_rows.fill(0.0);
        for b in &self.blocks[branch.blocks.0..branch.blocks.1] {
            let first = b.first_row();
            for i in first..b.rows {
                let row = b.row0 + i;
                let mut coupled = [0.0; ROOT];
                for k in first..b.rows {
                    let c = b.response.hessian[(i - first) * MAX_ROWS + k - first];
                    if c != 0.0 {
                        linalg::axpy(c, &self.root_rows[b.row0 + k], &mut coupled);
                        let at = row - branch.row0;
                        let x = branch.own_row(&self.own_rows, b.row0 + k - branch.row0);
                        linalg::axpy(c, x, &mut stiff_rows[at * n..(at + 1) * n]);
                    }
                }
                add_outer(&self.root_rows[row], &coupled, &mut newton.hessian);
            }
        }
        if n == 0 {
            return;
        }
        let factor = &mut self.factors[branch.square0..branch.square0 + n * n];
        factor.fill(0.0);
        for i in 0..m {
            let (x, stiff) = (branch.own_row(&self.own_rows, i), &stiff_rows[i * n..(i + 1) * n]);
            for (j, x) in x.iter().enumerate() {
                linalg::axpy(*x, &stiff[..=j], &mut factor[j * n..j * n + j + 1]);
            }
        }
        for j in 0..n {
            factor[j * n + j] += 1.0;
        }
        linalg::cholesky(factor, n);
        // K = L^-1 X' C Y and L^-1 g: the root's Hessian loses K'K, its right-hand side gains K' L^-1 g
        self.scratch.clear();
        self.scratch.resize(n * (ROOT + 1), 0.0);
        let (coupling, gradient) = self.scratch.split_at_mut(n * ROOT);
        for i in 0..m {
            for (j, stiff) in stiff_rows[i * n..(i + 1) * n].iter().enumerate() {
                linalg::axpy(*stiff, &self.root_rows[branch.row0 + i], &mut coupling[j * ROOT..(j + 1) * ROOT]);
            }
        }
        gradient.copy_from_slice(&self.own_gradient[branch.own0..branch.own0 + n]);
        for j in 0..n {
            let row = &factor[j * n..j * n + j];
            let inverse = 1.0 / factor[j * n + j];
            let (done, rest) = coupling.split_at_mut(j * ROOT);
            let k: &mut [f64] = &mut rest[..ROOT];
            for (l, above) in row.iter().zip(done.chunks_exact(ROOT)) {
                linalg::axpy(-l, above, k);
            }
            k.iter_mut().for_each(|k| *k *= inverse);
            gradient[j] = (gradient[j] - linalg::dot(row, &gradient[..j])) * inverse;
            let mut negative = [0.0; ROOT];
            for (negative, k) in negative.iter_mut().zip(&*k) {
                *negative = -k;
            }
            let mut row = [0.0; ROOT];
            row.copy_from_slice(k);
            add_outer(&row, &negative, &mut newton.hessian);
            linalg::axpy(gradient[j], &row, &mut newton.step);
        }
    }

    /// The branch's own step `-S^-1 (g + X' C Y dz)`, `Y dz` being in `slope`, and its share of the slope.
    #[inline(always)]
    fn step_back(&mut self, branch: &Branch) {
        let n = branch.width;
        if n == 0 {
            return;
        }
        let own = branch.own0..branch.own0 + n;
        let factor = &self.factors[branch.square0..branch.square0 + n * n];
        let step = &mut self.own_step[own.clone()];
        for (step, gradient) in step.iter_mut().zip(&self.own_gradient[own]) {
            *step = -gradient;
        }
        for i in 0..branch.rows {
            linalg::axpy(-self.slope[branch.row0 + i], branch.own_row(&self.stiff_rows, i), step);
        }
        if branch.rows == n && (n == 3 || n == 4) {
            let mut right = [0.0; 4];
            right[..n].copy_from_slice(step);
            for (step, row) in step.iter_mut().zip(factor.chunks_exact(n)) {
                *step = linalg::dot(row, &right[..n]);
            }
        } else {
            linalg::cholesky_backsolve(factor, n, step);
        }
        branch.add_own(&self.own_rows, &self.own_step, &mut self.slope);
    }
}

/// `H += a b'`, lower triangle (and what of the upper one costs nothing).
#[inline(always)]
fn add_outer(a: &RootVector, b: &RootVector, hessian: &mut [RootVector; ROOT]) {
    for k in 0..ROOT / 2 {
        for j in 0..ROOT / 2 {
            hessian[k][j] += a[k] * b[j];
        }
    }
    for k in ROOT / 2..ROOT {
        for j in 0..ROOT {
            hessian[k][j] += a[k] * b[j];
        }
    }
}
