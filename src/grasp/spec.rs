//! What a user says of a grasp: who holds what, when it latches, and what stands for the contacts then.

use super::error::Error;
use super::quality;
use super::topology::lowest_common_ancestor;
use crate::mujoco::BodyId;
use nalgebra::UnitQuaternion;

/// What stands for the contacts while the grasp is latched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Limits {
    /// Each contact's friction cone: the grasp holds, slides and opens as the contacts would.
    #[default]
    Cones,
    /// The thesis's Eqs. 4.1 to 4.3: one bound on each axis of a weld with the merged effectors.
    Box,
    /// A weld with the merged effectors, without bounds.
    Rigid,
}

impl Limits {
    /// The name in scenario files.
    pub fn name(self) -> &'static str {
        match self {
            Limits::Cones => "cones",
            Limits::Box => "box",
            Limits::Rigid => "rigid",
        }
    }
}

/// A grasp as the user describes it: [`new`](Self::new), then set the fields that are to differ from their defaults.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct GraspSpec {
    /// Body that is grasped.
    pub target: BodyId,
    /// Links that may hold it; empty: every link below the palm.
    pub effectors: Vec<BodyId>,
    /// Base of the fingers; `None`: the lowest common ancestor of the effectors, and without any, the only hand that can
    /// touch the target ([`find_hand`](super::find_hand)).
    pub palm: Option<BodyId>,
    /// Quality at which the grasp latches, `Q_Th` \[N\]; `None`: from the target's weight.
    pub latch_quality: Option<f64>,
    /// Quality below which it is given up, `Q_M` \[N\]; `None`: from `Q_Th`.
    pub release_quality: Option<f64>,
    /// Simulated time for which the quality must be good before the grasp latches \[s\].
    pub latch_time: f64,
    /// What stands for the contacts.
    pub limits: Limits,
    /// Axes that may slip (x, y, z, then rotations), [`Limits::Box`] only.
    pub relaxed: [bool; 6],
    /// Orientation of those axes in the target's frame, [`Limits::Box`] only.
    pub axes: UnitQuaternion<f64>,
}

/// Simulated time of good quality after which a grasp latches, unless set otherwise \[s\].
pub const DEFAULT_LATCH_TIME: f64 = 0.05;

impl GraspSpec {
    /// A grasp of `target` by every link below `palm`, with all defaults; without a palm (`None`) the hand is found.
    pub fn new(target: BodyId, palm: impl Into<Option<BodyId>>) -> Self {
        GraspSpec {
            target,
            effectors: Vec::new(),
            palm: palm.into(),
            latch_quality: None,
            release_quality: None,
            latch_time: DEFAULT_LATCH_TIME,
            limits: Limits::default(),
            relaxed: [true; 6],
            axes: UnitQuaternion::identity(),
        }
    }
}

/// The base of fingers given by their links: the lowest common ancestor, and for a single link its parent.
pub(super) fn palm_of(parents: &[i32], effectors: &[usize]) -> usize {
    let ancestor = lowest_common_ancestor(parents, effectors);
    if effectors.contains(&ancestor) { parents[ancestor] as usize } else { ancestor }
}

/// `Q_Th` and `Q_M` \[N\], checked; `weight` of the target \[N\].
pub(super) fn thresholds(spec: &GraspSpec, weight: f64) -> Result<(f64, f64), Error> {
    let latch = spec.latch_quality.unwrap_or_else(|| quality::default_latch_quality(weight));
    if !(latch.is_finite() && latch > 0.0) {
        return Err(Error::Threshold { name: "latch_quality", value: latch, expected: "it must be a positive number" });
    }
    let release = spec.release_quality.unwrap_or_else(|| quality::default_release_quality(latch));
    if !(release >= 0.0 && release < latch) {
        return Err(Error::Threshold {
            name: "release_quality",
            value: release,
            expected: "it must be at least 0 and below latch_quality",
        });
    }
    Ok((latch, release))
}
