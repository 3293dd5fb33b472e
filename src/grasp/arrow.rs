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

mod newton;

use super::cone::{Law, Response, Zone};
use super::dense;

/// Unknowns of the root: the palm's six and the target's six.
pub const ROOT: usize = 12;
/// One number for each unknown of the root.
pub type RootVector = [f64; ROOT];

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
