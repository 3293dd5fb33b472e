//! The same run in both modes, compared.

use serde::Serialize;

use super::outcome::{Motion, Summary, lost_at};
use super::trajectory::Trajectory;

/// Peaks smaller than this do not make a relative error larger \[m\].
const SMALLEST_PEAK: f64 = 0.002;

/// The JSON object C: how far the grasp mode is from the full contact solve.
///
/// Root mean squares are over the compare window: from `measure_from` to the end, or to the first loss in either mode.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Held, slid or lost alike.
    pub same_outcome: bool,
    /// Grasp mode was latched for none of the compare window: both modes were the same simulation there, and the comparison
    /// says nothing.
    pub vacuous: bool,
    /// RMS distance of the two motions \[m\].
    pub position_rmse_m: Option<f64>,
    /// `position_rmse_m` over the larger of full's peak motion and 2 mm.
    pub relative_error: Option<f64>,
    /// RMS angle between the two motions \[rad\].
    pub rotation_rmse_rad: Option<f64>,
    /// RMS difference of the links' normal forces over RMS of full's.
    pub normal_force_relative_error: Option<f64>,
    /// The scenario's other grasps, in the order of its file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<Comparison>,
}

/// Compares two runs of the same scenario and push with the same time step.
pub fn compare(full: (&Trajectory, &Summary), grasp: (&Trajectory, &Summary), measure_from: f64) -> Comparison {
    let mut comparison = Comparison {
        same_outcome: full.1.outcome.is_some() && full.1.outcome == grasp.1.outcome,
        vacuous: true,
        position_rmse_m: None,
        relative_error: None,
        rotation_rmse_rad: None,
        normal_force_relative_error: None,
        others: Vec::new(),
    };
    let (Some(a0), Some(b0)) = (full.0.index_at(measure_from), grasp.0.index_at(measure_from)) else {
        return comparison;
    };
    let room = (full.0.samples().len() - a0).min(grasp.0.samples().len() - b0);
    // The sample of the loss itself is in the window, so that a target lost from the start still compares.
    let until = |trajectory: &Trajectory, start: usize| {
        lost_at(trajectory, measure_from).map_or(room, |i| (i - start + 1).min(room))
    };
    let n = until(full.0, a0).min(until(grasp.0, b0));
    let (mut position, mut rotation, mut force, mut reference) = (0.0, 0.0, 0.0, 0.0);
    for k in 0..n {
        let a = Motion::between(&full.0.samples()[a0], &full.0.samples()[a0 + k]);
        let b = Motion::between(&grasp.0.samples()[b0], &grasp.0.samples()[b0 + k]);
        position += (a.offset - b.offset).norm_squared();
        rotation += a.rotation.angle_to(&b.rotation).powi(2);
        for (fa, fb) in full.0.normal_forces(a0 + k).iter().zip(grasp.0.normal_forces(b0 + k)) {
            force += (fa - fb).powi(2);
            reference += fa.powi(2);
        }
    }
    comparison.vacuous = !grasp.0.samples()[b0..b0 + n].iter().any(|s| s.grasped);
    let rms = |sum: f64| (n > 0).then(|| (sum / n as f64).sqrt());
    comparison.position_rmse_m = rms(position);
    comparison.rotation_rmse_rad = rms(rotation);
    comparison.relative_error =
        rms(position).zip(full.1.peak_motion_m).map(|(rmse, peak)| rmse / peak.max(SMALLEST_PEAK));
    comparison.normal_force_relative_error = (reference > 0.0).then(|| (force / reference).sqrt());
    comparison
}
