//! Axes of the weld to which the user has given a spring and a damper, as MuJoCo's own weld has them.
//!
//! The row of such an axis is `J a + R f = R f_0 - B J v - K d x`: impedance `d`, stiffness `K`, damping `B` and
//! regularisation `R` are MuJoCo's of `solref`, `solimp` and the weights of target and palm; `x` is how far the target has
//! moved along the axis against the merged effectors since the latch, `f_0` what the axis carried then. At rest
//! `f - f_0 = -(K d / R) x`. An axis with a bound yields at it: its spring goes no further than the bound.

use super::rows::WELD_ROWS;
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::softness::{ContactParameters, Softness, SolverOptions, softness};
use crate::grasp::spec::AxisSoftness;
use nalgebra::Vector6;

/// The soft axes of one weld.
#[derive(Clone, Debug)]
pub(super) struct SoftAxes {
    /// `None` of an axis that has its softness from the contacts.
    given: [Option<AxisSoftness>; WELD_ROWS],
    /// Sum of the `invweight0` of target and palm \[1/kg, 1/(kg m^2)\].
    inverse_weight: [f64; WELD_ROWS],
    memory: SoftMemory,
}

/// What soft axes remember from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(in crate::grasp) struct SoftMemory {
    /// `x` \[m, rad\].
    displacement: Vector6<f64>,
    /// `f_0` \[N, N m\].
    preload: Vector6<f64>,
    /// Of the contact that pressed hardest at the latch: for what the user has left out.
    solref: [f64; 2],
    solimp: [f64; 5],
}

impl SoftMemory {
    /// True if every number is finite.
    pub(in crate::grasp) fn is_finite(&self) -> bool {
        let six = [&self.displacement, &self.preload];
        six.into_iter().flatten().chain(&self.solref).chain(&self.solimp).all(|x| x.is_finite())
    }
}

impl SoftAxes {
    pub fn new(given: [Option<AxisSoftness>; WELD_ROWS], inverse_weight: [f64; WELD_ROWS]) -> Self {
        SoftAxes { given, inverse_weight, memory: SoftMemory::default() }
    }

    /// Starts from rest with `wrench` across the grasp.
    pub fn begin(&mut self, wrench: Vector6<f64>, contacts: &[GraspContact]) {
        let hardest = contacts.iter().max_by(|a, b| a.normal_force().total_cmp(&b.normal_force()));
        let (solref, solimp) = hardest.map_or_else(Default::default, |c| (c.parameters.solref, c.parameters.solimp));
        self.memory = SoftMemory { displacement: Vector6::zeros(), preload: wrench, solref, solimp };
    }

    pub fn memory(&self) -> SoftMemory {
        self.memory
    }

    pub fn restore(&mut self, memory: SoftMemory) {
        self.memory = memory;
    }

    /// Regularisation `R` and reference acceleration of `axis`, along which the target has moved at `velocity` since the
    /// last step; `None` unless it is soft.
    pub fn row(
        &mut self,
        axis: usize,
        velocity: f64,
        bound: Option<f64>,
        options: &SolverOptions,
    ) -> Option<(f64, f64)> {
        let given = self.given[axis]?;
        let inverse_weight = self.inverse_weight[axis];
        let SoftMemory { displacement, preload, solref, solimp } = &mut self.memory;
        let (x, preload) = (&mut displacement[axis], preload[axis]);
        *x += options.timestep * velocity;
        // a row of a frictionless contact has the same law as one of a weld
        let law = |x: f64| -> Softness {
            let parameters = ContactParameters {
                solref: given.solref.unwrap_or(*solref),
                solimp: given.solimp.unwrap_or(*solimp),
                dist: x,
                margin: 0.0,
                condim: 1,
                friction: [0.0; 5],
                inverse_weight,
            };
            softness(&parameters, options)
        };
        let mut soft = law(*x);
        let force = preload - soft.spring / soft.regularisation;
        if let Some(bound) = bound.filter(|bound| force.abs() > *bound && soft.spring != 0.0) {
            let allowed = (preload - force.clamp(-bound, bound)) * soft.regularisation;
            *x *= allowed / soft.spring;
            soft = law(*x);
        }
        let reference = soft.regularisation * preload - soft.damping * velocity - soft.spring;
        Some((soft.regularisation, reference))
    }
}
