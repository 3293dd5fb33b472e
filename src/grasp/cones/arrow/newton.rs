//! Newton's method with a line search on an [`Arrow`], its branches eliminated one by one.

use super::branch::Branch;
use super::kernels::Kernel;
use super::single::Single;
use super::{Arrow, ROOT, RootVector, Status};
use crate::grasp::contact::cost::MAX_ROWS;
use crate::grasp::linalg::{self, axpy_lanes, dot_lanes};

/// Gradient norm, relative to that of the inertial forces and in the metric of the inverse inertia, below which a point counts
/// as the minimum.
const TOLERANCE: f64 = 1e-6;
/// Newton iterations before giving up. Warm-started steps take one or two; while many contacts begin and cease to slide, some
/// tens. Giving up is dear: one step of unsolved friction puts the target up to millimetres off.
const MAX_ITERATIONS: usize = 1000;
/// Share of the cost below which a decrease is rounding: if the gradient does not halve either, there is no descent left at this
/// precision.
const PRECISION: f64 = 1e-14;

impl Arrow {
    /// Minimises from the start `z` and leaves the solution there.
    ///
    /// The first step takes every contact to be where it is expected on its cone. If it ends there and no contact
    /// slides, that step was the whole solve. It leads to the same point from every start, unless a contact is expected to slide
    /// and nobody has said [at which residual](Arrow::expect).
    pub fn solve(&mut self, z: &mut RootVector) -> Status {
        let (rows, local, square) = (self.bias.len(), self.point.len(), self.inertia.len());
        for buffer in [&mut self.jar, &mut self.slope, &mut self.forces] {
            buffer.resize(rows, 0.0);
        }
        for buffer in [&mut self.gradient, &mut self.step] {
            buffer.resize(local, 0.0);
        }
        self.hessian.fit([square, self.inertia_pivots.len(), self.branches.len(), self.used, self.singles.len()]);
        let widest = self.branches.iter().map(|b| b.stride).max().unwrap_or(0);
        self.stiff.resize(self.stiff.len().max(MAX_ROWS * widest), 0.0);
        self.row.resize(self.row.len().max(widest), 0.0);
        self.minimise(z)
    }

    /// Minimises, all buffers being large enough.
    fn minimise(&mut self, z: &mut RootVector) -> Status {
        self.hold_joints();
        let mut gradient = if self.first_step_is_of_one_tangent() {
            z.fill(0.0);
            self.start_at_rest();
            [0.0; ROOT]
        } else {
            self.run(Kernel::Start(z));
            self.inertial_forces(z).0
        };
        self.take_expected();
        self.run(Kernel::SubtractForces(&mut gradient));
        let step = self.newton_step(&gradient);
        self.advance(1.0, &step, z);
        let (costs, affine) = self.respond();
        if affine {
            return Status { iterations: 1, converged: true };
        }
        let (mut gradient, mut inertial) = self.inertial_forces(z);
        let mut cost = costs + inertial;
        let mut before = f64::INFINITY;
        for iterations in 1..MAX_ITERATIONS {
            self.run(Kernel::SubtractForces(&mut gradient));
            let size = self.gradient_norm(&gradient);
            if size <= TOLERANCE * (2.0 * inertial).sqrt().max(f64::MIN_POSITIVE) {
                return Status { iterations, converged: true };
            }
            let step = self.newton_step(&gradient);
            let decrease = -self.along_step(&gradient, &step);
            if decrease <= PRECISION * cost.abs() && size > 0.5 * before {
                return Status { iterations, converged: false };
            }
            before = size;
            let found = self.search(decrease, &step, z);
            if found.exact {
                return Status { iterations: iterations + 1, converged: true };
            }
            (gradient, inertial, cost) = (found.momentum, found.inertial, found.cost);
        }
        Status { iterations: MAX_ITERATIONS, converged: false }
    }

    /// Whether the point to which the first step leads is the same from wherever it starts.
    fn first_step_is_of_one_tangent(&self) -> bool {
        self.blocks[..self.used].iter().all(|b| b.expected.is_some() || b.response.active_set.is_affine())
    }

