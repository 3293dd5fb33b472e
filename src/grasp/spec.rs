//! What a user says of a grasp: who holds what, when it latches, and what stands for the contacts then.

use crate::grasp::error::Error;
use crate::grasp::hand::topology::lowest_common_ancestor;
use crate::mujoco::{BodyId, CompiledModel};
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
    /// touch the target ([`find_hand`](crate::grasp::find_hand)).
    pub palm: Option<BodyId>,
    /// Quality at which the grasp latches, `Q_Th` \[N\]; `None`: from the target's weight.
    pub latch_quality: Option<f64>,
    /// What a latched grasp must keep not to be given up, `Q_M` \[N\]; `None`: from `Q_Th`. With [`Limits::Cones`] the sum of
    /// the normal forces with which all that is below the palm presses on the target: the constraint is exact while
    /// contacts open, slide and come back, so a hand that still works on its object keeps it, whatever the quality. With [`Limits::Box`] and
    /// [`Limits::Rigid`], whose bounds mean little in a poor grasp, the thesis's quality itself.
    pub release_quality: Option<f64>,
    /// Simulated time for which the quality must be good, with contact, before the grasp latches, each time anew \[s\].
    pub latch_time: f64,
    /// Simulated time for which it must be without [`release_quality`](Self::release_quality), or without contact, before it
    /// is given up \[s\].
    pub release_time: f64,
    /// What stands for the contacts.
    pub limits: Limits,
    /// Axes that may slip (x, y, z, then rotations), [`Limits::Box`] only.
    pub relaxed: [bool; 6],
    /// Orientation of those axes in the target's frame, [`Limits::Box`] only.
    pub axes: UnitQuaternion<f64>,
    /// Spring and damper of the weld's axes that may not slip, [`Limits::Box`] and [`Limits::Rigid`] only, as MuJoCo's
    /// `solref` of a weld: `[time constant (s), damping ratio]`, both positive, or `[-stiffness, -damping]`, neither positive.
    /// The spring acts between target and palm and is at rest in the pose and with the wrench of the latch. `None`: from
    /// the contacts, which the weld then follows.
    pub solref: Option<[f64; 2]>,
    /// Impedance of those axes, as MuJoCo's `solimp` of a weld: `[d_0, d_width, width, midpoint, power]`, the width in m, for
    /// angular axes in rad. With `solref` alone it is that of the contact that pressed hardest at the latch, and the other
    /// way round; without both the axis is as the contacts are.
    pub solimp: Option<[f64; 5]>,
    /// As [`solref`](Self::solref), of the axes that may slip, [`Limits::Box`] only: such an axis is soft and has a bound,
    /// at which its spring yields.
    pub relaxed_solref: Option<[f64; 2]>,
    /// As [`solimp`](Self::solimp), of the axes that may slip, [`Limits::Box`] only.
    pub relaxed_solimp: Option<[f64; 5]>,
}

/// Spring and damper that the user has given to an axis of the weld.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct AxisSoftness {
    pub solref: Option<[f64; 2]>,
    pub solimp: Option<[f64; 5]>,
}

/// Simulated time of good quality after which a grasp latches, unless set otherwise \[s\].
pub const DEFAULT_LATCH_TIME: f64 = 0.05;
/// Simulated time without hold after which a grasp is given up, unless set otherwise \[s\].
pub const DEFAULT_RELEASE_TIME: f64 = 0.05;
/// The default `Q_Th` as a fraction of the target's weight, see [`default_latch_quality`].
pub const LATCH_PER_WEIGHT: f64 = 0.1;
/// The default `Q_M` as a fraction of `Q_Th`.
pub const RELEASE_PER_LATCH: f64 = 0.25;
/// What a target weighs where there is no gravity, per mass \[m/s^2\].
const EARTH: f64 = 9.81;

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
            release_time: DEFAULT_RELEASE_TIME,
            limits: Limits::default(),
            relaxed: [true; 6],
            axes: UnitQuaternion::identity(),
            solref: None,
            solimp: None,
            relaxed_solref: None,
            relaxed_solimp: None,
        }
    }

    /// Axes of the weld that have bounds.
    pub(super) fn bounded(&self) -> [bool; 6] {
        self.relaxed.map(|relaxed| relaxed && self.limits == Limits::Box)
    }

    /// What the user has given to each axis; `None`: nothing.
    pub(super) fn softness(&self) -> [Option<AxisSoftness>; 6] {
        self.bounded().map(|bounded| {
            let (solref, solimp) =
                if bounded { (self.relaxed_solref, self.relaxed_solimp) } else { (self.solref, self.solimp) };
            (solref.is_some() || solimp.is_some()).then_some(AxisSoftness { solref, solimp })
        })
    }
}

/// What is wrong with a `solref`, and what would be right.
pub(crate) fn wrong_solref(solref: &[f64; 2]) -> Option<&'static str> {
    let sound = solref.iter().all(|x| x.is_finite() && *x > 0.0) || solref.iter().all(|x| x.is_finite() && *x <= 0.0);
    (!sound).then_some(
        "it must be [time constant in s, damping ratio], both above 0, or [-stiffness, -damping], neither above 0",
    )
}

