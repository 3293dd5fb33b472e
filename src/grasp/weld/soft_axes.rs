//! Axes of the weld to which the user has given a spring and a damper, as MuJoCo's own weld has them.
//!
//! The row of such an axis is `J a + R f = R f_0 - B v - K d x`: impedance `d`, stiffness `K`, damping `B` and
//! regularisation `R` are MuJoCo's of `solref`, `solimp` and the weights of target and palm; `x` and `v` are the target's
//! displacement since the latch and its velocity against the palm, `f_0` what the axis carried at the latch. At rest
//! `f - f_0 = -(K d / R) x`. An axis with a bound yields at it: its spring goes no further than the bound.

use super::rows::WELD_ROWS;
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::softness::{ContactParameters, Softness, SolverOptions, softness};
use crate::grasp::spec::AxisSoftness;
use nalgebra::{UnitQuaternion, Vector3, Vector6};

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
    /// The target's pose in the palm's frame at the latch: centre of mass \[m\] and orientation.
    position: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
    /// How far each axis has yielded since \[m, rad\].
    yielded: Vector6<f64>,
    /// `f_0` \[N, N m\].
    preload: Vector6<f64>,
    /// Of the contact that pressed hardest at the latch: for what the user has left out.
    solref: [f64; 2],
    solimp: [f64; 5],
}

impl SoftMemory {
    /// True if every number is finite, and the orientation one.
    pub(in crate::grasp) fn is_sound(&self) -> bool {
        let turned = (self.orientation.coords.norm() - 1.0).abs() < 1e-6;
        let six = [&self.yielded, &self.preload];
        let rest = self.position.iter().chain(&self.solref).chain(&self.solimp);
        turned && six.into_iter().flatten().chain(rest).all(|x| x.is_finite())
    }
}

impl SoftAxes {
    pub fn new(given: [Option<AxisSoftness>; WELD_ROWS], inverse_weight: [f64; WELD_ROWS]) -> Self {
        SoftAxes { given, inverse_weight, memory: SoftMemory::default() }
    }

    /// True if any axis is soft.
    pub fn any(&self) -> bool {
        self.given.iter().any(Option::is_some)
    }

    /// Starts from the target's `pose` in the palm's frame with `wrench` across the grasp.
    pub fn begin(
        &mut self,
        (position, orientation): (Vector3<f64>, UnitQuaternion<f64>),
        wrench: Vector6<f64>,
        contacts: &[GraspContact],
    ) {
        let hardest = contacts.iter().max_by(|a, b| a.normal_force().total_cmp(&b.normal_force()));
        let (solref, solimp) = hardest.map_or_else(Default::default, |c| (c.parameters.solref, c.parameters.solimp));
        let yielded = Vector6::zeros();
        self.memory = SoftMemory { position, orientation, yielded, preload: wrench, solref, solimp };
    }

    /// Displacement of the target in the palm's frame since the latch, palm's axes: `[translation; rotation vector]`.
    pub fn displacement(&self, (position, orientation): (Vector3<f64>, UnitQuaternion<f64>)) -> Vector6<f64> {
        let (moved, turned) = (position - self.memory.position, orientation * self.memory.orientation.inverse());
        let turned = turned.scaled_axis();
        Vector6::new(moved.x, moved.y, moved.z, turned.x, turned.y, turned.z)
    }

    pub fn memory(&self) -> SoftMemory {
        self.memory
    }

    pub fn restore(&mut self, memory: SoftMemory) {
        self.memory = memory;
    }

    /// Regularisation `R` and reference acceleration of `axis`, along which the target is displaced and moves so against the
    /// palm; `None` unless it is soft.
    pub fn row(
        &mut self,
        axis: usize,
        (displacement, velocity): (f64, f64),
        bound: Option<f64>,
        options: &SolverOptions,
    ) -> Option<(f64, f64)> {
        let given = self.given[axis]?;
        let inverse_weight = self.inverse_weight[axis];
        let SoftMemory { yielded, preload, solref, solimp, .. } = &mut self.memory;
        let (yielded, preload) = (&mut yielded[axis], preload[axis]);
        let x = displacement - *yielded;
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
        let mut soft = law(x);
        let force = preload - soft.spring / soft.regularisation;
        if let Some(bound) = bound.filter(|bound| force.abs() > *bound && soft.spring != 0.0) {
            let allowed = (preload - force.clamp(-bound, bound)) * soft.regularisation;
            let held = x * allowed / soft.spring;
            *yielded = displacement - held;
            soft = law(held);
        }
        let reference = soft.regularisation * preload - soft.damping * velocity - soft.spring;
        Some((soft.regularisation, reference))
    }
}
