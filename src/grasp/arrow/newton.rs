//! Newton's method with a line search on an [`Arrow`], the fingers eliminated one by one.

#![allow(clippy::needless_range_loop)] // small matrices are read by their indices, as in the formulas

use super::super::cone::MAX_ROWS;
use super::super::dense;
use super::{Arrow, Branch, ROOT, RootVector, Status, add_mobility};
use nalgebra::{SMatrix, SVector};
use pulp::Arch;

/// Gradient norm, relative to the largest term in it, below which a point counts as the minimum.
const TOLERANCE: f64 = 1e-7;
/// Newton iterations before giving up; warm-started steps take one or two.
const MAX_ITERATIONS: usize = 60;
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

impl Arrow {
    /// Minimises from the start `z` and leaves the solution there.
    ///
    /// The first step takes every contact to be where it is expected on its cone. If it ends there and no contact
    /// slides, that step was the whole solve.
    pub fn solve(&mut self, z: &mut RootVector) -> Status {
        let rows = self.bias.len();
        for buffer in [&mut self.jar, &mut self.slope, &mut self.force_step, &mut self.pull, &mut self.law_forces] {
            buffer.resize(rows, 0.0);
        }
        self.stiffness.resize(self.mobility.len(), 0.0);
        let mut newton = Newton { gradient: [0.0; ROOT], step: [0.0; ROOT], hessian: [[0.0; ROOT]; ROOT] };
        self.residuals(z);
        for b in &mut self.blocks {
            let zone = b.response.zone;
            b.law.respond_in(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows], zone, &mut b.response);
            b.store_force(&mut self.law_forces);
        }
        self.gradient(z, &mut newton.gradient);
        self.newton_step(&mut newton);
        self.advance(1.0, &newton.step, z);
        if self.respond().1 {
            return Status { iterations: 1, converged: true };
        }
        self.descend(&mut newton, z)
    }

    /// Newton with a line search from where `z` and `lambda` are.
    fn descend(&mut self, newton: &mut Newton, z: &mut RootVector) -> Status {
        let mut cost = self.respond().0 + self.inertial_cost(z);
        for iterations in 1..MAX_ITERATIONS {
            let scale = self.gradient(z, &mut newton.gradient);
            let size = self.gradient_norm(&newton.gradient);
            if size <= TOLERANCE * scale {
                return Status { iterations, converged: true };
            }
            self.newton_step(newton);
            let decrease = self.directional_derivative(newton);
            let slack = 1e-14 * cost.abs();
            let mut length = 1.0;
            let mut accepted = None;
            self.advance(length, &newton.step, z);
            for _ in 0..MAX_HALVINGS {
                let (laws, affine) = self.respond();
                let trial = laws + self.inertial_cost(z);
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

    /// `jar = bias + Y z + W lambda`
    fn residuals(&mut self, z: &RootVector) {
        for ((jar, bias), y) in self.jar.iter_mut().zip(&self.bias).zip(&self.root_rows) {
            *jar = bias + dense::dot(y, z);
        }
        for branch in &self.branches {
            add_mobility(branch, &self.mobility, &self.forces, &mut self.jar);
        }
    }

    /// Moves `z`, `lambda` and the residuals along the Newton step.
    fn advance(&mut self, length: f64, step: &RootVector, z: &mut RootVector) {
        dense::axpy(length, step, z);
        dense::axpy(length, &self.force_step, &mut self.forces);
        dense::axpy(length, &self.slope, &mut self.jar);
    }

    /// Evaluates every law; returns the summed cost and whether all zones are those of before and affine.
    fn respond(&mut self) -> (f64, bool) {
        let (mut cost, mut affine) = (0.0, true);
        for b in &mut self.blocks {
            let before = b.response.zone;
            b.law.respond_into(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows], &mut b.response);
            b.store_force(&mut self.law_forces);
            affine &= b.response.zone == before && before.is_affine();
            cost += b.response.cost;
        }
        (cost, affine)
    }

    fn inertial_cost(&self, z: &RootVector) -> f64 {
        let mut cost = dense::dot(z, z);
        for branch in self.branches.iter().filter(|b| b.moves) {
            let forces = &self.forces[branch.row0..branch.row0 + branch.rows];
            for (i, f) in forces.iter().enumerate() {
                cost += f * dense::dot(branch.row(&self.mobility, i), forces);
            }
        }
        0.5 * cost
    }

    /// The root's gradient; returns the size of its largest terms, against which gradients are judged.
    fn gradient(&self, z: &RootVector, gradient: &mut RootVector) -> f64 {
        *gradient = [0.0; ROOT];
        for (y, f) in self.root_rows.iter().zip(&self.law_forces) {
            dense::axpy(*f, y, gradient);
        }
        let scale = dense::norm(gradient).max(dense::norm(z)).max(f64::MIN_POSITIVE);
        for (g, z) in gradient.iter_mut().zip(z) {
            *g = z - *g;
        }
        scale
    }

    /// Norm of the whole gradient: the root's, and `W^1/2 (lambda - f)` of each finger.
    fn gradient_norm(&self, root: &RootVector) -> f64 {
        let mut square = dense::dot(root, root);
        for branch in self.branches.iter().filter(|b| b.moves) {
            for i in 0..branch.rows {
                let moved: f64 = (0..branch.rows)
                    .map(|j| branch.row(&self.mobility, i)[j] * self.disagreement(branch.row0 + j))
                    .sum();
                square += self.disagreement(branch.row0 + i) * moved;
            }
        }
        square.max(0.0).sqrt()
    }

    /// `lambda - f` of a row.
    fn disagreement(&self, row: usize) -> f64 {
        self.forces[row] - self.law_forces[row]
    }

    fn directional_derivative(&self, newton: &Newton) -> f64 {
        let mut sum = dense::dot(&newton.gradient, &newton.step);
        for branch in self.branches.iter().filter(|b| b.moves) {
            for i in 0..branch.rows {
                let row = branch.row(&self.mobility, i);
                let steps = &self.force_step[branch.row0..branch.row0 + branch.rows];
                sum += self.disagreement(branch.row0 + i) * dense::dot(row, steps);
            }
        }
        sum
    }

    /// Solves for the step of root and fingers: `H step = -gradient`, with the widest vectors that the processor has.
    /// No operation is contracted or reordered for it: the result is the same on every processor.
    fn newton_step(&mut self, newton: &mut Newton) {
        Arch::new().dispatch(
            #[inline(always)]
            || self.newton_step_inline(newton),
        );
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
            self.eliminate(&branch);
            self.add_to_root(&branch, newton);
        }
        // the root's Hessian is at least the identity: the factor exists
        dense::cholesky_solve(&mut newton.hessian, &mut newton.step);
        for (slope, y) in self.slope.iter_mut().zip(&self.root_rows) {
            *slope = dense::dot(y, &newton.step);
        }
        for branch in &self.branches {
            let rows = branch.row0..branch.row0 + branch.rows;
            if branch.moves {
                for i in 0..branch.rows {
                    let stiffness = branch.row(&self.stiffness, i);
                    self.force_step[branch.row0 + i] =
                        self.pull[branch.row0 + i] - dense::dot(stiffness, &self.slope[rows.clone()]);
                }
                add_mobility(branch, &self.mobility, &self.force_step, &mut self.slope);
            } else {
                self.force_step[rows].fill(0.0);
            }
        }
    }

    /// One finger's `E (f - lambda)` and `E C`, `E = (I + C W)^-1` (without joints `E` is the identity).
    #[inline(always)]
    fn eliminate(&mut self, branch: &Branch) {
        let m = branch.rows;
        let stiffness = &mut self.stiffness[branch.square0..branch.square0 + m * m];
        let pull = &mut self.pull[branch.row0..branch.row0 + m];
        stiffness.fill(0.0);
        for b in &self.blocks[branch.blocks.0..branch.blocks.1] {
            let (at, first) = (b.row0 - branch.row0, b.first_row());
            for i in first..b.rows {
                for k in first..b.rows {
                    stiffness[(at + i) * m + at + k] = b.response.hessian[(i - first) * MAX_ROWS + k - first];
                }
            }
        }
        if !branch.moves {
            return;
        }
        for (i, pull) in pull.iter_mut().enumerate() {
            *pull = self.law_forces[branch.row0 + i] - self.forces[branch.row0 + i];
        }
        let mobility = &self.mobility[branch.square0..branch.square0 + m * m];
        // one contact of condim 3 or 4 is what most fingers have
        match m {
            3 => eliminate_small::<3>(mobility, pull, stiffness),
            4 => eliminate_small::<4>(mobility, pull, stiffness),
            _ => eliminate_any(mobility, pull, stiffness, &mut self.scratch),
        }
    }

    /// `H += Y' E C Y` and the finger's share of the right-hand side, `Y' E (f - lambda)` less what the root's gradient
    /// already has of it. Only the lower triangle of `H` is kept.
    #[inline(always)]
    fn add_to_root(&self, branch: &Branch, newton: &mut Newton) {
        let rows = &self.root_rows[branch.row0..branch.row0 + branch.rows];
        for (i, y) in rows.iter().enumerate() {
            let mut coupled = [0.0; ROOT];
            for (c, other) in branch.row(&self.stiffness, i).iter().zip(rows) {
                for k in 0..ROOT {
                    coupled[k] += c * other[k];
                }
            }
            for k in 0..ROOT / 2 {
                for j in 0..ROOT / 2 {
                    newton.hessian[k][j] += y[k] * coupled[j];
                }
            }
            for k in ROOT / 2..ROOT {
                for j in 0..ROOT {
                    newton.hessian[k][j] += y[k] * coupled[j];
                }
            }
            if branch.moves {
                let row = branch.row0 + i;
                let pull = self.pull[row] + self.disagreement(row);
                for k in 0..ROOT {
                    newton.step[k] += pull * y[k];
                }
            }
        }
    }
}

