//! What a solve of an [`Arrow`] spends its time in, compiled for each kind of processor.

use super::branch::{Branch, forward, lower, unrolled};
use super::{Arrow, ROOT, RootVector};
use crate::grasp::linalg::{axpy_lanes, dot_lanes};
use pulp::{Arch, Simd, WithSimd};

/// A tangent along which a contact moves by so much less than along the other is no measure of both.
const UNEQUAL: f64 = 1e-3;

/// What is compiled for each kind of processor, with the widest vectors that it has. No operation is contracted or reordered
/// for it: the result is the same on every processor. (Closures would not do: the compiler may call them instead of inlining
/// them, and then they are compiled for the least of them.)
struct Vectorized<'a> {
    arrow: &'a mut Arrow,
    kernel: Kernel<'a>,
}

pub(super) enum Kernel<'a> {
    FactorizeInertia(Branch),
    AbsorbStart,
    /// [`Arrow::start`], of the root in the first.
    Start(&'a RootVector),
    /// [`Arrow::momentum`], from the first into the second, and the cost into the third.
    Momentum(&'a RootVector, &'a mut RootVector, &'a mut f64),
    SubtractForces(&'a mut RootVector),
    Factorize,
    /// [`Arrow::backsolve`], from the first into the second.
    Backsolve(&'a RootVector, &'a mut RootVector),
}

impl WithSimd for Vectorized<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        match self.kernel {
            Kernel::FactorizeInertia(branch) => self.arrow.factor_inertia(branch),
            Kernel::AbsorbStart => {
                self.arrow.absorb();
                if !std::mem::replace(&mut self.arrow.mobile, true) {
                    self.arrow.mobilities();
                }
            }
            Kernel::Start(z) => self.arrow.start(z),
            Kernel::Momentum(z, root, cost) => self.arrow.momentum(z, root, cost),
            Kernel::SubtractForces(root) => self.arrow.subtract_forces(root),
            Kernel::Factorize => self.arrow.factorize(),
            Kernel::Backsolve(gradient, step) => self.arrow.backsolve(gradient, step),
        }
    }
}

impl Arrow {
    pub(super) fn run(&mut self, kernel: Kernel<'_>) {
        Arch::new().dispatch(Vectorized { arrow: self, kernel });
    }

    /// Factors the inertia of a branch.
    pub(super) fn factorize_inertia(&mut self, branch: Branch) {
        self.run(Kernel::FactorizeInertia(branch));
    }

    /// Makes a part of the bias of what the starting forces move, and finds how easily rows move.
    pub(super) fn absorb_start(&mut self) {
        self.run(Kernel::AbsorbStart);
    }

    #[inline(always)]
    fn factor_inertia(&mut self, branch: Branch) {
        let factor = &mut self.inertia_factor[branch.square..];
        let pivots = &mut self.inertia_pivots[branch.pivot..];
        unrolled!(branch => branch.factorize(factor, pivots, &mut self.coupling, branch.free));
    }

    #[inline(always)]
    fn absorb(&mut self) {
        let z = self.explain_start();
        self.set_root(&z);
        for branch in self.branches.iter().copied() {
            let bias = &mut self.bias[branch.row0..];
            unrolled!(branch => branch.apply(&self.matrix, &self.point, |i, moved| bias[i] += moved));
        }
        for s in &mut self.singles {
            s.bias += s.entry * self.point[s.at];
        }
    }

    /// The mobility of the second row of each block, or of the third where the second hardly moves beside it, or of its only row;
    /// and that of each single.
    #[inline(always)]
    fn mobilities(&mut self) {
        let Arrow { branches, blocks, singles, matrix, inertia_factor, inertia_pivots, row, .. } = self;
        for branch in branches.iter().copied() {
            unrolled!(branch => {
                let row = &mut row[..branch.stride];
                for b in &mut blocks[branch.blocks.0..branch.blocks.1] {
                    let mut of_row = |i: usize| {
                        row.copy_from_slice(branch.row(matrix, b.row0 - branch.row0 + i));
                        branch.mobility(inertia_factor, inertia_pivots, row)
                    };
                    let mobility = of_row(b.rows.min(2) - 1);
                    let other = if b.rows > 2 { of_row(2) } else { mobility };
                    b.mobility = if mobility > UNEQUAL * other { mobility } else { other };
                }
                for s in &mut singles[branch.singles.0..branch.singles.1] {
                    row.fill(0.0);
                    row[s.at - branch.local] = s.entry;
                    s.mobility = branch.mobility(inertia_factor, inertia_pivots, row);
                }
            });
        }
    }

