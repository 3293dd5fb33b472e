//! Kernels on one branch. Rows are whole vectors of [`LANES`] numbers, `[root; own]`, and matrices row-major in such rows.

#![allow(clippy::needless_range_loop)] // small matrices are read by their indices, as in the formulas

use super::Block;
use crate::grasp::contact::cost::MAX_ROWS;
use crate::grasp::linalg::{LANES, Lanes, axpy_lanes, dot_lanes, dots_lanes};

/// Blocks and singles that share joints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    pub blocks: (usize, usize),
    pub singles: (usize, usize),
    pub row0: usize,
    pub rows: usize,
    /// Length of the root's part of each row.
    pub root: usize,
    /// Unknowns of its own.
    pub width: usize,
    /// The first of them, in whole vectors, whose inertia is the identity: nothing but rows couples them to the others or
    /// the root.
    pub free: usize,
    /// Length of `[root; own]`, filled up with zeros to a multiple of [`LANES`].
    pub stride: usize,
    /// Offset of `[Y X]`, one row of `stride` for each of the branch's.
    pub matrix: usize,
    /// Offset in the arrays that hold `[root; own]` of each branch.
    pub local: usize,
    /// Offset of its own rows of inertia and Hessian, `width` of `stride`.
    pub square: usize,
    /// Offset of their pivots.
    pub pivot: usize,
}

/// Does `$call` with a branch whose root and stride the compiler knows, so that the loops over its rows unroll.
macro_rules! unrolled {
    ($branch:ident => $call:expr) => {
        match ($branch.root, $branch.stride) {
            (8, 8) => unrolled!(8, 8, $branch => $call),
            (8, 12) => unrolled!(8, 12, $branch => $call),
            (8, 16) => unrolled!(8, 16, $branch => $call),
            (8, 20) => unrolled!(8, 20, $branch => $call),
            (12, 12) => unrolled!(12, 12, $branch => $call),
            (12, 16) => unrolled!(12, 16, $branch => $call),
            (12, 20) => unrolled!(12, 20, $branch => $call),
            (12, 24) => unrolled!(12, 24, $branch => $call),
            (12, 28) => unrolled!(12, 28, $branch => $call),
            _ => $call,
        }
    };
    ($root:literal, $stride:literal, $branch:ident => $call:expr) => {{
        let $branch = Branch { root: $root, stride: $stride, ..$branch };
        $call
    }};
}
pub(super) use unrolled;

