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

use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS, Response};
use crate::grasp::linalg::{self, axpy_lanes, dot_lanes};

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
    branch: usize,
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
    /// Length of `[root; own]`, filled up with zeros to a multiple of [`LANES`](linalg::LANES).
    stride: usize,
    /// Offset of `[Y X]`, one row of `stride` for each of the branch's.
    matrix: usize,
    /// Offset in the arrays that hold `[root; own]` of each branch.
    local: usize,
    /// Offset of its own rows of the Hessian, `width` of `stride`.
    square: usize,
}

/// Does `$call` with a branch whose stride the compiler knows, so that the loops over its rows unroll.
macro_rules! unrolled {
    ($branch:ident => $call:expr) => {
        match $branch.stride {
            12 => unrolled!(12, $branch => $call),
            16 => unrolled!(16, $branch => $call),
            20 => unrolled!(20, $branch => $call),
            24 => unrolled!(24, $branch => $call),
            _ => $call,
        }
    };
    ($stride:literal, $branch:ident => $call:expr) => {{
        let $branch = Branch { stride: $stride, ..$branch };
        $call
    }};
}
use unrolled;

/// The problem and its workspace; buffers are kept from step to step, so that a warm solve allocates nothing.
#[derive(Clone, Debug, Default)]
pub struct Arrow {
    branches: Vec<Branch>,
    /// Those of this problem come first; the others are room for larger ones.
    blocks: Vec<Block>,
    used: usize,
    /// `Y` of the branch that is being made.
    root_rows: Vec<RootVector>,
    /// `[Y X]` of each branch, row-major.
    matrix: Vec<f64>,
    bias: Vec<f64>,
    /// Forces from which `w` starts.
    start: Vec<f64>,
    /// `f`, what the costs answer.
    forces: Vec<f64>,
    jar: Vec<f64>,
    /// Change of `jar` along the Newton step.
    slope: Vec<f64>,
    /// `[z; w]` of each branch.
    point: Vec<f64>,
    /// Its gradient; the root's part is what the branch adds to it.
    gradient: Vec<f64>,
    /// The Newton step; while branches are eliminated, what it is where root and earlier joints rest.
    step: Vec<f64>,
    /// Own rows of each branch's Hessian, then of its unit lower factor.
    square: Vec<f64>,
    /// Rows of one block times its cost's second derivative.
    stiff: Vec<f64>,
}

impl Arrow {
    /// Starts a new problem.
    pub fn begin(&mut self) {
        self.branches.clear();
        self.used = 0;
        self.matrix.clear();
        self.bias.clear();
        self.start.clear();
        self.point.clear();
    }

