//! Inverse kinematics: fingertip sites to goal points, by damped least squares over the hand's own joints.
//!
//! For the points `p(q)` of the tips and their goals `g`, each iteration solves
//! `(J^T J + lambda^2 I) dq = J^T (g - p)`, J the stacked 3 x n point Jacobians, over the joints that are not held by a
//! limit; a joint that would pass its limit is set on it and the rest is solved again (active set). The damping lambda
//! follows Levenberg and Marquardt: smaller after a step that came closer, larger after one that did not, which is
//! taken back. Tips that share no joint are solved apart.
//!
//! The chains are copied from the model once. A solve needs nothing of the engine but the palm's pose, disturbs no
//! simulation, and allocates nothing.

mod chain;

use nalgebra::{Isometry3, Vector3};

use crate::mujoco::{self, BodyId, JointId, Simulation, SiteId};
use chain::Chain;

/// Tips closer than this to their goals have arrived \[m\].
const TOLERANCE: f64 = 1e-7;
/// A step smaller than this changes nothing any more \[rad or m\].
const SMALLEST_STEP: f64 = 1e-9;
/// Largest change of a joint in one iteration \[rad or m\]: the linearization holds for no more.
const LARGEST_STEP: f64 = 0.3;
/// An accepted step that lowers the cost by less than this share ends a solve: the goals are out of reach.
const SMALLEST_GAIN: f64 = 1e-9;
/// Iterations of one solve.
const ITERATIONS: usize = 40;
/// lambda^2 over the mean diagonal of J^T J, to begin with.
const DAMPING: f64 = 1e-4;
/// Bounds of the same.
const DAMPING_RANGE: (f64, f64) = (1e-9, 1e6);

/// What can be wrong with a set of tips.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A site does not hang on the hand.
    #[error("the site \"{site}\" is not on a body below the palm \"{palm}\"; give a site on a link of the hand")]
    NotBelow {
        /// The site.
        site: String,
        /// The palm.
        palm: String,
    },
    /// Nothing can move a tip.
    #[error(
        "no joint between the palm \"{palm}\" and the site \"{site}\" can be driven; give the joints position actuators"
    )]
    NoJoint {
        /// The site.
        site: String,
        /// The palm.
        palm: String,
    },
    /// A joint that is not scalar.
    #[error(
        "the joint \"{joint}\" between palm and fingertip is a ball or free joint; inverse kinematics moves hinges and slides"
    )]
    Joint {
        /// The joint.
        joint: String,
    },
}

/// How well a solve came out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Largest distance between a tip and its goal \[m\].
    pub residual: f64,
    /// Most iterations that any group of tips took.
    pub iterations: usize,
}

/// Solver for a fixed set of tips; keeps its last solution and starts the next solve from it.
#[derive(Clone, Debug)]
pub struct InverseKinematics {
    groups: Vec<Group>,
    /// Joints that the solve may move, in order of groups.
    joints: Vec<JointId>,
    tips: usize,
}

/// Tips that share joints, with the buffers of their solve.
#[derive(Clone, Debug)]
struct Group {
    chain: Chain,
    /// Which of the caller's tips these are.
    tips: Vec<usize>,
    /// Joint values of the last accepted step, in the chain's order of joints.
    q: Vec<f64>,
    trial: Vec<f64>,
    error: Vec<Vector3<f64>>,
    gradient: Vec<f64>,
    hessian: Vec<f64>,
    work: Vec<f64>,
    step: Vec<f64>,
    fixed: Vec<bool>,
}

impl InverseKinematics {
    /// Tips at `sites`, moved by those of `joints` that lie between `palm` and a tip; every other joint stays as it is
    /// in `sim` at the time of [`Self::start_from`].
    ///
    /// # Errors
    /// [`Error`]: a site that is not below the palm, a tip that nothing moves, a ball joint on the way.
    pub fn new(sim: &Simulation, palm: BodyId, sites: &[SiteId], joints: &[JointId]) -> Result<Self, Error> {
        let mut groups: Vec<(Vec<usize>, Vec<JointId>)> = Vec::new();
        for (tip, &site) in sites.iter().enumerate() {
            let mut tips = vec![tip];
            let mut moved = chain::joints_between(sim, palm, site)?;
            moved.retain(|joint| joints.contains(joint));
            if moved.is_empty() {
                return Err(Error::NoJoint { site: chain::site_name(sim, site), palm: chain::body_name(sim, palm) });
            }
            // Groups that share a joint with this tip become one with it.
            let joined: Vec<_> = groups.extract_if(.., |(_, other)| other.iter().any(|j| moved.contains(j))).collect();
            for (other_tips, other_joints) in joined {
                tips.extend(other_tips);
                moved.extend(other_joints);
            }
            tips.sort_unstable();
            moved.sort_unstable();
            moved.dedup();
            groups.push((tips, moved));
        }
        let groups: Vec<Group> = groups
            .into_iter()
            .map(|(tips, moved)| {
                let own: Vec<SiteId> = tips.iter().map(|&t| sites[t]).collect();
                Ok(Group::new(Chain::new(sim, palm, &own, &moved)?, tips))
            })
            .collect::<Result<_, Error>>()?;
        let joints = groups.iter().flat_map(|g| g.chain.free_joints()).collect();
        let mut ik = Self { groups, joints, tips: sites.len() };
        ik.start_from(sim);
        Ok(ik)
    }

