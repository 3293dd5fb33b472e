//! Newton's method with a line search on an [`Arrow`], its branches eliminated one by one.

#![allow(clippy::needless_range_loop)] // small matrices are read by their indices, as in the formulas

use super::{Arrow, Branch, ROOT, RootVector, Status, unrolled};
use crate::grasp::contact::cost::MAX_ROWS;
use crate::grasp::linalg::{self, LANES, axpy_lanes, dot_lanes};
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

/// A solve to be compiled for each kind of processor, with the widest vectors that it has. No operation is contracted or
/// reordered for it: the result is the same on every processor. (A closure would not do: the compiler may call it instead
/// of inlining it, and then it is compiled for the least of them.)
struct Solve<'a> {
    arrow: &'a mut Arrow,
    z: &'a mut RootVector,
}

impl WithSimd for Solve<'_> {
    type Output = Status;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Status {
        self.arrow.minimise(self.z)
    }
}

/// Lower triangle of the root's Hessian; what stands above it means nothing.
type RootHessian = [RootVector; ROOT];

impl Arrow {
    /// Minimises from the start `z` and leaves the solution there.
    ///
    /// The first step takes every contact to be where it is expected on its cone. If it ends there and no contact
    /// slides, that step was the whole solve.
    pub fn solve(&mut self, z: &mut RootVector) -> Status {
        let (rows, local) = (self.bias.len(), self.point.len());
        for buffer in [&mut self.jar, &mut self.slope, &mut self.forces] {
            buffer.resize(rows, 0.0);
        }
        for buffer in [&mut self.gradient, &mut self.step] {
            buffer.resize(local, 0.0);
        }
        let square = self.branches.last().map_or(0, |b| b.square + b.width * b.stride);
        self.square.resize(square, 0.0);
        Arch::new().dispatch(Solve { arrow: self, z })
    }

