//! The grasp problem with its Hessian's arrow shape: a root of at most twelve unknowns, and fingers that know only
//! themselves and the root.
//!
//! The next motion minimises an inertial cost plus one convex cost for each contact:
//!
//! ```text
//! 1/2 |z|^2  +  sum over branches of 1/2 |d + M^-1 N z|^2_M  +  sum over contacts of s(bias + Y z + X d)
//! ```
//!
//! `z` are the whitened accelerations of palm and target (the *root*), `d` those of the joints of one *branch* (a finger, as
//! a rule), `M` the branch's inertia and `N` its coupling to the palm. In joints' own coordinates a joint limit or friction
//! loss is one entry on the diagonal of the Hessian. Each branch is eliminated by a factorization of its own size, and
//! what is left are the root's unknowns however many fingers and contacts there are.

mod branch;
mod hessian;
mod kernels;
mod line_search;
mod newton;
mod single;

use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS, Response};
use crate::grasp::linalg::LANES;
use branch::Branch;
use hessian::Hessian;
use single::Single;

/// Most unknowns of the root: the palm's six and the target's six.
pub const ROOT: usize = 12;
/// One number for each unknown of the root; those beyond the present problem's are zero.
pub type RootVector = [f64; ROOT];
/// Symmetric, row-major with as many columns as the present problem's root.
type RootMatrix = [f64; ROOT * ROOT];

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// Newton iterations.
    pub iterations: usize,
    /// True when the gradient is within tolerance or every cost is affine around the point.
    pub converged: bool,
}

/// One contact, or another cost on some rows of one branch and the root.
#[derive(Clone, Copy, Debug)]
struct Block {
    branch: usize,
    rows: usize,
    /// First row, in the arrays that hold one entry per row.
    row0: usize,
    cost: Cost,
    response: Response,
    /// The residual at whose tangent the solve begins.
    expected: Option<[f64; MAX_ROWS]>,
    mobility: f64,
}

/// The problem and its workspace; buffers are kept from step to step, so that a warm solve allocates nothing.
#[derive(Clone, Debug)]
pub struct Arrow {
    /// Unknowns of the root, filled up with zeros to a multiple of [`LANES`].
    root: usize,
    branches: Vec<Branch>,
    /// Those of this problem come first; the others are room for larger ones.
    blocks: Vec<Block>,
    used: usize,
    singles: Vec<Single>,
    /// `-sum N' M^-1 N`, lower triangle.
    coupling: RootMatrix,
    /// `1 + sum N' M^-1 N`: the root's inertia with the branches' joints held.
    root_inertia: RootMatrix,
    /// `[N M]` of each branch, row-major, `width` rows of `stride`.
    inertia: Vec<f64>,
    /// Its factor, as [`Branch::factorize`] leaves it, and the inverse pivots.
    inertia_factor: Vec<f64>,
    inertia_pivots: Vec<f64>,
    /// `[Y X]` of each branch, row-major.
    matrix: Vec<f64>,
    bias: Vec<f64>,
    /// Forces from which the point starts.
    start: Vec<f64>,
    /// `f`, what the costs answer.
    forces: Vec<f64>,
    jar: Vec<f64>,
    /// Change of `jar` along the Newton step.
    slope: Vec<f64>,
    /// `[z; d]` of each branch.
    point: Vec<f64>,
    /// Its gradient; the root's part is what the branch adds to it.
    gradient: Vec<f64>,
    /// The Newton step.
    step: Vec<f64>,
    /// Of the costs in hand.
    hessian: Hessian,
    /// Of the pass before, or the one after: they take turns.
    other_hessian: Hessian,
    /// True once the mobilities of this problem are known.
    mobile: bool,
    /// Rows of one block times its cost's second derivative.
    stiff: Vec<f64>,
    /// One row.
    row: Vec<f64>,
}

impl Default for Arrow {
    fn default() -> Self {
        Arrow {
            root: ROOT,
            branches: Vec::new(),
            blocks: Vec::new(),
            used: 0,
            singles: Vec::new(),
            coupling: [0.0; ROOT * ROOT],
            root_inertia: [0.0; ROOT * ROOT],
            inertia: Vec::new(),
            inertia_factor: Vec::new(),
            inertia_pivots: Vec::new(),
            matrix: Vec::new(),
            bias: Vec::new(),
            start: Vec::new(),
            forces: Vec::new(),
            jar: Vec::new(),
            slope: Vec::new(),
            point: Vec::new(),
            gradient: Vec::new(),
            step: Vec::new(),
            hessian: Hessian::default(),
            other_hessian: Hessian::default(),
            mobile: false,
            stiff: Vec::new(),
            row: Vec::new(),
        }
    }
}