    /// The joints that a solve moves, in the order of [`Self::values`].
    pub fn joints(&self) -> &[JointId] {
        &self.joints
    }

    /// Values of [`Self::joints`] in the last solution \[rad or m\].
    pub fn values(&self) -> impl Iterator<Item = f64> + '_ {
        self.groups.iter().flat_map(|g| g.chain.free().map(|j| g.q[j]))
    }

    /// Starts from the joints of `sim`; also takes over the joints that a solve does not move.
    pub fn start_from(&mut self, sim: &Simulation) {
        for group in &mut self.groups {
            group.chain.read(sim, &mut group.q);
        }
    }

    /// Starts from `value(joint)` \[rad or m\], moved into the joint's limits, for each joint that a solve moves.
    pub fn start_at(&mut self, value: impl Fn(JointId) -> f64) {
        for group in &mut self.groups {
            for j in group.chain.free() {
                let joint = &group.chain.joints[j];
                group.q[j] = value(joint.id).clamp(joint.lower, joint.upper);
            }
        }
    }

    /// Writes where the tips are in the last solution, in the palm's frame \[m\], in the order of the sites.
    pub fn tips(&mut self, points: &mut [Vector3<f64>]) {
        for group in &mut self.groups {
            group.chain.forward(&group.q);
            for (tip, &index) in group.tips.iter().enumerate() {
                if let Some(point) = points.get_mut(index) {
                    *point = group.chain.point(tip);
                }
            }
        }
    }

    /// Moves the tips to `goals`, points in the world \[m\] in the order of the sites, given the palm's pose in the world.
    /// Starts from the last solution. Goals out of reach give the nearest points that damping allows.
    ///
    /// # Errors
    /// A number of goals that is not that of the sites.
    pub fn solve(&mut self, palm: &Isometry3<f64>, goals: &[Vector3<f64>]) -> Result<Solution, mujoco::Error> {
        if goals.len() != self.tips {
            let what = "the list of goals for inverse kinematics";
            return Err(mujoco::Error::Length { what, expected: self.tips, got: goals.len() });
        }
        let mut solution = Solution { residual: 0.0, iterations: 0 };
        for group in &mut self.groups {
            let (residual, iterations) = group.solve(palm, goals);
            solution.residual = solution.residual.max(residual);
            solution.iterations = solution.iterations.max(iterations);
        }
        Ok(solution)
    }
}

impl Group {
    fn new(chain: Chain, tips: Vec<usize>) -> Self {
        let (n, m) = (chain.joints.len(), tips.len());
        Self {
            chain,
            tips,
            q: vec![0.0; n],
            trial: vec![0.0; n],
            error: vec![Vector3::zeros(); m],
            gradient: vec![0.0; n],
            hessian: vec![0.0; n * n],
            work: vec![0.0; n * n],
            step: vec![0.0; n],
            fixed: vec![false; n],
        }
    }

    /// Returns the largest distance to a goal and the number of iterations.
    fn solve(&mut self, palm: &Isometry3<f64>, goals: &[Vector3<f64>]) -> (f64, usize) {
        let mut damping = DAMPING;
        self.chain.forward(&self.q);
        let mut cost = self.measure(palm, goals);
        let mut iterations = 0;
        while iterations < ITERATIONS && self.residual() > TOLERANCE {
            iterations += 1;
            self.linearize();
            self.step(damping);
            let mut largest: f64 = 0.0;
            for j in 0..self.q.len() {
                self.trial[j] = self.q[j] + self.step[j];
                largest = largest.max(self.step[j].abs());
            }
            if largest < SMALLEST_STEP {
                break;
            }
            self.chain.forward(&self.trial);
            let new_cost = self.measure(palm, goals);
            if new_cost < cost {
                std::mem::swap(&mut self.q, &mut self.trial);
                let gain = cost - new_cost;
                cost = new_cost;
                if gain < SMALLEST_GAIN * cost {
                    break;
                }
                damping = (0.2 * damping).max(DAMPING_RANGE.0);
            } else {
                damping *= 10.0;
                self.chain.forward(&self.q);
                self.measure(palm, goals);
                if damping > DAMPING_RANGE.1 {
                    break;
                }
            }
        }
        (self.residual(), iterations)
    }