/// What is wrong with a `solimp`, and what would be right.
pub(crate) fn wrong_solimp(&[d_0, d_width, width, midpoint, power]: &[f64; 5]) -> Option<&'static str> {
    let inside = |x: f64| 0.0 < x && x < 1.0;
    let sound = [d_0, d_width, midpoint].into_iter().all(inside) && width >= 0.0 && power >= 1.0;
    (!(sound && width.is_finite() && power.is_finite())).then_some(
        "it must be [d_0, d_width, width, midpoint, power]: d_0, d_width and midpoint between 0 and 1, width at least 0, \
         power at least 1",
    )
}

/// The base of fingers given by their links: the lowest common ancestor, and for a single link its parent.
pub(super) fn palm_of(parents: &[i32], effectors: &[usize]) -> usize {
    let ancestor = lowest_common_ancestor(parents, effectors);
    if effectors.contains(&ancestor) { parents[ancestor] as usize } else { ancestor }
}

impl GraspSpec {
    /// That the model has all bodies.
    pub(super) fn check_bodies(&self, count: usize) -> Result<(), Error> {
        let named = [("target", self.target)].into_iter().chain(self.palm.map(|palm| ("palm", palm)));
        let effectors = self.effectors.iter().map(|&effector| ("effector", effector));
        match named.chain(effectors).find(|(_, body)| body.index() >= count) {
            Some((role, body)) => Err(Error::NoSuchBody { role, index: body.index(), count }),
            None => Ok(()),
        }
    }
}

/// That springs, dampers and impedances of the weld's axes make sense.
pub(super) fn check_softness(spec: &GraspSpec) -> Result<(), Error> {
    let wrong = |name, value: String, expected| Err(Error::Softness { name, value, expected });
    for (name, solref) in [("solref", spec.solref), ("relaxed_solref", spec.relaxed_solref)] {
        if let Some((solref, expected)) = solref.and_then(|solref| Some((solref, wrong_solref(&solref)?))) {
            return wrong(name, format!("{solref:?}"), expected);
        }
    }
    for (name, solimp) in [("solimp", spec.solimp), ("relaxed_solimp", spec.relaxed_solimp)] {
        if let Some((solimp, expected)) = solimp.and_then(|solimp| Some((solimp, wrong_solimp(&solimp)?))) {
            return wrong(name, format!("{solimp:?}"), expected);
        }
    }
    Ok(())
}

/// What a grasp of `target` is measured by: the weight of all that hangs on it \[N\]; without gravity, what it would be on
/// earth.
pub fn weight(model: &CompiledModel, target: BodyId) -> f64 {
    let gravity = if model.has_gravity() { model.gravity().norm() } else { 0.0 };
    model.body_subtreemass()[target.index()] * if gravity > 0.0 { gravity } else { EARTH }
}

/// The default Q_Th \[N\] for a target of that weight \[N\] (see [`weight`]): a tenth of the weight.
///
/// The thesis records, scene by scene, the least Q at which the target stays at rest under gravity. For the grasps with
/// closed forms that value follows from the weight W. N hard fingers around an equator carry it when `N mu f = W`; then
/// `Q = sqrt(N) mu f = W / sqrt N`: 0.58 W for three, 0.45 W for five, 0.32 W for ten. Two soft fingers carry it when
/// `2 mu f = W`; then `Q = 2 f mu_t / a = W mu_t / (mu a)`, with MuJoCo's default friction (1, 0.005 m) and objects up to
/// 10 cm across (a <= 5 cm) at least W / 10. So W / 10 is the largest round threshold that all of these pass by the time
/// they can just hold the target, and a grasp that holds with some reserve passes it clearly.
///
/// Lower is not dangerous: the grasp constraint keeps the cones of the contacts it replaces, so a latch too early slips
/// like the contacts would; a latch too high never comes.
pub fn default_latch_quality(weight: f64) -> f64 {
    LATCH_PER_WEIGHT * weight
}

/// The default Q_M \[N\] for a given Q_Th: a quarter of it. Q is linear in the forces, so at the same contacts the
/// fingers must have relaxed to a quarter of what latched them: wide enough that no push chatters, and passed at once
/// when a hand opens.
pub fn default_release_quality(latch_quality: f64) -> f64 {
    RELEASE_PER_LATCH * latch_quality
}

/// `Q_Th` and `Q_M` \[N\], checked; `weight` of the target \[N\].
pub(super) fn thresholds(spec: &GraspSpec, weight: f64) -> Result<(f64, f64), Error> {
    for (name, value) in [("latch_time", spec.latch_time), ("release_time", spec.release_time)] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Error::Time { name, value });
        }
    }
    let latch = spec.latch_quality.unwrap_or_else(|| default_latch_quality(weight));
    if !(latch.is_finite() && latch > 0.0) {
        return Err(Error::Threshold { name: "latch_quality", value: latch, expected: "it must be a positive number" });
    }
    let release = spec.release_quality.unwrap_or_else(|| default_release_quality(latch));
    if !(release >= 0.0 && release < latch) {
        return Err(Error::Threshold {
            name: "release_quality",
            value: release,
            expected: "it must be at least 0 and below latch_quality",
        });
    }
    Ok((latch, release))
}
