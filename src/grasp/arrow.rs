//! Newton's method on the grasp problem, with the fingers eliminated.
//!
//! The next motion minimises an inertial cost plus one convex law for each contact:
//!
//! ```text
//! 1/2 |z|^2  +  sum over fingers of 1/2 lambda' W lambda  +  sum over contacts of s(bias + Y z + W lambda)
//! ```
//!
//! `z` are the twelve whitened accelerations of palm and target (the *root*), `lambda` the forces that a finger's rows
//! have come to know, and `W` the mobility that the finger's own joints give its rows: `W lambda` is how the finger's
//! links move. At the minimum `lambda` is the contact force. The Hessian is an arrow: each finger is eliminated by a
//! factorization of the size of its own rows, and what is left are the root's twelve unknowns however many fingers and
//! contacts there are.

#![allow(clippy::needless_range_loop)] // small matrices are read by their indices, as in the formulas

use super::cone::{Law, MAX_ROWS, Response, Zone};
use super::dense;
use nalgebra::{SMatrix, SVector};
use pulp::Arch;

/// Unknowns of the root: the palm's six and the target's six.
pub const ROOT: usize = 12;
/// One number for each unknown of the root.
pub type RootVector = [f64; ROOT];

/// Gradient norm, relative to the largest term in it, below which a point counts as the minimum.
const TOLERANCE: f64 = 1e-7;
/// Newton iterations before giving up; warm-started steps take one or two.
const MAX_ITERATIONS: usize = 60;
/// Sufficient decrease of the backtracking line search (Armijo).
const ARMIJO: f64 = 1e-4;
/// Halvings of the Newton step before the line search gives up.
const MAX_HALVINGS: usize = 40;

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// Newton iterations.
    pub iterations: usize,
    /// True when the gradient is within tolerance or every law is affine around the point.
    pub converged: bool,
}

/// One contact (or scalar row): a law on some rows of one finger and the root.
#[derive(Clone, Copy, Debug)]
struct Block {
    rows: usize,
    /// First row, in the arrays that hold one entry per row.
    row0: usize,
    law: Law,
    response: Response,
}

/// A finger with contacts, or all contacts that no finger's joints take part in.
#[derive(Clone, Copy, Debug)]
struct Branch {
    blocks: (usize, usize),
    row0: usize,
    rows: usize,
    /// Offset of the branch's square matrices.
    square0: usize,
    moves: bool,
}

/// The problem and its workspace; buffers are kept from step to step, so that a warm solve allocates nothing.
#[derive(Clone, Debug, Default)]
pub struct Arrow {
    branches: Vec<Branch>,
    blocks: Vec<Block>,
    /// `Y`
    root_rows: Vec<RootVector>,
    bias: Vec<f64>,
    /// `lambda`
    forces: Vec<f64>,
    /// `f`, what the laws answer.
    law_forces: Vec<f64>,
    /// `W` of each branch, row-major.
    mobility: Vec<f64>,
    jar: Vec<f64>,
    /// Change of `jar` along the Newton step.
    slope: Vec<f64>,
    force_step: Vec<f64>,
    /// `E (f - lambda)` of each branch, `E = (I + C W)^-1`.
    pull: Vec<f64>,
    /// `E C` of each branch: the stiffness that the root feels.
    stiffness: Vec<f64>,
    scratch: Vec<f64>,
}

/// What a solve works on besides the contacts' rows.
struct Newton {
    gradient: RootVector,
    step: RootVector,
    hessian: [RootVector; ROOT],
}

impl Arrow {
    /// Starts a new problem.
    pub fn begin(&mut self) {
        self.branches.clear();
        self.blocks.clear();
        self.root_rows.clear();
        self.bias.clear();
        self.forces.clear();
        self.mobility.clear();
    }

    /// Starts a branch: blocks added from now on share one finger.
    pub fn begin_branch(&mut self) {
        let block = self.blocks.len();
        self.branches.push(Branch {
            blocks: (block, block),
            row0: self.bias.len(),
            rows: 0,
            square0: self.mobility.len(),
            moves: false,
        });
    }

    /// Adds a contact to the present branch: one entry of `root_rows`, `bias` and `forces` for each row. `forces` is
    /// where `lambda` starts and `zone` where on its cone the contact is expected.
    pub fn add_block(&mut self, law: Law, zone: Zone, root_rows: &[RootVector], bias: &[f64], forces: &[f64]) {
        let mut response = Response::open();
        response.zone = zone;
        self.blocks.push(Block { rows: bias.len(), row0: self.bias.len(), law, response });
        self.root_rows.extend_from_slice(root_rows);
        self.bias.extend_from_slice(bias);
        self.forces.extend_from_slice(forces);
        if let Some(branch) = self.branches.last_mut() {
            branch.blocks.1 += 1;
            branch.rows += bias.len();
        }
    }

