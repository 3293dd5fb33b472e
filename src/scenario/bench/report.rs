//! What `bench` tells.

use serde::Serialize;
use std::collections::BTreeMap;

/// The JSON object of `bench`.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Name of the scenario.
    pub scenario: String,
    /// Version of MuJoCo.
    pub engine: String,
    /// Degrees of freedom.
    pub nv: usize,
    /// No push.
    pub still: Phases,
    /// Along the first push; `None` if there is none, or it has no onset.
    pub pushed: Option<Phases>,
    /// Why `pushed` is `None`.
    #[serde(skip)]
    pub not_pushed: Option<String>,
    /// Median time of one inverse-kinematics solve whose goals moved by 1 mm \[us\]; `None` without goals.
    pub ik_us: Option<f64>,
    /// The first push times this is the smallest that is not held; `None` as for `pushed`.
    pub onset_factor: Option<f64>,
    /// Whether the grasp was latched when timing started.
    pub latched: bool,
}

/// The variants under one load.
#[derive(Debug, Serialize)]
pub struct Phases {
    /// Timed steps of each variant.
    pub steps: usize,
    /// MuJoCo's own solve without noslip.
    pub full: Timing,
    /// The same with 10 noslip iterations.
    pub full_noslip: Timing,
    /// The model's own solver and noslip, untouched.
    pub full_default: Timing,
    /// The grasp controller.
    pub grasp: Timing,
    /// The grasp controller with every step whole.
    pub exact: Timing,
    /// No contacts at all.
    pub floor: Timing,
    /// How they compare.
    pub ratio: Ratio,
}

/// Medians over all calls of a variant, and a mean.
#[derive(Clone, Debug, Serialize)]
pub struct Timing {
    /// Whole step \[us\].
    pub step_us: Option<f64>,
    /// Mean over the calls of a turn, each the median of its times in all turns \[us\]: what steps that are not alike come to
    /// together, where the median of all calls is that of one kind or the other.
    pub step_mean_us: Option<f64>,
    /// Collision, making, projecting and solving constraints, and all work of the grasp \[us\]; `None` in the engine's
    /// own solves where the model has islands or sleeping (MuJoCo 3), with which a step is not made in stages, and on frozen
    /// geometry, where stages are left out.
    pub contact_us: Option<f64>,
    /// What the step costs more than the floor's \[us\].
    pub added_us: Option<f64>,
    /// Solver and storage of the full solves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver: Option<String>,
    /// Whether that solver kept the outcome, as every candidate should.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept_outcome: Option<bool>,
    /// Steps after which the grasp was not latched, which cost what contacts cost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unlatched_steps: Option<usize>,
    /// Steps that were made on frozen geometry.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substructured_steps: Option<u64>,
    /// Why steps of which only the state was wanted were not, and how many, see
    /// [`Grasps::whole_steps`](crate::grasp::Grasps::whole_steps).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub whole_steps: BTreeMap<&'static str, u64>,
}

/// Ratios of medians, or of means where it says so.
#[derive(Debug, Serialize)]
pub struct Ratio {
    /// full over grasp, contact part.
    pub contact: Option<f64>,
    /// full_noslip over grasp, contact part.
    pub contact_noslip: Option<f64>,
    /// full over grasp, whole step.
    pub step: Option<f64>,
    /// full_noslip over grasp, whole step.
    pub step_noslip: Option<f64>,
    /// The cheaper of full and full_default over grasp, whole step.
    pub step_default: Option<f64>,
    /// As `step_noslip`, of means.
    pub mean_noslip: Option<f64>,
    /// As `step_default`, of means.
    pub mean_default: Option<f64>,
    /// full over grasp, of what they cost more than the floor; `None` where grasp adds nothing.
    pub added: Option<f64>,
    /// The same of full_noslip.
    pub added_noslip: Option<f64>,
    /// grasp over floor, whole step.
    pub step_over_floor: Option<f64>,
}
