//! The grasp problem with its Hessian's arrow shape: a root of twelve unknowns, and fingers that know only themselves and
//! the root.
//!
//! The next motion minimises an inertial cost plus one convex cost for each contact:
//!
//! ```text
//! 1/2 |z|^2  +  sum over branches of 1/2 |w|^2  +  sum over contacts of s(bias + Y z + X w)
//! ```
//!
//! `z` are the twelve whitened accelerations of palm and target (the *root*), `w` those of the joints of one *branch* (a
//! finger, as a rule), of which a contact's rows see `X w`. Each branch is eliminated by a factorization of its own size,
//! and what is left are the root's twelve unknowns however many fingers and contacts there are.

mod newton;

use crate::grasp::contact::cost::{ActiveSet, Cost, Response};
use crate::grasp::linalg;

/// Unknowns of the root: the palm's six and the target's six.
pub const ROOT: usize = 12;
/// One number for each unknown of the root.
pub type RootVector = [f64; ROOT];

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// Newton iterations.
    pub iterations: usize,
    /// True when the gradient is within tolerance or every cost is affine around the point.
    pub converged: bool,
}

/// One contact (or scalar row): a cost on some rows of one branch and the root.
#[derive(Clone, Copy, Debug)]
struct Block {
    rows: usize,
    /// First row, in the arrays that hold one entry per row.
    row0: usize,
    cost: Cost,
    response: Response,
}

/// Blocks that share joints.
#[derive(Clone, Copy, Debug)]
struct Branch {
    blocks: (usize, usize),
    row0: usize,
    rows: usize,
    /// Unknowns of its own: the joints, or as many combinations of them as there are rows.
    width: usize,
    /// First of them, in the arrays that hold one entry for each.
    own0: usize,
    /// Offset of `X`, rows x width.
    x0: usize,
    /// Offset of the factor, width x width.
    square0: usize,
}

/// The problem and its workspace; buffers are kept from step to step, so that a warm solve allocates nothing.
#[derive(Clone, Debug, Default)]
pub struct Arrow {
    branches: Vec<Branch>,
    blocks: Vec<Block>,
    /// `Y`
    root_rows: Vec<RootVector>,
    /// `X` of each branch, row-major.
    own_rows: Vec<f64>,
    bias: Vec<f64>,
    /// Forces from which `w` starts.
    start: Vec<f64>,
    /// `w`
    own: Vec<f64>,
    /// `f`, what the costs answer.
    forces: Vec<f64>,
    jar: Vec<f64>,
    /// Change of `jar` along the Newton step.
    slope: Vec<f64>,
    own_gradient: Vec<f64>,
    own_step: Vec<f64>,
    /// `C X` of each branch, `C` the costs' second derivative.
    stiff_rows: Vec<f64>,
    /// Factor (or, of small ones, inverse) of `I + X' C X` of each branch.
    factors: Vec<f64>,
    scratch: Vec<f64>,
}

impl Arrow {
    /// Starts a new problem.
    pub fn begin(&mut self) {
        self.branches.clear();
        self.blocks.clear();
        self.root_rows.clear();
        self.own_rows.clear();
        self.bias.clear();
        self.start.clear();
        self.own.clear();
        self.factors.clear();
    }

    /// Starts a branch: blocks added from now on share its joints.
    pub fn begin_branch(&mut self) {
        let block = self.blocks.len();
        self.branches.push(Branch {
            blocks: (block, block),
            row0: self.bias.len(),
            rows: 0,
            width: 0,
            own0: self.own.len(),
            x0: self.own_rows.len(),
            square0: self.factors.len(),
        });
    }

    /// Adds a contact to the present branch: one entry of `root_rows`, `bias` and `forces` for each row. `forces` is
    /// where the solve starts and `active_set` where on its cone the contact is expected.
    pub fn add_block(
        &mut self,
        cost: Cost,
        active_set: ActiveSet,
        root_rows: &[RootVector],
        bias: &[f64],
        forces: &[f64],
    ) {
        let mut response = Response::open();
        response.active_set = active_set;
        self.blocks.push(Block { rows: bias.len(), row0: self.bias.len(), cost, response });
        self.root_rows.extend_from_slice(root_rows);
        self.bias.extend_from_slice(bias);
        self.start.extend_from_slice(forces);
        if let Some(branch) = self.branches.last_mut() {
            branch.blocks.1 += 1;
            branch.rows += bias.len();
        }
    }

