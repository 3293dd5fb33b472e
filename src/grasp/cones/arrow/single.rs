//! Costs on one joint: joint limits and friction losses.

use super::Branch;
use crate::grasp::contact::cost::{ActiveSet, Cost};

/// A force on one joint, within an interval and affine in the residual `bias + entry d` inside it.
#[derive(Clone, Copy, Debug)]
pub struct Single {
    /// Its joint, in the arrays that hold `[root; own]` of each branch.
    pub(super) at: usize,
    /// The joint's diagonal entry of the Hessian.
    pub(super) diagonal: usize,
    pub(super) entry: f64,
    pub(super) bias: f64,
    /// Force from which the point starts.
    pub(super) start: f64,
    /// Residual.
    pub jar: f64,
    /// Its change along the Newton step.
    pub(super) slope: f64,
    /// `f`.
    pub force: f64,
    /// Force without residual.
    centre: f64,
    stiffness: f64,
    low: f64,
    high: f64,
    side: Side,
    /// How easily the joint moves, see [`Arrow::mobility`](super::Arrow::mobility).
    pub mobility: f64,
}

/// Where in the interval the force is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Inside,
    Low,
    High,
}

impl Single {
    pub(super) fn new(
        cost: &Cost,
        active_set: ActiveSet,
        branch: &Branch,
        (joint, entry): (usize, f64),
        bias: f64,
        force: f64,
    ) -> Self {
        let mut single = Single {
            at: branch.local + branch.root + joint,
            diagonal: branch.square + joint * branch.stride + branch.root + joint,
            entry,
            bias,
            start: 0.0,
            jar: 0.0,
            slope: 0.0,
            force: 0.0,
            centre: 0.0,
            stiffness: 0.0,
            low: 0.0,
            high: 0.0,
            side: Side::Inside,
            mobility: 0.0,
        };
        single.recost(cost, active_set, force);
        single
    }

    pub(super) fn recost(&mut self, cost: &Cost, active_set: ActiveSet, start: f64) {
        (self.centre, self.stiffness, self.low, self.high) = match *cost {
            Cost::Unilateral { stiffness } => (0.0, stiffness, 0.0, f64::INFINITY),
            Cost::Bounded { centre, stiffness, limit } => (centre, stiffness, -limit, limit),
            _ => (0.0, 0.0, 0.0, 0.0),
        };
        self.side = match active_set {
            ActiveSet::Open | ActiveSet::Facet(0b01) => Side::Low,
            ActiveSet::Facet(0b10) => Side::High,
            _ => Side::Inside,
        };
        self.start = start;
    }

    /// Where it stands, as its cost says it.
    pub fn active_set(&self) -> ActiveSet {
        match (self.low < 0.0, self.side) {
            (true, Side::Inside) => ActiveSet::Facet(0b00),
            (true, Side::Low) => ActiveSet::Facet(0b01),
            (true, Side::High) => ActiveSet::Facet(0b10),
            (false, Side::Low) => ActiveSet::Open,
            (false, _) => ActiveSet::Stick,
        }
    }

    #[inline(always)]
    pub(super) fn side(&self) -> Side {
        self.side
    }

    /// Second derivative.
    #[inline(always)]
    pub(super) fn curvature(&self) -> f64 {
        if self.side == Side::Inside { self.stiffness } else { 0.0 }
    }

    /// The force at the residual, the side being what it is.
    #[inline(always)]
    pub(super) fn respond_in(&mut self) {
        self.force = match self.side {
            Side::Inside => self.centre - self.stiffness * self.jar,
            Side::Low => self.low,
            Side::High => self.high,
        };
    }

    /// Finds side and force at the residual; returns the cost.
    #[inline(always)]
    pub(super) fn respond(&mut self) -> f64 {
        let trial = self.centre - self.stiffness * self.jar;
        self.side = if trial < self.low {
            Side::Low
        } else if trial > self.high {
            Side::High
        } else {
            Side::Inside
        };
        self.respond_in();
        let off = self.force - self.centre;
        let elastic = if off == 0.0 { 0.0 } else { 0.5 * off * off / self.stiffness };
        -self.force * self.jar - elastic
    }

    /// How far the force is from its centre, as a share of its limit; 0 of a limit of one side.
    pub fn change(&self) -> f64 {
        if self.low < 0.0 && self.high > 0.0 && self.high.is_finite() {
            (self.force - self.centre).abs() / self.high
        } else {
            0.0
        }
    }

    /// Centres a friction loss at its force; a limit stays as it is.
    pub(super) fn centre(&mut self) {
        self.start = self.force;
        if self.low < 0.0 && self.high.is_finite() {
            self.centre = self.force;
        }
    }
}