/// `pull <- E pull`, `stiffness <- E C` with `E = (I + C W)^-1`, for as many rows as there are closed inverses for.
#[inline(always)]
fn eliminate_small<const M: usize>(mobility: &[f64], pull: &mut [f64], stiffness: &mut [f64]) {
    let c = SMatrix::<f64, M, M>::from_row_slice(stiffness);
    let w = SMatrix::<f64, M, M>::from_row_slice(mobility);
    let a = SMatrix::<f64, M, M>::identity() + c * w;
    // the eigenvalues of C W are those of a positive semidefinite matrix: A is never singular
    let e = a.try_inverse().unwrap_or_else(SMatrix::identity);
    let pulled = e * SVector::<f64, M>::from_column_slice(pull);
    pull.copy_from_slice(pulled.as_slice());
    // symmetric: columns are rows
    stiffness.copy_from_slice((e * c).as_slice());
}

/// As [`eliminate_small`], for any number of rows.
fn eliminate_any(mobility: &[f64], pull: &mut [f64], stiffness: &mut [f64], scratch: &mut Vec<f64>) {
    let m = pull.len();
    scratch.clear();
    scratch.resize(m * m, 0.0);
    for i in 0..m {
        let row = &mut scratch[i * m..(i + 1) * m];
        for k in 0..m {
            let c = stiffness[i * m + k];
            if c != 0.0 {
                dense::axpy(c, &mobility[k * m..(k + 1) * m], row);
            }
        }
        row[i] += 1.0;
    }
    dense::lu_solve(scratch, m, pull, stiffness);
}