impl Arrow {
    /// Starts a new problem with `root` unknowns of palm and target, at most [`ROOT`].
    pub fn begin(&mut self, root: usize) {
        self.root = root.next_multiple_of(LANES).min(ROOT);
        self.hessian.forget();
        self.other_hessian.forget();
        self.mobile = false;
        self.used = 0;
        self.coupling.fill(0.0);
        self.branches.clear();
        self.singles.clear();
        for buffer in [
            &mut self.inertia,
            &mut self.inertia_factor,
            &mut self.inertia_pivots,
            &mut self.matrix,
            &mut self.bias,
            &mut self.start,
            &mut self.point,
        ] {
            buffer.clear();
        }
    }

    /// Starts a branch with `joints` unknowns of its own, none or those of some fingers. Their inertia is the identity, apart
    /// from the root, where [`inertia_row`](Self::inertia_row) is not set.
    pub fn begin_branch(&mut self, joints: usize) {
        let stride = self.root + joints.next_multiple_of(LANES);
        let branch = Branch {
            blocks: (self.used, self.used),
            singles: (self.singles.len(), self.singles.len()),
            row0: self.bias.len(),
            rows: 0,
            root: self.root,
            width: joints,
            free: joints,
            stride,
            matrix: self.matrix.len(),
            local: self.point.len(),
            square: self.inertia.len(),
            pivot: self.inertia_pivots.len(),
        };
        self.inertia.resize(branch.square + joints * stride, 0.0);
        for (j, row) in self.inertia[branch.square..].chunks_exact_mut(stride).enumerate() {
            row[self.root + j] = 1.0;
        }
        self.inertia_pivots.resize(branch.pivot + joints, 0.0);
        self.point.resize(branch.local + stride, 0.0);
        self.branches.push(branch);
    }

    /// The inertia of joint `joint` of the present branch: `N` of the root's unknowns and `M` of the branch's own.
    pub fn inertia_row(&mut self, joint: usize) -> (&mut [f64], &mut [f64]) {
        let Some(branch) = self.branches.last_mut() else { return (&mut [], &mut []) };
        branch.free = branch.free.min(joint);
        let start = branch.square + joint * branch.stride;
        let (root, own) = self.inertia[start..start + branch.stride].split_at_mut(branch.root);
        (root, &mut own[..branch.width])
    }

    /// Adds a contact to the present branch: one entry of `bias` and `forces` for each row. `forces` is where the solve
    /// starts and `active_set` where on its cone the contact is expected. Returns its number; its rows are
    /// [set](Self::row) after it.
    pub fn add_block(&mut self, cost: Cost, active_set: ActiveSet, bias: &[f64], forces: &[f64]) -> usize {
        let Some(branch) = self.branches.last_mut() else { return 0 };
        if self.used == self.blocks.len() {
            self.blocks.push(Block {
                branch: 0,
                rows: 0,
                row0: 0,
                cost,
                response: Response::open(),
                expected: None,
                mobility: 0.0,
            });
        }
        branch.blocks.1 += 1;
        branch.rows += bias.len();
        self.matrix.resize(branch.matrix + branch.rows * branch.stride, 0.0);
        // second derivatives are many numbers: those of an earlier problem stay until they are set in this one
        let block = &mut self.blocks[self.used];
        (block.branch, block.rows, block.row0) = (self.branches.len() - 1, bias.len(), self.bias.len());
        (block.cost, block.expected) = (cost, None);
        (block.response.force, block.response.active_set) = ([0.0; MAX_ROWS], active_set);
        self.used += 1;
        self.bias.extend_from_slice(bias);
        self.start.extend_from_slice(forces);
        self.used - 1
    }

    /// Row `row` of a block of the present branch: `Y` of the root's unknowns and `X` of the branch's own; zero at first.
    pub fn row(&mut self, block: usize, row: usize) -> (&mut [f64], &mut [f64]) {
        let b = &self.blocks[block];
        let branch = &self.branches[b.branch];
        let start = branch.matrix + (b.row0 - branch.row0 + row) * branch.stride;
        let (root, own) = self.matrix[start..start + branch.stride].split_at_mut(branch.root);
        (root, &mut own[..branch.width])
    }

    /// Adds a cost on one joint of the present branch: [`Cost::Unilateral`] or [`Cost::Bounded`] on `bias + entry d_joint`.
    pub fn add_single(
        &mut self,
        cost: Cost,
        active_set: ActiveSet,
        (joint, entry): (usize, f64),
        bias: f64,
        force: f64,
    ) {
        let Some(branch) = self.branches.last_mut() else { return };
        branch.singles.1 += 1;
        self.singles.push(Single::new(&cost, active_set, branch, (joint, entry), bias, force));
    }