impl Branch {
    /// Row `i` of the branch's `[Y X]`.
    #[inline(always)]
    pub fn row<'a>(&self, matrix: &'a [f64], i: usize) -> &'a [f64] {
        let start = self.matrix + i * self.stride;
        &matrix[start..start + self.stride]
    }

    /// All of them.
    #[inline(always)]
    pub fn rows<'a>(&self, matrix: &'a [f64]) -> std::slice::ChunksExact<'a, f64> {
        matrix[self.matrix..self.matrix + self.rows * self.stride].chunks_exact(self.stride)
    }

    /// Calls `row` with `[Y X] x` of each row, `x` being the branch's in `vector`.
    #[inline(always)]
    pub fn apply(&self, matrix: &[f64], vector: &[f64], mut row: impl FnMut(usize, f64)) {
        let x = &vector[self.local..self.local + self.stride];
        let mut i = 0;
        while i + 4 <= self.rows {
            let four = [self.row(matrix, i), self.row(matrix, i + 1), self.row(matrix, i + 2), self.row(matrix, i + 3)];
            for (k, moved) in dots_lanes(four, x).into_iter().enumerate() {
                row(i + k, moved);
            }
            i += 4;
        }
        for i in i..self.rows {
            row(i, dot_lanes(self.row(matrix, i), x));
        }
    }

    /// The branch's rows of a square array, from `first` on.
    #[inline(always)]
    fn own_rows<'a>(&self, square: &'a [f64], first: usize) -> std::slice::ChunksExact<'a, f64> {
        square[self.square + first * self.stride..self.square + self.width * self.stride].chunks_exact(self.stride)
    }

    /// `[N' d; N z + M d]` of the inertia's rows and `[z; d]`.
    #[inline(always)]
    pub fn momentum(&self, inertia: &[f64], point: &[f64], out: &mut [f64]) {
        let coupled = self.root + self.free;
        out.fill(0.0);
        out[self.root..coupled].copy_from_slice(&point[self.root..coupled]);
        for (j, row) in (coupled..).zip(self.own_rows(inertia, self.free)) {
            out[j] = dot_lanes(row, point);
            axpy_lanes(point[j], &row[..self.root], &mut out[..self.root]);
        }
    }

    /// Factors a branch's own rows `[B H]`, lower triangle, the last unknown first: `H = L' D L`, as the engine factors its
    /// mass matrix, so that all rows are read from their beginning. Leaves rows of `[D^-1 L^-T B, L - 1]` and the inverse
    /// pivots, and subtracts `B' H^-1 B` from the root's lower triangle. The first `free` rows are the identity's.
    #[inline(always)]
    pub fn factorize(&self, own: &mut [f64], pivots: &mut [f64], root: &mut [f64], free: usize) {
        let stride = self.stride;
        let (unit, own) = own.split_at_mut(free * stride);
        unit.fill(0.0);
        pivots[..free].fill(1.0);
        for j in (free..self.width).rev() {
            let (above, rest) = own.split_at_mut((j - free) * stride);
            let row = &mut rest[..stride];
            let inverse = 1.0 / row[self.root + j].max(f64::MIN_POSITIVE);
            pivots[j] = inverse;
            row[self.root + j..].fill(0.0);
            for (i, above) in above.chunks_exact_mut(stride).enumerate() {
                let x = row[self.root + free + i];
                if x != 0.0 {
                    axpy_lanes(-x * inverse, row, above);
                }
            }
            for i in 0..self.root {
                let out = &mut root[i * self.root..(i + 1) * self.root];
                axpy_lanes(-row[i] * inverse, &row[..lower(i)], out);
            }
            row.iter_mut().for_each(|x| *x *= inverse);
        }
    }

    /// What `[y; x]` of a right-hand side is once the own unknowns are eliminated: `y - B' H^-1 x`, and `L^-T x`. The factor's
    /// first `free` rows are the identity's.
    #[inline(always)]
    pub fn sweep(&self, factor: &[f64], vector: &mut [f64], free: usize) {
        for (j, row) in self.own_rows(factor, free).enumerate().rev() {
            let x = vector[self.root + free + j];
            if x != 0.0 {
                // a row of the factor ends before its own unknown
                axpy_lanes(-x, row, vector);
            }
        }
    }

    /// `J M^-1 J'` of the row that is in `vector`, which is used up.
    #[inline(always)]
    pub fn mobility(&self, factor: &[f64], pivots: &[f64], vector: &mut [f64]) -> f64 {
        self.sweep(factor, vector, self.free);
        let (root, own) = vector.split_at(self.root);
        let pivots = &pivots[self.pivot..self.pivot + self.width];
        dot_lanes(root, root) + own.iter().zip(pivots).map(|(x, inverse)| x * x * inverse).sum::<f64>()
    }

    /// `x <- D^-1 x` of the own unknowns.
    #[inline(always)]
    pub fn scale(&self, pivots: &[f64], vector: &mut [f64]) {
        let pivots = &pivots[self.pivot..self.pivot + self.width];
        for (x, inverse) in vector[self.root..].iter_mut().zip(pivots) {
            *x *= inverse;
        }
    }

    /// The own unknowns, where the root is what it is in `[z; x]`: `x <- L^-1 x - H^-1 B z`. The factor's first
    /// `free` rows are the identity's.
    #[inline(always)]
    pub fn back(&self, factor: &[f64], vector: &mut [f64], free: usize) {
        let factor = &factor[self.square + free * self.stride..self.square + self.width * self.stride];
        forward(factor, self.stride, self.root + free, self.width - free, vector);
    }

    /// Adds `J' C J` of one block to the lower triangle of the root's Hessian and the branch's own rows.
    #[inline(always)]
    pub fn add_block(&self, block: &Block, matrix: &[f64], stiff: &mut [f64], root: &mut [f64], own: &mut [f64]) {
        let first = block.first_row();
        let rows = block.rows - first;
        let start = self.matrix + (block.row0 + first - self.row0) * self.stride;
        let matrix = &matrix[start..start + rows * self.stride];
        for (i, out) in stiff[..rows * self.stride].chunks_exact_mut(self.stride).enumerate() {
            out.fill(0.0);
            for (k, row) in matrix.chunks_exact(self.stride).enumerate() {
                let c = block.response.hessian[i * MAX_ROWS + k];
                if c != 0.0 {
                    axpy_lanes(c, row, out);
                }
            }
        }
        let stiff = &stiff[..rows * self.stride];
        let (mut left, mut at) = (rows, 0);
        while left > 0 {
            // five are three and two, six twice three
            let take = if left > 4 { 3 } else { left };
            let (rows, stiff) = (&matrix[at * self.stride..], &stiff[at * self.stride..]);
            match take {
                4 => self.add_products::<4>(rows, stiff, root, own),
                3 => self.add_products::<3>(rows, stiff, root, own),
                2 => self.add_products::<2>(rows, stiff, root, own),
                _ => self.add_products::<1>(rows, stiff, root, own),
            }
            left -= take;
            at += take;
        }
    }

    /// Adds `sum row stiff'` of `D` rows.
    #[inline(always)]
    fn add_products<const D: usize>(&self, rows: &[f64], stiff: &[f64], root: &mut [f64], own: &mut [f64]) {
        let (stride, of_root) = (self.stride, self.root / LANES);
        let mut row: [&[f64]; D] = [&[]; D];
        let mut all: [&[Lanes]; D] = [&[]; D];
        let mut first: [&[Lanes]; D] = [&[]; D];
        for k in 0..D {
            row[k] = &rows[k * stride..(k + 1) * stride];
            all[k] = stiff[k * stride..(k + 1) * stride].as_chunks().0;
            first[k] = &all[k][..of_root];
        }
        let root = root[..self.root * self.root].as_chunks_mut().0;
        for (i, out) in root.chunks_exact_mut(of_root).enumerate() {
            let mut scale = [0.0; D];
            for k in 0..D {
                scale[k] = row[k][i];
            }
            add_rows(&scale, &first, &mut out[..lower(i) / LANES]);
        }
        let own = own[..self.width * stride].as_chunks_mut().0;
        for (j, out) in own.chunks_exact_mut(stride / LANES).enumerate() {
            let mut scale = [0.0; D];
            let mut moved = false;
            for k in 0..D {
                scale[k] = row[k][self.root + j];
                moved |= scale[k] != 0.0;
            }
            // a link knows nothing of the joints beyond it
            if moved {
                add_rows(&scale, &all, out);
            }
        }
    }
}