    #[inline(always)]
    fn minimise(&mut self, z: &mut RootVector) -> Status {
        self.point_from_start();
        self.set_root(z);
        self.residuals();
        for b in &mut self.blocks[..self.used] {
            let active_set = b.response.active_set;
            b.cost.respond_in(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows], active_set, &mut b.response);
            b.store_force(&mut self.forces);
        }
        let (mut gradient, _) = self.gradient(z);
        let mut step = self.newton_step(&gradient);
        self.advance(1.0, &step, z);
        let (costs, affine) = self.respond();
        if affine {
            return Status { iterations: 1, converged: true };
        }
        // Newton with a line search
        let mut cost = costs + self.inertial_cost(z);
        for iterations in 1..MAX_ITERATIONS {
            let scale;
            (gradient, scale) = self.gradient(z);
            let size = self.sum(&gradient, &gradient, |branch, arrow| {
                let own = branch.own(&arrow.gradient);
                linalg::dot(own, own)
            });
            let size = size.sqrt();
            if size <= TOLERANCE * scale {
                return Status { iterations, converged: true };
            }
            step = self.newton_step(&gradient);
            let decrease = self.sum(&gradient, &step, |branch, arrow| {
                linalg::dot(branch.own(&arrow.gradient), branch.own(&arrow.step))
            });
            let slack = 1e-14 * cost.abs();
            let mut length = 1.0;
            let mut accepted = None;
            self.advance(length, &step, z);
            for _ in 0..MAX_HALVINGS {
                let (costs, affine) = self.respond();
                let trial = costs + self.inertial_cost(z);
                if trial <= cost + ARMIJO * length * decrease + slack {
                    accepted = Some((trial, affine && length == 1.0));
                    break;
                }
                length *= 0.5;
                self.advance(-length, &step, z);
            }
            let Some((trial, exact)) = accepted else {
                // no descent left at this precision
                self.advance(-length, &step, z);
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

    /// A product over all unknowns: of the root's `a` and `b`, and what `own` says of each branch.
    #[inline(always)]
    fn sum(&self, a: &RootVector, b: &RootVector, own: impl Fn(&Branch, &Self) -> f64) -> f64 {
        dot_lanes(a, b) + self.branches.iter().map(|branch| own(branch, self)).sum::<f64>()
    }

    /// `jar = bias + Y z + X w`
    #[inline(always)]
    fn residuals(&mut self) {
        for &branch in &self.branches {
            let (jar, bias) = (&mut self.jar[branch.row0..], &self.bias[branch.row0..]);
            unrolled!(branch => branch.apply(&self.matrix, &self.point, |i, moved| jar[i] = bias[i] + moved));
        }
    }

    /// Moves `z`, `w` and the residuals along the Newton step.
    #[inline(always)]
    fn advance(&mut self, length: f64, step: &RootVector, z: &mut RootVector) {
        axpy_lanes(length, step, z);
        axpy_lanes(length, &self.step, &mut self.point);
        linalg::axpy(length, &self.slope, &mut self.jar);
    }

    /// Evaluates every cost; returns the summed cost and whether all active sets are those of before and affine.
    #[inline(always)]
    fn respond(&mut self) -> (f64, bool) {
        let (mut cost, mut affine) = (0.0, true);
        for b in &mut self.blocks[..self.used] {
            let before = b.response.active_set;
            b.cost.respond_into(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows], &mut b.response);
            b.store_force(&mut self.forces);
            affine &= b.response.active_set == before && before.is_affine();
            cost += b.response.cost;
        }
        (cost, affine)
    }

    #[inline(always)]
    fn inertial_cost(&self, z: &RootVector) -> f64 {
        0.5 * self.sum(z, z, |branch, arrow| {
            let own = branch.own(&arrow.point);
            linalg::dot(own, own)
        })
    }

    /// `z - Y' f`, and `w - X' f` in the branches; and the size of the largest terms, against which gradients are judged.
    #[inline(always)]
    fn gradient(&mut self, z: &RootVector) -> (RootVector, f64) {
        let mut gradient = [0.0; ROOT];
        let mut own = 0.0f64;
        for k in 0..self.branches.len() {
            let branch = self.branches[k];
            let point = branch.own(&self.point);
            own += linalg::dot(point, point);
            unrolled!(branch => self.gradient_of(&branch));
            axpy_lanes(1.0, &self.gradient[branch.local..branch.local + ROOT], &mut gradient);
        }
        let scale = linalg::norm(&gradient).max(linalg::norm(z)).max(own.sqrt()).max(f64::MIN_POSITIVE);
        axpy_lanes(1.0, z, &mut gradient);
        (gradient, scale)
    }

    #[inline(always)]
    fn gradient_of(&mut self, branch: &Branch) {
        let local = &mut self.gradient[branch.local..branch.local + branch.stride];
        local[..ROOT].fill(0.0);
        local[ROOT..].copy_from_slice(&self.point[branch.local + ROOT..branch.local + branch.stride]);
        for (row, f) in branch.rows(&self.matrix).zip(&self.forces[branch.row0..]) {
            if *f != 0.0 {
                axpy_lanes(-f, row, local);
            }
        }
    }

    /// Solves `H step = -gradient` and returns the root's part; the branches' are in `step`, and their changes of the
    /// residuals in `slope`.
    #[inline(always)]
    fn newton_step(&mut self, gradient: &RootVector) -> RootVector {
        let mut hessian = [[0.0; ROOT]; ROOT];
        let mut step = [0.0; ROOT];
        for i in 0..ROOT {
            hessian[i][i] = 1.0;
            step[i] = -gradient[i];
        }
        for k in 0..self.branches.len() {
            let branch = self.branches[k];
            unrolled!(branch => {
                self.assemble(&branch, &mut hessian);
                self.eliminate(&branch, &mut hessian, &mut step);
            });
        }
        solve_root(&mut hessian, &mut step);
        for k in 0..self.branches.len() {
            let branch = self.branches[k];
            unrolled!(branch => self.step_back(&branch, &step));
        }
        step
    }

    /// `H += [Y X]' C [Y X]` of one branch, lower triangle: the root's rows to `hessian`, its own to `square`.
    #[inline(always)]
    fn assemble(&mut self, branch: &Branch, hessian: &mut RootHessian) {
        let stride = branch.stride;
        let own = &mut self.square[branch.square..branch.square + branch.width * stride];
        own.fill(0.0);
        for (i, own) in own.chunks_exact_mut(stride).enumerate() {
            own[ROOT + i] = 1.0;
        }
        self.stiff.resize(self.stiff.len().max(stride), 0.0);
        let stiff = &mut self.stiff[..stride];
        for b in &self.blocks[branch.blocks.0..branch.blocks.1] {
            let first = b.first_row();
            for i in first..b.rows {
                let mut touched = false;
                for k in first..b.rows {
                    let c = b.response.hessian[(i - first) * MAX_ROWS + k - first];
                    if c != 0.0 {
                        if !touched {
                            stiff.fill(0.0);
                        }
                        touched = true;
                        axpy_lanes(c, branch.row(&self.matrix, b.row0 + k - branch.row0), stiff);
                    }
                }
                if !touched {
                    continue;
                }
                let row = branch.row(&self.matrix, b.row0 + i - branch.row0);
                add_to_root(&row[..ROOT], &stiff[..ROOT], 1.0, hessian);
                for (k, (own, x)) in own.chunks_exact_mut(stride).zip(&row[ROOT..]).enumerate() {
                    if *x != 0.0 {
                        let length = upto(ROOT + k);
                        axpy_lanes(*x, &stiff[..length], &mut own[..length]);
                    }
                }
            }
        }
    }

    /// Eliminates a branch's own unknowns, the last first: `H = L' D L`, as the engine factors its mass matrix, so that
    /// all rows are read from their beginning.
    #[inline(always)]
    fn eliminate(&mut self, branch: &Branch, hessian: &mut RootHessian, step: &mut RootVector) {
        let stride = branch.stride;
        let own = &mut self.square[branch.square..branch.square + branch.width * stride];
        let right = &mut self.step[branch.local..branch.local + stride];
        right[ROOT..].fill(0.0);
        for (right, gradient) in right[ROOT..].iter_mut().zip(branch.own(&self.gradient)) {
            *right = -gradient;
        }
        for j in (0..branch.width).rev() {
            let (above, rest) = own.split_at_mut(j * stride);
            let row = &mut rest[..stride];
            // at least one: the Hessian is no less than the identity
            let inverse = 1.0 / row[ROOT + j];
            let pull = right[ROOT + j] * inverse;
            for (i, above) in above.chunks_exact_mut(stride).enumerate() {
                let x = row[ROOT + i];
                if x != 0.0 {
                    let length = upto(ROOT + i);
                    axpy_lanes(-x * inverse, &row[..length], &mut above[..length]);
                    right[ROOT + i] -= x * pull;
                }
            }
            add_to_root(&row[..ROOT], &row[..ROOT], -inverse, hessian);
            axpy_lanes(-pull, &row[..ROOT], step);
            row[ROOT + j..].fill(0.0);
            row.iter_mut().for_each(|x| *x *= inverse);
            right[ROOT + j] = pull;
        }
    }

    /// The branch's own step, and what it changes of the residuals.
    #[inline(always)]
    fn step_back(&mut self, branch: &Branch, root: &RootVector) {
        let step = &mut self.step[branch.local..branch.local + branch.stride];
        step[..ROOT].copy_from_slice(root);
        let own = &self.square[branch.square..branch.square + branch.width * branch.stride];
        for (j, row) in own.chunks_exact(branch.stride).enumerate() {
            // a row of the factor ends before its own joint
            let moved = dot_lanes(row, step);
            step[ROOT + j] -= moved;
        }
        let slope = &mut self.slope[branch.row0..];
        branch.apply(&self.matrix, &self.step, |i, moved| slope[i] = moved);
    }
}

/// Length of a row up to entry `last`, in whole vectors.
#[inline(always)]
fn upto(last: usize) -> usize {
    (last / LANES + 1) * LANES
}

/// `H += scale a b'`, lower triangle, and what of the upper one costs nothing.
#[inline(always)]
fn add_to_root(a: &[f64], b: &[f64], scale: f64, hessian: &mut RootHessian) {
    for (k, row) in hessian.iter_mut().enumerate() {
        if a[k] != 0.0 {
            axpy_lanes(scale * a[k], &b[..upto(k)], &mut row[..upto(k)]);
        }
    }
}

/// Solves `H x = b` in place, `H` being no less than the identity.
#[inline(always)]
fn solve_root(hessian: &mut RootHessian, b: &mut RootVector) {
    for j in (0..ROOT).rev() {
        let (above, rest) = hessian.split_at_mut(j);
        let row = &mut rest[0];
        let inverse = 1.0 / row[j];
        row[j..].fill(0.0);
        b[j] *= inverse;
        let pull = b[j];
        for (i, above) in above.iter_mut().enumerate() {
            let l = row[i] * inverse;
            axpy_lanes(-l, &row[..upto(i)], &mut above[..upto(i)]);
            b[i] -= row[i] * pull;
        }
        row.iter_mut().for_each(|x| *x *= inverse);
    }
    for j in 0..ROOT {
        b[j] -= dot_lanes(&hessian[j], b);
    }
}