    /// Ends a branch whose finger's joints give its rows the mobility `entry(i, j)`; `None` if no joint takes part.
    pub fn end_branch(&mut self, entry: Option<impl Fn(usize, usize) -> f64>) {
        let Some(branch) = self.branches.last_mut() else { return };
        let m = branch.rows;
        branch.moves = entry.is_some();
        let square0 = branch.square0;
        self.mobility.resize(square0 + m * m, 0.0);
        if let Some(entry) = entry {
            for i in 0..m {
                for j in 0..=i {
                    let w = entry(i, j);
                    self.mobility[square0 + i * m + j] = w;
                    self.mobility[square0 + j * m + i] = w;
                }
            }
        }
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.blocks.len()
    }

    /// The law of block `block`, and where on its cone the contact is expected.
    pub fn law(&self, block: usize) -> &Law {
        &self.blocks[block].law
    }

    /// What the law of block `block` answered at the solution.
    pub fn response(&self, block: usize) -> &Response {
        &self.blocks[block].response
    }

    /// The residual of block `block` at the solution.
    pub fn residual(&self, block: usize) -> &[f64] {
        let b = &self.blocks[block];
        &self.jar[b.row0..b.row0 + b.rows]
    }

    /// How easily row `row` of block `block` moves [1/kg]: `|Y_i|^2 + W_ii`.
    pub fn row_mobility(&self, block: usize, row: usize) -> f64 {
        let i = self.blocks[block].row0 + row;
        let y = &self.root_rows[i];
        let own = self.branches.iter().find(|b| (b.row0..b.row0 + b.rows).contains(&i)).map_or(0.0, |b| {
            let k = i - b.row0;
            self.mobility[b.square0 + k * b.rows + k]
        });
        own + dense::dot(y, y)
    }

    /// Goes on to the next problem on the same rows: what stands of the solution so far (`kept`, one force for each
    /// row) becomes a part of the bias, each block gets a new law and expected zone, and `lambda` starts at `start`.
    /// Returns the root's motion that `kept` explains.
    pub fn continue_with(
        &mut self,
        kept: &[f64],
        start: &[f64],
        mut relaw: impl FnMut(usize) -> (Law, Zone),
    ) -> RootVector {
        let mut moved = [0.0; ROOT];
        for (y, f) in self.root_rows.iter().zip(kept) {
            dense::axpy(*f, y, &mut moved);
        }
        for (bias, y) in self.bias.iter_mut().zip(&self.root_rows) {
            *bias += dense::dot(y, &moved);
        }
        self.forces.copy_from_slice(kept);
        for branch in &self.branches {
            add_mobility(branch, &self.mobility, &self.forces, &mut self.bias);
        }
        self.forces.copy_from_slice(start);
        for (k, block) in self.blocks.iter_mut().enumerate() {
            (block.law, block.response.zone) = relaw(k);
        }
        moved
    }

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

impl Branch {
    /// Row `i` of this branch's square matrix in `squares`.
    #[inline(always)]
    fn row<'a>(&self, squares: &'a [f64], i: usize) -> &'a [f64] {
        let start = self.square0 + i * self.rows;
        &squares[start..start + self.rows]
    }
}

impl Block {
    /// [`Law::Slip`] leaves the normal row, which comes first, alone.
    fn first_row(&self) -> usize {
        usize::from(matches!(self.law, Law::Slip { .. }))
    }

    fn store_force(&self, forces: &mut [f64]) {
        let first = self.first_row();
        let forces = &mut forces[self.row0..self.row0 + self.rows];
        forces[..first].fill(0.0);
        forces[first..].copy_from_slice(&self.response.force[..self.rows - first]);
    }
}

/// `out += W x` on the rows of a branch.
#[inline(always)]
fn add_mobility(branch: &Branch, mobility: &[f64], x: &[f64], out: &mut [f64]) {
    if branch.moves {
        let rows = branch.row0..branch.row0 + branch.rows;
        for i in 0..branch.rows {
            out[branch.row0 + i] += dense::dot(branch.row(mobility, i), &x[rows.clone()]);
        }
    }
}