    /// The point that the starting forces explain while the root rests, but for what [`set_root`](Self::set_root) adds; and
    /// the root that they explain.
    #[inline(always)]
    fn explain_start(&mut self) -> RootVector {
        let mut root = [0.0; ROOT];
        for branch in &self.branches {
            self.point[branch.local..branch.local + branch.stride].fill(0.0);
        }
        for s in &self.singles {
            self.point[s.at] += s.entry * s.start;
        }
        for branch in self.branches.iter().copied() {
            unrolled!(branch => {
                let point = &mut self.point[branch.local..branch.local + branch.stride];
                for (row, f) in branch.rows(&self.matrix).zip(&self.start[branch.row0..]) {
                    axpy_lanes(*f, row, point);
                }
                branch.sweep(&self.inertia_factor, point, branch.free);
                axpy_lanes(1.0, &point[..branch.root], &mut root[..branch.root]);
                branch.scale(&self.inertia_pivots, point);
            });
        }
        root
    }

    /// Sets the root of each branch's point, and moves its joints with it.
    #[inline(always)]
    fn set_root(&mut self, z: &RootVector) {
        for branch in self.branches.iter().copied() {
            unrolled!(branch => {
                let point = &mut self.point[branch.local..branch.local + branch.stride];
                point[..branch.root].copy_from_slice(&z[..branch.root]);
                branch.back(&self.inertia_factor, point, branch.free);
            });
        }
    }

    /// The point that the starting forces explain at the root `z`, and its residuals `jar = bias + Y z + X d`.
    #[inline(always)]
    fn start(&mut self, z: &RootVector) {
        self.explain_start();
        self.set_root(z);
        for branch in self.branches.iter().copied() {
            let (jar, bias) = (&mut self.jar[branch.row0..], &self.bias[branch.row0..]);
            unrolled!(branch => branch.apply(&self.matrix, &self.point, |i, moved| jar[i] = bias[i] + moved));
        }
        for s in &mut self.singles {
            s.jar = s.bias + s.entry * self.point[s.at];
        }
    }

    /// Inertial forces of the point, the root's in `root` and the branches' in `gradient`; and their cost.
    #[inline(always)]
    fn momentum(&mut self, z: &RootVector, root: &mut RootVector, cost: &mut f64) {
        let n = self.root;
        for (out, row) in root.iter_mut().zip(self.root_inertia[..n * n].chunks_exact(n)) {
            *out = dot_lanes(row, &z[..n]);
        }
        let mut own = 0.0;
        for branch in self.branches.iter().copied() {
            unrolled!(branch => {
                let local = branch.local..branch.local + branch.stride;
                let (point, out) = (&self.point[local.clone()], &mut self.gradient[local]);
                branch.momentum(&self.inertia[..], point, out);
                axpy_lanes(1.0, &out[..branch.root], &mut root[..branch.root]);
                out[..branch.root].fill(0.0);
                own += dot_lanes(&out[branch.root..], &point[branch.root..]);
            });
        }
        *cost = 0.5 * (own + dot_lanes(root, z));
    }

    /// From inertial forces to the gradient: `- Y' f`, `- X' f`.
    #[inline(always)]
    fn subtract_forces(&mut self, root: &mut RootVector) {
        for s in &self.singles {
            self.gradient[s.at] -= s.entry * s.force;
        }
        for branch in self.branches.iter().copied() {
            unrolled!(branch => {
                let local = &mut self.gradient[branch.local..branch.local + branch.stride];
                for (row, f) in branch.rows(&self.matrix).zip(&self.forces[branch.row0..]) {
                    if *f != 0.0 {
                        axpy_lanes(-f, row, local);
                    }
                }
                axpy_lanes(1.0, &local[..branch.root], &mut root[..branch.root]);
                local[..branch.root].fill(0.0);
            });
        }
    }