    /// Errors of the tips in the palm's frame, at the last forward pass; half the sum of squares.
    fn measure(&mut self, palm: &Isometry3<f64>, goals: &[Vector3<f64>]) -> f64 {
        let mut cost = 0.0;
        for (tip, &index) in self.tips.iter().enumerate() {
            let goal = palm.inverse_transform_point(&goals[index].into()).coords;
            self.error[tip] = goal - self.chain.point(tip);
            cost += 0.5 * self.error[tip].norm_squared();
        }
        cost
    }

    fn residual(&self) -> f64 {
        self.error.iter().map(|e| e.norm()).fold(0.0, f64::max)
    }

    /// J^T J and J^T e at the last forward pass.
    fn linearize(&mut self) {
        let n = self.q.len();
        self.hessian.fill(0.0);
        self.gradient.fill(0.0);
        for (tip, error) in self.error.iter().enumerate() {
            for &a in self.chain.path(tip) {
                let column = self.chain.column(tip, a);
                self.gradient[a] += column.dot(error);
                for &b in self.chain.path(tip) {
                    self.hessian[a * n + b] += column.dot(&self.chain.column(tip, b));
                }
            }
        }
    }

    /// The damped step within limits and within [`LARGEST_STEP`].
    fn step(&mut self, damping: f64) {
        let n = self.q.len();
        let free = self.chain.free().count().max(1) as f64;
        let trace: f64 = self.chain.free().map(|j| self.hessian[j * n + j]).sum();
        let shift = damping * (trace / free).max(1e-12);
        for (j, joint) in self.chain.joints.iter().enumerate() {
            let (q, g) = (self.q[j], self.gradient[j]);
            // On a limit and pushed against it: held there.
            self.fixed[j] = !joint.free || (q <= joint.lower && g < 0.0) || (q >= joint.upper && g > 0.0);
            self.step[j] = 0.0;
        }
        // Every pass but the last puts at least one more joint on its limit.
        for _ in 0..=n {
            self.solve_free(shift);
            let mut passed = false;
            for (j, joint) in self.chain.joints.iter().enumerate() {
                if !self.fixed[j] {
                    let bounded = (self.q[j] + self.step[j]).clamp(joint.lower, joint.upper) - self.q[j];
                    if bounded != self.step[j] && (bounded - self.step[j]).abs() > 1e-14 {
                        self.step[j] = bounded;
                        self.fixed[j] = true;
                        passed = true;
                    }
                }
            }
            if !passed {
                break;
            }
        }
        let largest = self.step.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
        if largest > LARGEST_STEP {
            let scale = LARGEST_STEP / largest;
            self.step.iter_mut().for_each(|s| *s *= scale);
        }
    }

    /// Solves for the joints that are not fixed, given the steps of those that are, by Cholesky in place.
    fn solve_free(&mut self, shift: f64) {
        let n = self.q.len();
        for a in 0..n {
            if self.fixed[a] {
                continue;
            }
            let mut right = self.gradient[a];
            for b in 0..n {
                if self.fixed[b] {
                    right -= self.hessian[a * n + b] * self.step[b];
                }
            }
            self.trial[a] = right;
        }
        for a in 0..n {
            for b in 0..=a {
                let coupled = !self.fixed[a] && !self.fixed[b];
                let h = if coupled { self.hessian[a * n + b] } else { 0.0 };
                let mut sum = h + if a != b {
                    0.0
                } else if self.fixed[a] {
                    1.0
                } else {
                    shift
                };
                for k in 0..b {
                    sum -= self.work[a * n + k] * self.work[b * n + k];
                }
                self.work[a * n + b] =
                    if a == b { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum / self.work[b * n + b] };
            }
        }
        for a in 0..n {
            if self.fixed[a] {
                self.trial[a] = 0.0;
                continue;
            }
            for b in 0..a {
                self.trial[a] -= self.work[a * n + b] * self.trial[b];
            }
            self.trial[a] /= self.work[a * n + a];
        }
        for a in (0..n).rev() {
            if self.fixed[a] {
                continue;
            }
            for b in a + 1..n {
                self.trial[a] -= self.work[b * n + a] * self.trial[b];
            }
            self.trial[a] /= self.work[a * n + a];
            self.step[a] = self.trial[a];
        }
    }
}
