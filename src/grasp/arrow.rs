//! Newton's method on the grasp problem, with the fingers eliminated.
//!
//! In whitened accelerations `z` (unit inertia, see [`super::whiten`]) the next motion minimises
//!
//! ```text
//! 1/2 |z - centre|^2 + sum_i s_i(bias_i + Y_i z)
//! ```
//!
//! over one *root* block (the target's six and the palm's few unknowns) and one small block for each finger.
//! A contact touches the root and at most one finger, so the Hessian is an arrow: each finger is eliminated by a
//! Cholesky factor of its own few joints, and what is left is a system in the root alone. The cost grows linearly
//! with the contacts; the root's size does not change.

use super::cone::{Law, MAX_ROWS, Response};
use super::dense;

/// Gradient norm, relative to the largest term in it, below which a point counts as the minimum.
const TOLERANCE: f64 = 1e-10;
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
    branch: Option<usize>,
    rows: usize,
    /// Offset of the first row in the arrays that hold one number per row.
    row0: usize,
    /// Offset of the rows' finger part (row-major, `rows` x finger size).
    finger0: usize,
    law: Law,
    response: Response,
}

#[derive(Clone, Copy, Debug)]
struct Branch {
    dim: usize,
    /// Offset in `z`.
    z0: usize,
    blocks: (usize, usize),
    rows: usize,
}

/// The problem and its workspace; buffers are kept from step to step, so that a warm solve allocates nothing.
#[derive(Clone, Debug, Default)]
pub struct Arrow {
    root: usize,
    size: usize,
    branches: Vec<Branch>,
    blocks: Vec<Block>,
    finger_rows: Vec<f64>,
    root_rows: Vec<f64>,
    bias: Vec<f64>,
    work: Work,
}

#[derive(Clone, Debug, Default)]
struct Work {
    jar: Vec<f64>,
    slope: Vec<f64>,
    gradient: Vec<f64>,
    step: Vec<f64>,
    hessian: Vec<f64>,
    factors: Vec<Factor>,
    coupled: Vec<f64>,
}

/// What eliminating one finger leaves for the back substitution.
#[derive(Clone, Debug, Default)]
struct Factor {
    cholesky: Vec<f64>,
    /// `L^-1 Y_f^T C`, finger size x rows of the branch.
    coupling: Vec<f64>,
    /// `L^-1 g_f`
    forward: Vec<f64>,
    /// `C - coupling^T coupling`, the stiffness that the root feels, rows x rows.
    stiffness: Vec<f64>,
}

/// The rows of a block that was just added, to be filled in.
pub struct RowsMut<'a> {
    /// Finger part, row-major, rows x finger size.
    pub finger: &'a mut [f64],
    /// Root part, row-major, rows x root size.
    pub root: &'a mut [f64],
    /// Residual at `z = 0`.
    pub bias: &'a mut [f64],
}

impl RowsMut<'_> {
    /// `|Y_i|^2`: how easily row `i` moves [1/kg].
    pub fn row_norm_squared(&self, i: usize) -> f64 {
        let part = |rows: &[f64]| {
            let size = rows.len() / self.bias.len();
            let row = &rows[i * size..(i + 1) * size];
            dense::dot(row, row)
        };
        part(self.finger) + part(self.root)
    }
}

impl Arrow {
    /// Starts a new problem with `root` shared unknowns.
    pub fn begin(&mut self, root: usize) {
        self.root = root;
        self.size = root;
        self.branches.clear();
        self.blocks.clear();
        self.finger_rows.clear();
        self.root_rows.clear();
        self.bias.clear();
        self.begin_branch(0);
    }

    /// Starts the next finger, of `dim` joints; blocks added from now on belong to it. Blocks that are added
    /// before the first call touch the root only. Returns the offset of the finger's unknowns in `z`.
    pub fn begin_branch(&mut self, dim: usize) -> usize {
        let z0 = self.size;
        self.size += dim;
        let block = self.blocks.len();
        self.branches.push(Branch {
            dim,
            z0,
            blocks: (block, block),
            rows: 0,
        });
        z0
    }