    /// Ends a branch. `own_rows`: how its rows see its joints, whitened; one row of `joints` entries for each.
    pub fn end_branch(&mut self, joints: usize, own_rows: &[f64]) {
        let Some(branch) = self.branches.last_mut() else { return };
        let m = branch.rows;
        branch.width = joints.min(m);
        if joints <= m {
            self.own_rows.extend_from_slice(&own_rows[..m * joints]);
        } else {
            // more joints than rows: as many unknowns as rows give the same rows, X X' being the same
            self.own_rows.resize(branch.x0 + m * m, 0.0);
            let row = |i: usize| &own_rows[i * joints..(i + 1) * joints];
            linalg::semidefinite_factor(m, |i, j| linalg::dot(row(i), row(j)), &mut self.own_rows[branch.x0..]);
        }
        self.own.resize(branch.own0 + branch.width, 0.0);
        self.factors.resize(branch.square0 + branch.width * branch.width, 0.0);
    }

    /// The cost of block `block`.
    pub fn cost(&self, block: usize) -> &Cost {
        &self.blocks[block].cost
    }

    /// What the cost of block `block` answered at the solution.
    pub fn response(&self, block: usize) -> &Response {
        &self.blocks[block].response
    }

    /// The residual of block `block` at the solution.
    pub fn residual(&self, block: usize) -> &[f64] {
        let b = &self.blocks[block];
        &self.jar[b.row0..b.row0 + b.rows]
    }

    /// How easily row `row` of block `block` moves [1/kg]: `|Y_i|^2 + |X_i|^2`.
    pub fn row_inverse_inertia(&self, block: usize, row: usize) -> f64 {
        let i = self.blocks[block].row0 + row;
        let y = &self.root_rows[i];
        let own = self.branches.iter().find(|b| (b.row0..b.row0 + b.rows).contains(&i)).map_or(0.0, |b| {
            let x = b.own_row(&self.own_rows, i - b.row0);
            linalg::dot(x, x)
        });
        own + linalg::dot(y, y)
    }

    /// Goes on to the next problem on the same rows: what stands of the solution so far (`kept`, one force for each
    /// row) becomes a part of the bias, each block gets a new cost and expected active set, and the solve starts at the forces
    /// `start`.
    pub fn continue_with(&mut self, kept: &[f64], start: &[f64], mut recost: impl FnMut(usize) -> (Cost, ActiveSet)) {
        let mut moved = [0.0; ROOT];
        for (y, f) in self.root_rows.iter().zip(kept) {
            linalg::axpy(*f, y, &mut moved);
        }
        for (bias, y) in self.bias.iter_mut().zip(&self.root_rows) {
            *bias += linalg::dot(y, &moved);
        }
        self.start.copy_from_slice(kept);
        self.own_from_start();
        for branch in &self.branches {
            branch.add_own(&self.own_rows, &self.own, &mut self.bias);
        }
        self.start.copy_from_slice(start);
        for (k, block) in self.blocks.iter_mut().enumerate() {
            (block.cost, block.response.active_set) = recost(k);
        }
    }

    /// `w = X' f` of the starting forces.
    fn own_from_start(&mut self) {
        for branch in &self.branches {
            let own = &mut self.own[branch.own0..branch.own0 + branch.width];
            own.fill(0.0);
            for i in 0..branch.rows {
                linalg::axpy(self.start[branch.row0 + i], branch.own_row(&self.own_rows, i), own);
            }
        }
    }
}

impl Branch {
    /// Row `i` of this branch's matrix in `rows`: `X`, or one of its shape.
    #[inline(always)]
    fn own_row<'a>(&self, rows: &'a [f64], i: usize) -> &'a [f64] {
        let start = self.x0 + i * self.width;
        &rows[start..start + self.width]
    }

    /// `out += X own` on the rows of this branch.
    #[inline(always)]
    fn add_own(&self, own_rows: &[f64], own: &[f64], out: &mut [f64]) {
        if self.width > 0 {
            let own = &own[self.own0..self.own0 + self.width];
            for i in 0..self.rows {
                out[self.row0 + i] += linalg::dot(self.own_row(own_rows, i), own);
            }
        }
    }
}

impl Block {
    /// [`Cost::Slip`] leaves the normal row, which comes first, alone.
    fn first_row(&self) -> usize {
        usize::from(matches!(self.cost, Cost::Slip { .. }))
    }

    fn store_force(&self, forces: &mut [f64]) {
        let first = self.first_row();
        let forces = &mut forces[self.row0..self.row0 + self.rows];
        forces[..first].fill(0.0);
        forces[first..].copy_from_slice(&self.response.force[..self.rows - first]);
    }
}