    /// Starts a branch: blocks added from now on share its joints.
    pub fn begin_branch(&mut self) {
        let block = self.used;
        self.root_rows.clear();
        self.branches.push(Branch {
            blocks: (block, block),
            row0: self.bias.len(),
            rows: 0,
            width: 0,
            stride: ROOT,
            matrix: self.matrix.len(),
            local: self.point.len(),
            square: self.branches.last().map_or(0, |b| b.square + b.width * b.stride),
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
        if self.used == self.blocks.len() {
            self.blocks.push(Block { branch: 0, rows: 0, row0: 0, cost, response: Response::open() });
        }
        // second derivatives are many numbers: those of an earlier problem stay until they are set in this one
        let block = &mut self.blocks[self.used];
        (block.branch, block.rows, block.row0) = (self.branches.len().saturating_sub(1), bias.len(), self.bias.len());
        block.cost = cost;
        (block.response.force, block.response.active_set) = ([0.0; MAX_ROWS], active_set);
        self.used += 1;
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
        branch.stride = (ROOT + branch.width).next_multiple_of(linalg::LANES);
        self.matrix.resize(branch.matrix + m * branch.stride, 0.0);
        self.point.resize(branch.local + branch.stride, 0.0);
        // more joints than rows: as many unknowns as rows give the same rows, X X' being the same
        let few = (joints > m).then(|| {
            self.square.resize(self.square.len().max(branch.square + m * m), 0.0);
            let row = |i: usize| &own_rows[i * joints..(i + 1) * joints];
            let factor = &mut self.square[branch.square..branch.square + m * m];
            linalg::semidefinite_factor(m, |i, j| linalg::dot(row(i), row(j)), factor);
            &self.square[branch.square..branch.square + m * m]
        });
        let (own_rows, width) = (few.unwrap_or(own_rows), branch.width);
        for (i, row) in self.matrix[branch.matrix..].chunks_exact_mut(branch.stride).enumerate() {
            row[..ROOT].copy_from_slice(&self.root_rows[i]);
            row[ROOT..ROOT + width].copy_from_slice(&own_rows[i * width..(i + 1) * width]);
        }
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
        let b = &self.blocks[block];
        let branch = &self.branches[b.branch];
        let row = branch.row(&self.matrix, b.row0 - branch.row0 + row);
        dot_lanes(row, row)
    }

    /// Goes on to the next problem on the same rows: what stands of the solution so far (`kept`, one force for each
    /// row) becomes a part of the bias, each block gets a new cost and expected active set, and the solve starts at the forces
    /// `start`.
    pub fn continue_with(&mut self, kept: &[f64], start: &[f64], mut recost: impl FnMut(usize) -> (Cost, ActiveSet)) {
        self.start.copy_from_slice(kept);
        let moved = self.point_from_start();
        self.set_root(&moved);
        for &branch in &self.branches {
            let bias = &mut self.bias[branch.row0..];
            unrolled!(branch => branch.apply(&self.matrix, &self.point, |i, moved| bias[i] += moved));
        }
        self.start.copy_from_slice(start);
        for (k, block) in self.blocks[..self.used].iter_mut().enumerate() {
            (block.cost, block.response.active_set) = recost(k);
        }
    }

    /// `w = X' f` of the starting forces; returns `Y' f`.
    #[inline(always)]
    fn point_from_start(&mut self) -> RootVector {
        let mut root = [0.0; ROOT];
        for k in 0..self.branches.len() {
            let branch = self.branches[k];
            unrolled!(branch => self.point_of(&branch));
            axpy_lanes(1.0, &self.point[branch.local..branch.local + ROOT], &mut root);
        }
        root
    }

    #[inline(always)]
    fn point_of(&mut self, branch: &Branch) {
        let point = &mut self.point[branch.local..branch.local + branch.stride];
        point.fill(0.0);
        for (row, f) in branch.rows(&self.matrix).zip(&self.start[branch.row0..]) {
            axpy_lanes(*f, row, point);
        }
    }

    /// Copies `z` into the point of each branch.
    #[inline(always)]
    fn set_root(&mut self, z: &RootVector) {
        for branch in &self.branches {
            self.point[branch.local..branch.local + ROOT].copy_from_slice(z);
        }
    }
}

impl Branch {
    /// Row `i` of the branch's `[Y X]`.
    #[inline(always)]
    fn row<'a>(&self, matrix: &'a [f64], i: usize) -> &'a [f64] {
        let start = self.matrix + i * self.stride;
        &matrix[start..start + self.stride]
    }

    /// All of them.
    #[inline(always)]
    fn rows<'a>(&self, matrix: &'a [f64]) -> std::slice::ChunksExact<'a, f64> {
        matrix[self.matrix..self.matrix + self.rows * self.stride].chunks_exact(self.stride)
    }

    /// Calls `row` with `[Y X] x` of each row, `x` being the branch's in `vector`.
    #[inline(always)]
    fn apply(&self, matrix: &[f64], vector: &[f64], mut row: impl FnMut(usize, f64)) {
        let x = &vector[self.local..self.local + self.stride];
        for (i, entries) in self.rows(matrix).enumerate() {
            row(i, dot_lanes(entries, x));
        }
    }

    /// Its own unknowns in `vector`.
    #[inline(always)]
    fn own<'a>(&self, vector: &'a [f64]) -> &'a [f64] {
        &vector[self.local + ROOT..self.local + ROOT + self.width]
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