    /// Solves `H step = -gradient`; the root's part goes to `root`, the branches' to `step`, and what they change of the
    /// residuals to `slope`.
    #[inline(always)]
    fn backsolve(&mut self, gradient: &RootVector, root: &mut RootVector) {
        let n = self.root;
        root.iter_mut().zip(gradient).for_each(|(out, x)| *out = -x);
        for branch in self.branches.iter().copied() {
            unrolled!(branch => {
                let local = branch.local..branch.local + branch.stride;
                let step = &mut self.step[local.clone()];
                step.iter_mut().zip(&self.gradient[local]).for_each(|(out, x)| *out = -x);
                branch.sweep(&self.hessian.factor, step, 0);
                axpy_lanes(1.0, &step[..branch.root], &mut root[..branch.root]);
                branch.scale(&self.hessian.pivots, step);
            });
        }
        solve_root(n, &self.hessian.root_factor, &self.hessian.root_pivots, root);
        for branch in self.branches.iter().copied() {
            unrolled!(branch => {
                let step = &mut self.step[branch.local..branch.local + branch.stride];
                step[..branch.root].copy_from_slice(&root[..branch.root]);
                branch.back(&self.hessian.factor, step, 0);
                let slope = &mut self.slope[branch.row0..];
                branch.apply(&self.matrix, &self.step, |i, moved| slope[i] = moved);
            });
        }
        for s in &mut self.singles {
            s.slope = s.entry * self.step[s.at];
        }
    }

    /// Assembles and factors the Hessian, inertia and `[Y X]' C [Y X]`, where it is not that of before.
    #[inline(always)]
    fn factorize(&mut self) {
        let n = self.root;
        let mut renewed = false;
        let Arrow { hessian, inertia, branches, blocks, singles, matrix, stiff, .. } = self;
        for (k, branch) in branches.iter().copied().enumerate() {
            if !hessian.renews(k, &branch, blocks, singles) {
                continue;
            }
            renewed = true;
            let own = branch.square..branch.square + branch.width * branch.stride;
            hessian.factor[own.clone()].copy_from_slice(&inertia[own.clone()]);
            for s in &singles[branch.singles.0..branch.singles.1] {
                hessian.factor[s.diagonal] += s.entry * s.entry * s.curvature();
            }
            let eliminated = &mut hessian.eliminated[k];
            eliminated[..n * n].fill(0.0);
            unrolled!(branch => {
                let own = &mut hessian.factor[own];
                for b in &blocks[branch.blocks.0..branch.blocks.1] {
                    branch.add_block(b, matrix, stiff, eliminated, own);
                }
                branch.factorize(own, &mut hessian.pivots[branch.pivot..], eliminated, 0);
            });
        }
        if !renewed {
            return;
        }
        hessian.root_factor = self.root_inertia;
        for eliminated in &hessian.eliminated[..branches.len()] {
            axpy_lanes(1.0, &eliminated[..n * n], &mut hessian.root_factor[..n * n]);
        }
        match n {
            8 => factorize_root(8, &mut hessian.root_factor, &mut hessian.root_pivots),
            12 => factorize_root(12, &mut hessian.root_factor, &mut hessian.root_pivots),
            _ => factorize_root(n, &mut hessian.root_factor, &mut hessian.root_pivots),
        }
    }
}

/// Factors the root's Hessian, no less than the identity, as [`Branch::factorize`] does.
#[inline(always)]
fn factorize_root(n: usize, hessian: &mut [f64], pivots: &mut RootVector) {
    for j in (0..n).rev() {
        let (above, rest) = hessian.split_at_mut(j * n);
        let row = &mut rest[..n];
        let inverse = 1.0 / row[j];
        pivots[j] = inverse;
        row[j..].fill(0.0);
        for (i, above) in above.chunks_exact_mut(n).enumerate() {
            axpy_lanes(-row[i] * inverse, &row[..lower(i)], above);
        }
        row.iter_mut().for_each(|x| *x *= inverse);
    }
}

/// Solves `H x = b` in place.
#[inline(always)]
fn solve_root(n: usize, factor: &[f64], pivots: &RootVector, b: &mut RootVector) {
    for (j, row) in factor[..n * n].chunks_exact(n).enumerate().rev() {
        axpy_lanes(-b[j], row, &mut b[..n]);
    }
    for (b, inverse) in b[..n].iter_mut().zip(pivots) {
        *b *= inverse;
    }
    forward(&factor[..n * n], n, 0, n, b);
}