/// `x <- x - R y` row by row, where `y` are the `first` numbers of `vector` and what has been done of the `n` of `x` behind them:
/// row `j` of `rows` ends before its own number.
#[inline(always)]
pub(super) fn forward(rows: &[f64], stride: usize, first: usize, n: usize, vector: &mut [f64]) {
    for j in (0..n).step_by(LANES) {
        let (rows, done) = (&rows[j * stride..], first + j);
        match n - j {
            1 => forward_some::<1>(rows, stride, done, vector),
            2 => forward_some::<2>(rows, stride, done, vector),
            3 => forward_some::<3>(rows, stride, done, vector),
            _ => forward_some::<LANES>(rows, stride, done, vector),
        }
    }
}

/// [`forward`] of `D` rows. What has just been stored number by number cannot be loaded at once as a vector, so they are kept
/// apart until all of them are done.
#[inline(always)]
fn forward_some<const D: usize>(rows: &[f64], stride: usize, done: usize, vector: &mut [f64]) {
    let mut row: [&[f64]; D] = [&[]; D];
    for k in 0..D {
        row[k] = &rows[k * stride..(k + 1) * stride];
    }
    let (y, rest) = vector.split_at_mut(done);
    let moved = dots_lanes(row.map(|row| &row[..done]), y);
    let mut x = [0.0; D];
    x.copy_from_slice(&rest[..D]);
    for k in 0..D {
        let mut sum = moved[k];
        for i in 0..k {
            sum += row[k][done + i] * x[i];
        }
        x[k] -= sum;
    }
    rest[..D].copy_from_slice(&x);
}

/// How much of row `i` of a lower triangle there is, in whole vectors.
#[inline(always)]
pub(super) fn lower(i: usize) -> usize {
    (i / LANES + 1) * LANES
}

/// `out += sum scale_k rows_k`
#[inline(always)]
fn add_rows<const D: usize>(scale: &[f64; D], rows: &[&[Lanes]; D], out: &mut [Lanes]) {
    let mut row: [&[Lanes]; D] = [&[]; D];
    for k in 0..D {
        row[k] = &rows[k][..out.len()];
    }
    for c in 0..out.len() {
        let mut sum = out[c];
        for k in 0..D {
            for lane in 0..LANES {
                sum[lane] += scale[k] * row[k][c][lane];
            }
        }
        out[c] = sum;
    }
}
