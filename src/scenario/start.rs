//! What goes wrong with a target at its start, as pure functions of a trajectory.

use super::outcome::Motion;
use super::trajectory::Trajectory;

/// A target that starts this deep in the hand is thrown \[m\]: soft contacts at rest are a tenth of it.
pub const DEEP: f64 = 0.001;
/// A target that leaves the hand so soon after the pin was never held \[s\].
pub const SOON: f64 = 0.1;
/// Free fall takes it farther than this by then \[m\].
const FAR: f64 = 0.02;

/// How deep the target starts in the hand \[m\], if that is deeper than [`DEEP`].
pub fn starts_inside(trajectory: &Trajectory) -> Option<f64> {
    trajectory.samples().first().map(|s| s.penetration).filter(|&depth| depth > DEEP)
}

/// A target that the pin was all that held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thrown {
    /// How far it has moved against the palm [`SOON`] after the pin \[m\].
    pub moved: f64,
    /// Whether nothing of the hand touches it any more.
    pub left: bool,
}

/// What became, [`SOON`] after the pin, of a target that the hand touched when the pin went: if it is not touched any more, or
/// has moved by 2 cm. A target that is lost later is not meant.
pub fn thrown_by_pin(trajectory: &Trajectory, pin_until: f64) -> Option<Thrown> {
    if pin_until <= 0.0 {
        return None;
    }
    let samples = trajectory.samples();
    let freed = trajectory.index_at(pin_until)?;
    let soon = trajectory.index_at(pin_until + SOON)?;
    // The contacts of the sample at `pin_until` are those that the last pinned step led to.
    let start = &samples[freed];
    let moved = Motion::between(start, &samples[soon]).offset.norm();
    let left = !samples[soon].touching;
    (start.touching && (left || moved > FAR)).then_some(Thrown { moved, left })
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::scenario::trajectory::Sample;

    fn trajectory(touching: impl Fn(f64) -> bool, height: impl Fn(f64) -> f64, depth: f64) -> Trajectory {
        let mut trajectory = Trajectory::new(Vec::new(), 500);
        for k in 0..500 {
            let time = f64::from(k) * 0.002;
            let position = Vector3::new(0.0, 0.0, height(time));
            let (rotation, grasped, quality, slip, step_ns) = (UnitQuaternion::identity(), false, 0.0, 0.0, 1000);
            let frozen = false;
            let (touching, gripped, penetration) = (touching(time), touching(time), if k == 0 { depth } else { 0.0 });
            trajectory.push(
                Sample {
                    time,
                    position,
                    rotation,
                    grasped,
                    frozen,
                    quality,
                    touching,
                    gripped,
                    penetration,
                    slip,
                    step_ns,
                },
                &[],
            );
        }
        trajectory
    }

    #[test]
    fn a_target_that_is_thrown_when_the_pin_goes_is_told_from_one_that_is_held_or_lost_later() {
        let falls = |t: f64| -4.905 * (t - 0.5_f64).max(0.0).powi(2);
        assert!(thrown_by_pin(&trajectory(|t| t < 0.51, falls, 0.0), 0.5).is_some_and(|t| t.left));
        let thrown = thrown_by_pin(&trajectory(|_| true, |t| 0.4 * (t - 0.5_f64).max(0.0), 0.0), 0.5);
        assert!(thrown.is_some_and(|t| (t.moved - 0.04).abs() < 1e-3 && !t.left), "{thrown:?}");
        assert_eq!(thrown_by_pin(&trajectory(|_| true, |_| 0.0, 0.0), 0.5), None);
        assert_eq!(thrown_by_pin(&trajectory(|t| t < 0.8, |_| 0.0, 0.0), 0.5), None, "lost later");
        assert_eq!(thrown_by_pin(&trajectory(|_| false, falls, 0.0), 0.5), None, "never touched");
        assert_eq!(thrown_by_pin(&trajectory(|t| t < 0.51, falls, 0.0), 0.0), None, "no pin");
    }

    #[test]
    fn a_target_that_starts_inside_the_hand_is_told_from_one_that_rests_in_it() {
        assert_eq!(starts_inside(&trajectory(|_| true, |_| 0.0, 0.0002)), None);
        assert_eq!(starts_inside(&trajectory(|_| true, |_| 0.0, 0.004)), Some(0.004));
    }
}