    /// The point at which nothing but the bias moves, and its gradient without the costs.
    fn start_at_rest(&mut self) {
        self.point.fill(0.0);
        self.gradient.fill(0.0);
        self.jar.copy_from_slice(&self.bias);
        self.singles.iter_mut().for_each(|s| s.jar = s.bias);
    }

    /// Inertial forces of the point, the root's returned and the branches' in `gradient`; and their cost.
    pub(super) fn inertial_forces(&mut self, z: &RootVector) -> (RootVector, f64) {
        let (mut root, mut cost) = ([0.0; ROOT], 0.0);
        self.run(Kernel::Momentum(z, &mut root, &mut cost));
        (root, cost)
    }

    /// The root's part of Newton's step; the branches' are in `step`, and what they change of the residuals in `slope`.
    fn newton_step(&mut self, gradient: &RootVector) -> RootVector {
        self.run(Kernel::Factorize);
        let mut step = [0.0; ROOT];
        self.run(Kernel::Backsolve(gradient, &mut step));
        step
    }

    /// The root's inertia with the joints of all branches held.
    fn hold_joints(&mut self) {
        let n = self.root;
        for i in 0..n {
            for j in 0..=i {
                let held = -self.coupling[i * n + j];
                self.root_inertia[i * n + j] = held;
                self.root_inertia[j * n + i] = held;
            }
            self.root_inertia[i * n + i] += 1.0;
        }
    }

    /// Forces and second derivatives if each cost is in the active set that is expected.
    fn take_expected(&mut self) {
        for b in &mut self.blocks[..self.used] {
            let active_set = b.response.active_set;
            let jar = &self.jar[b.row0 + b.first_row()..b.row0 + b.rows];
            match &b.expected {
                Some(expected) => b.cost.respond_near(jar, &expected[..jar.len()], &mut b.response),
                None => b.cost.respond_in(jar, active_set, &mut b.response),
            }
            b.store_force(&mut self.forces);
        }
        self.singles.iter_mut().for_each(Single::respond_in);
    }

    /// Evaluates every cost; returns the summed cost and whether all active sets are those of the Hessian and affine.
    pub(super) fn respond(&mut self) -> (f64, bool) {
        let (mut cost, mut affine) = (0.0, true);
        for (i, b) in self.blocks[..self.used].iter_mut().enumerate() {
            b.cost.respond_into(&self.jar[b.row0 + b.first_row()..b.row0 + b.rows], &mut b.response);
            b.store_force(&mut self.forces);
            affine &= self.hessian.is_of(i, b.response.active_set);
            cost += b.response.cost;
        }
        for (i, s) in self.singles.iter_mut().enumerate() {
            cost += s.respond();
            affine &= self.hessian.is_of_side(i, s.side());
        }
        (cost, affine)
    }

    /// Moves `z`, `d` and the residuals along the Newton step.
    pub(super) fn advance(&mut self, length: f64, step: &RootVector, z: &mut RootVector) {
        axpy_lanes(length, step, z);
        axpy_lanes(length, &self.step, &mut self.point);
        linalg::axpy(length, &self.slope, &mut self.jar);
        for s in &mut self.singles {
            s.jar += length * s.slope;
        }
    }

    /// The gradient's norm in the metric of the inverse inertia.
    fn gradient_norm(&mut self, gradient: &RootVector) -> f64 {
        let mut root = *gradient;
        let mut sum = 0.0;
        for branch in &self.branches {
            let row = &mut self.row[..branch.stride];
            row.copy_from_slice(&self.gradient[branch.local..branch.local + branch.stride]);
            sum += branch.mobility(&self.inertia_factor, &self.inertia_pivots, row);
            let of_root = &row[..branch.root];
            sum -= dot_lanes(of_root, of_root);
            axpy_lanes(1.0, of_root, &mut root[..branch.root]);
        }
        (sum + dot_lanes(&root, &root)).sqrt()
    }

    /// What the cost falls by per unit of the Newton step.
    pub(super) fn along_step(&self, gradient: &RootVector, step: &RootVector) -> f64 {
        let own = |b: &Branch| b.local + b.root..b.local + b.stride;
        let of_branch = |b: &Branch| dot_lanes(&self.gradient[own(b)], &self.step[own(b)]);
        dot_lanes(gradient, step) + self.branches.iter().map(of_branch).sum::<f64>()
    }
}