    /// Adds a contact of `rows` rows to the present finger; the rows are zero until they are filled in.
    pub fn add_block(&mut self, rows: usize, law: Law) -> RowsMut<'_> {
        let branch = self.branches.len() - 1;
        let dim = self.branches[branch].dim;
        let (row0, finger0) = (self.bias.len(), self.finger_rows.len());
        self.blocks.push(Block {
            branch: (dim > 0).then_some(branch),
            rows,
            row0,
            finger0,
            law,
            response: Response::open(),
        });
        self.branches[branch].blocks.1 += 1;
        self.branches[branch].rows += rows;
        self.bias.resize(row0 + rows, 0.0);
        self.finger_rows.resize(finger0 + rows * dim, 0.0);
        self.root_rows.resize((row0 + rows) * self.root, 0.0);
        RowsMut {
            finger: &mut self.finger_rows[finger0..],
            root: &mut self.root_rows[row0 * self.root..],
            bias: &mut self.bias[row0..],
        }
    }

    /// Number of unknowns: the root's, then each finger's.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.blocks.len()
    }

    /// The law of block `block`, to be changed between two solves of the same rows.
    pub fn law_mut(&mut self, block: usize) -> &mut Law {
        &mut self.blocks[block].law
    }

    /// What the law of block `block` answered at the solution.
    pub fn response(&self, block: usize) -> &Response {
        &self.blocks[block].response
    }

    /// The residual of block `block` at the solution.
    pub fn residual(&self, block: usize) -> &[f64] {
        let b = &self.blocks[block];
        &self.work.jar[b.row0..b.row0 + b.rows]
    }

    /// Adds `Y^T force` of block `block` to `out`.
    pub fn add_transposed(&self, block: usize, force: &[f64], out: &mut [f64]) {
        let b = &self.blocks[block];
        let rows = b.first_row()..b.rows;
        for (i, &f) in rows.zip(force) {
            if f != 0.0 {
                dense::axpy(f, self.root_row(b, i), &mut out[..self.root]);
                if let Some(branch) = b.branch {
                    let Branch { dim, z0, .. } = self.branches[branch];
                    dense::axpy(f, self.finger_row(b, dim, i), &mut out[z0..z0 + dim]);
                }
            }
        }
    }

    fn root_row(&self, b: &Block, i: usize) -> &[f64] {
        let start = (b.row0 + i) * self.root;
        &self.root_rows[start..start + self.root]
    }

    fn finger_row(&self, b: &Block, dim: usize, i: usize) -> &[f64] {
        let start = b.finger0 + i * dim;
        &self.finger_rows[start..start + dim]
    }

    /// Minimises from the start `z` and leaves the solution there. `centre` is where the inertial term is zero
    /// (`None`: the origin).
    pub fn solve(&mut self, centre: Option<&[f64]>, z: &mut [f64]) -> Status {
        let mut work = std::mem::take(&mut self.work);
        let status = self.newton(&mut work, centre, z);
        self.work = work;
        status
    }

    fn newton(&mut self, work: &mut Work, centre: Option<&[f64]>, z: &mut [f64]) -> Status {
        let rows = self.bias.len();
        work.jar.clear();
        work.jar.extend_from_slice(&self.bias);
        work.slope.resize(rows, 0.0);
        work.step.resize(self.size, 0.0);
        work.gradient.resize(self.size, 0.0);
        self.apply(z, &mut work.slope);
        for (jar, v) in work.jar.iter_mut().zip(&work.slope) {
            *jar += v;
        }
        let (mut cost, _) = self.respond(&work.jar);
        cost += inertial_cost(z, centre);

        for iterations in 0..MAX_ITERATIONS {
            let scale = self.gradient(z, centre, &mut work.gradient);
            if dense::norm(&work.gradient) <= TOLERANCE * scale {
                return Status { iterations, converged: true };
            }
            self.newton_step(work);
            self.apply(&work.step, &mut work.slope);
            let decrease = dense::dot(&work.gradient, &work.step);
            let slack = 1e-14 * cost.abs();

            let mut length = 1.0;
            let mut accepted = None;
            for _ in 0..MAX_HALVINGS {
                let zones_kept = self.respond_along(&mut work.jar, &work.slope, length);
                let trial = zones_kept.0 + inertial_cost_along(z, &work.step, length, centre);
                if trial <= cost + ARMIJO * length * decrease + slack {
                    accepted = Some((trial, zones_kept.1));
                    break;
                }
                for (jar, v) in work.jar.iter_mut().zip(&work.slope) {
                    *jar -= length * v;
                }
                length *= 0.5;
            }
            let Some((trial, affine)) = accepted else {
                // no descent left at this precision: `jar` is that of `z` again
                self.respond(&work.jar);
                let converged = dense::norm(&work.gradient) <= 1e-6 * scale;
                return Status { iterations, converged };
            };
            cost = trial;
            dense::axpy(length, &work.step, z);
            if affine && length == 1.0 {
                // Newton is exact on an affine piece
                return Status { iterations: iterations + 1, converged: true };
            }
        }
        Status { iterations: MAX_ITERATIONS, converged: false }
    }

    /// `Y z`, the law's rows only.
    fn apply(&self, z: &[f64], out: &mut [f64]) {
        for b in &self.blocks {
            for i in 0..b.rows {
                let mut v = dense::dot(self.root_row(b, i), &z[..self.root]);
                if let Some(branch) = b.branch {
                    let Branch { dim, z0, .. } = self.branches[branch];
                    v += dense::dot(self.finger_row(b, dim, i), &z[z0..z0 + dim]);
                }
                out[b.row0 + i] = v;
            }
        }
    }

    /// Evaluates every law; returns the summed cost and whether all zones are those of before and affine.
    fn respond(&mut self, jar: &[f64]) -> (f64, bool) {
        let (mut cost, mut affine) = (0.0, true);
        for b in &mut self.blocks {
            let before = b.response.zone;
            b.response = b.law.respond(&jar[b.row0 + b.first_row()..b.row0 + b.rows]);
            affine &= b.response.zone == before && before.is_affine();
            cost += b.response.cost;
        }
        (cost, affine)
    }

    fn respond_along(&mut self, jar: &mut [f64], slope: &[f64], length: f64) -> (f64, bool) {
        for (jar, v) in jar.iter_mut().zip(slope) {
            *jar += length * v;
        }
        self.respond(jar)
    }

    /// Gradient at `z`; returns the size of its largest terms, against which it is judged.
    fn gradient(&self, z: &[f64], centre: Option<&[f64]>, gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        for (k, b) in self.blocks.iter().enumerate() {
            if b.response.zone != super::cone::Zone::Open {
                self.add_transposed(k, &b.response.force, gradient);
            }
        }
        let scale = dense::norm(gradient);
        for (i, g) in gradient.iter_mut().enumerate() {
            *g = z[i] - centre.map_or(0.0, |c| c[i]) - *g;
        }
        scale.max(dense::norm(z)).max(f64::MIN_POSITIVE)
    }

    /// Solves `H step = -gradient` by eliminating the fingers.
    fn newton_step(&self, work: &mut Work) {
        let root = self.root;
        work.hessian.clear();
        work.hessian.resize(root * root, 0.0);
        for i in 0..root {
            work.hessian[i * root + i] = 1.0;
            work.step[i] = -work.gradient[i];
        }
        if work.factors.len() < self.branches.len() {
            work.factors.resize(self.branches.len(), Factor::default());
        }
        for (branch, factor) in self.branches.iter().zip(&mut work.factors) {
            if branch.rows > 0 {
                self.eliminate(branch, &work.gradient, factor);
                self.add_to_root(branch, factor, &mut work.coupled, &mut work.hessian, &mut work.step);
            }
        }
        // the root's Hessian is at least the identity
        dense::cholesky(&mut work.hessian, root);
        dense::solve_lower(&work.hessian, root, &mut work.step[..root]);
        dense::solve_upper(&work.hessian, root, &mut work.step[..root]);
        for (branch, factor) in self.branches.iter().zip(&work.factors) {
            self.substitute(branch, factor, &work.gradient, &mut work.coupled, &mut work.step);
        }
    }

    /// Factors one finger's block `I + Y_f^T C Y_f` and forms the stiffness that is left for the root.
    fn eliminate(&self, branch: &Branch, gradient: &[f64], factor: &mut Factor) {
        let (dim, m) = (branch.dim, branch.rows);
        let blocks = &self.blocks[branch.blocks.0..branch.blocks.1];
        let base = blocks[0].row0;
        factor.stiffness.clear();
        factor.stiffness.resize(m * m, 0.0);
        factor.coupling.clear();
        factor.coupling.resize(dim * m, 0.0);
        factor.cholesky.clear();
        factor.cholesky.resize(dim * dim, 0.0);
        factor.forward.clear();
        factor.forward.extend_from_slice(&gradient[branch.z0..branch.z0 + dim]);
        for j in 0..dim {
            factor.cholesky[j * dim + j] = 1.0;
        }
        for b in blocks {
            let (at, first) = (b.row0 - base, b.first_row());
            for i in first..b.rows {
                for k in first..b.rows {
                    let c = b.response.hessian[(i - first) * MAX_ROWS + (k - first)];
                    factor.stiffness[(at + i) * m + at + k] = c;
                    if c != 0.0 {
                        let row = self.finger_row(b, dim, k);
                        for j in 0..dim {
                            factor.coupling[j * m + at + i] += c * row[j];
                        }
                    }
                }
            }
            for i in first..b.rows {
                let row = self.finger_row(b, dim, i);
                for j in 0..dim {
                    let c = factor.coupling[j * m + at + i];
                    dense::axpy(c, &row[..=j], &mut factor.cholesky[j * dim..j * dim + j + 1]);
                }
            }
        }
        if dim == 0 {
            return;
        }
        // at least the identity: the factor exists
        dense::cholesky(&mut factor.cholesky, dim);
        dense::solve_lower(&factor.cholesky, dim, &mut factor.forward);
        dense::solve_lower_many(&factor.cholesky, dim, &mut factor.coupling, m);
        for j in 0..dim {
            let (row, stiffness) = (&factor.coupling[j * m..(j + 1) * m], &mut factor.stiffness);
            for i in 0..m {
                dense::axpy(-row[i], row, &mut stiffness[i * m..(i + 1) * m]);
            }
        }
    }

    /// `H_root += Y_r^T k Y_r` and the finger's share of the right-hand side.
    fn add_to_root(&self, branch: &Branch, factor: &Factor, coupled: &mut Vec<f64>, hessian: &mut [f64], rhs: &mut [f64]) {
        let (root, m) = (self.root, branch.rows);
        let row0 = self.blocks[branch.blocks.0].row0;
        let rows = &self.root_rows[row0 * root..(row0 + m) * root];
        coupled.clear();
        coupled.resize(root, 0.0);
        for i in 0..m {
            coupled.fill(0.0);
            for k in 0..m {
                let c = factor.stiffness[i * m + k];
                if c != 0.0 {
                    dense::axpy(c, &rows[k * root..(k + 1) * root], coupled);
                }
            }
            let row = &rows[i * root..(i + 1) * root];
            for a in 0..root {
                dense::axpy(row[a], &coupled[..=a], &mut hessian[a * root..a * root + a + 1]);
            }
            let pull: f64 = (0..branch.dim).map(|j| factor.coupling[j * m + i] * factor.forward[j]).sum();
            dense::axpy(pull, row, &mut rhs[..root]);
        }
    }

    /// The finger's step once the root's is known.
    fn substitute(&self, branch: &Branch, factor: &Factor, gradient: &[f64], coupled: &mut Vec<f64>, step: &mut [f64]) {
        let (dim, m) = (branch.dim, branch.rows);
        if m == 0 {
            for j in branch.z0..branch.z0 + dim {
                step[j] = -gradient[j];
            }
            return;
        }
        let row0 = self.blocks[branch.blocks.0].row0;
        coupled.clear();
        coupled.resize(dim, 0.0);
        coupled.copy_from_slice(&factor.forward);
        for i in 0..m {
            let start = (row0 + i) * self.root;
            let moved = dense::dot(&self.root_rows[start..start + self.root], &step[..self.root]);
            for j in 0..dim {
                coupled[j] += factor.coupling[j * m + i] * moved;
            }
        }
        dense::solve_upper(&factor.cholesky, dim, coupled);
        for j in 0..dim {
            step[branch.z0 + j] = -coupled[j];
        }
    }
}

impl Block {
    /// [`Law::Slip`] leaves the normal row, which comes first, alone.
    fn first_row(&self) -> usize {
        usize::from(matches!(self.law, Law::Slip { .. }))
    }
}

fn inertial_cost(z: &[f64], centre: Option<&[f64]>) -> f64 {
    inertial_cost_along(z, z, 0.0, centre)
}

fn inertial_cost_along(z: &[f64], step: &[f64], length: f64, centre: Option<&[f64]>) -> f64 {
    let mut cost = 0.0;
    for i in 0..z.len() {
        let off = z[i] + length * step[i] - centre.map_or(0.0, |c| c[i]);
        cost += off * off;
    }
    0.5 * cost
}