    /// Ends a branch: its inertia is set.
    pub fn end_branch(&mut self) {
        let Some(branch) = self.branches.last_mut() else { return };
        branch.free -= branch.free % LANES;
        let branch = *branch;
        self.inertia_factor.extend_from_slice(&self.inertia[branch.square..]);
        self.factorize_inertia(branch);
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

    /// Cost `single` on a joint, at the solution.
    pub fn single(&self, single: usize) -> &Single {
        &self.singles[single]
    }

    /// How easily the second row of block `block` moves, its third where the second hardly does, its first if it has no other
    /// [1/kg]: `J M^-1 J'` of the whole. Known after [`keep`](Self::keep).
    pub fn mobility(&self, block: usize) -> f64 {
        self.blocks[block].mobility
    }

    /// As [`mobility`](Self::mobility), of row `row`.
    pub fn row_mobility(&mut self, block: usize, row: usize) -> f64 {
        let b = &self.blocks[block];
        let branch = &self.branches[b.branch];
        let entries = &mut self.row[..branch.stride];
        entries.copy_from_slice(branch.row(&self.matrix, b.row0 - branch.row0 + row));
        branch.mobility(&self.inertia_factor, &self.inertia_pivots, entries)
    }

    /// Makes a part of the bias of what stands of the solution so far: forces `of_block` and `of_single`, one for each row, by
    /// their number and what they have come to.
    pub fn keep(
        &mut self,
        of_block: impl Fn(usize, &[f64; MAX_ROWS]) -> [f64; MAX_ROWS],
        of_single: impl Fn(usize, f64) -> f64,
    ) {
        for (k, b) in self.blocks[..self.used].iter().enumerate() {
            self.start[b.row0..b.row0 + b.rows].copy_from_slice(&of_block(k, &b.response.force)[..b.rows]);
        }
        for (k, s) in self.singles.iter_mut().enumerate() {
            s.start = of_single(k, s.force);
        }
        self.absorb_start();
        std::mem::swap(&mut self.hessian, &mut self.other_hessian);
    }

    /// Goes back to the costs of the first pass, for other biases of the same rows: each block's and single's is then
    /// set ([`bias_mut`](Self::bias_mut), [`rebias_single`](Self::rebias_single)) and [recosted](Self::recost).
    pub fn resume(&mut self) {
        std::mem::swap(&mut self.hessian, &mut self.other_hessian);
    }

    /// The bias of block `block`, one entry for each row, to be set anew.
    pub fn bias_mut(&mut self, block: usize) -> &mut [f64] {
        let b = &self.blocks[block];
        &mut self.bias[b.row0..b.row0 + b.rows]
    }

    /// The largest of all biases.
    pub fn largest_bias(&self) -> f64 {
        let singles = self.singles.iter().map(|s| s.bias);
        self.bias.iter().copied().chain(singles).fold(0.0, |largest, bias| bias.abs().max(largest))
    }

    /// Sets the bias of cost `single` anew.
    pub fn rebias_single(&mut self, single: usize, bias: f64) {
        self.singles[single].bias = bias;
    }

    /// Gives block `block` another cost, the active set in which it is expected, and forces at which the next solve starts.
    pub fn recost(&mut self, block: usize, cost: Cost, active_set: ActiveSet, start: &[f64; MAX_ROWS]) {
        let b = &mut self.blocks[block];
        (b.cost, b.response.active_set, b.expected) = (cost, active_set, None);
        self.start[b.row0..b.row0 + b.rows].copy_from_slice(&start[..b.rows]);
    }

    /// The residual that block `block` will have, about, in the rows that its cost governs: the solve begins with the tangent there,
    /// and not with the active set that is expected.
    pub fn expect(&mut self, block: usize, residual: &[f64]) {
        self.blocks[block].expect(residual);
    }

    /// As [`expect`](Self::expect): the residual that it has.
    pub fn expect_same(&mut self, block: usize) {
        let b = &mut self.blocks[block];
        b.expect(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows]);
    }

    /// As [`recost`](Self::recost), of cost `single`.
    pub fn recost_single(&mut self, single: usize, cost: &Cost, active_set: ActiveSet, start: f64) {
        self.singles[single].recost(cost, active_set, start);
    }

    /// Centres each friction loss of a joint at its force.
    pub fn centre_singles(&mut self) {
        self.singles.iter_mut().for_each(Single::centre);
    }
}

impl Block {
    /// [`Cost::Slip`] leaves the normal row, which comes first, alone.
    #[inline(always)]
    fn first_row(&self) -> usize {
        usize::from(matches!(self.cost, Cost::Slip { .. }))
    }

    fn expect(&mut self, residual: &[f64]) {
        let mut expected = [0.0; MAX_ROWS];
        expected[..residual.len()].copy_from_slice(residual);
        self.expected = Some(expected);
    }

    #[inline(always)]
    fn store_force(&self, forces: &mut [f64]) {
        let first = self.first_row();
        let forces = &mut forces[self.row0..self.row0 + self.rows];
        forces[..first].fill(0.0);
        forces[first..].copy_from_slice(&self.response.force[..self.rows - first]);
    }
}
