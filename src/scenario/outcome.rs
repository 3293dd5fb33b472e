//! What became of one run: the terms of `docs/reference.md`, as pure functions of its trajectory.
//!
//! All motion is that of the target's frame in the palm's frame, from its pose at `measure_from`.

use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::trajectory::{Sample, Trajectory};

/// The target is lost once it has moved this far \[m\].
pub const LOSS_DISTANCE: f64 = 0.05;
/// A final offset below this is no slide \[m\].
pub const HELD_OFFSET: f64 = 0.002;
/// Nor is one below this share of the peak.
pub const HELD_SHARE_OF_PEAK: f64 = 0.1;
/// Accumulated slip that counts as slipping \[m\].
pub const SLIP_ONSET: f64 = 0.001;
/// Creep is measured over the last second \[s\].
const CREEP_TIME: f64 = 1.0;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// Not lost, and back within 2 mm or a tenth of the peak.
    Held,
    /// Neither held nor lost.
    Slid,
    /// At the end nothing below the palm touches the target, or it has moved 5 cm.
    Lost,
}

/// A latch or a release.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Change {
    /// The first step in the new phase \[s\].
    pub time_s: f64,
    /// 0 ungrasped, 1 grasped.
    pub phase: u8,
}

/// One run in numbers; the JSON object R. A number that does not exist is `None`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// `None` when the run ended before `measure_from`.
    pub outcome: Option<Outcome>,
    /// First latch \[s\].
    pub latched_at_s: Option<f64>,
    /// First release after it \[s\].
    pub released_at_s: Option<f64>,
    /// Of the steps from `measure_from` to the last in which anything below the palm pressed on the target, those that were
    /// latched. `None` in full
    /// mode, and when nothing touched.
    pub latched_share: Option<f64>,
    /// Of the latched ones among them, those that were made on frozen geometry (phase 2). `None`
    /// when none was latched.
    pub substructured_share: Option<f64>,
    /// Every latch and release, from the start of the run.
    pub changes: Vec<Change>,
    /// Largest distance from the pose at `measure_from` \[m\].
    pub peak_motion_m: Option<f64>,
    /// Largest turn from the attitude at `measure_from` \[rad\].
    pub peak_rotation_rad: Option<f64>,
    /// Distance at the end \[m\].
    pub final_offset_m: Option<f64>,
    /// Largest -dist between hand and target from `measure_from` on \[m\].
    pub max_penetration_m: Option<f64>,
    /// Mean speed of the last second \[m/s\], if nothing pushes then and the target is not lost.
    pub creep_m_per_s: Option<f64>,
    /// Quality in the step that latched \[N\].
    pub quality_at_latch_n: Option<f64>,
    /// Sum of the links' normal forces at `measure_from` \[N\].
    pub normal_force_total_n: Option<f64>,
    /// First time when the slip accumulated at any contact passes 1 mm \[s\].
    pub slip_onset_s: Option<f64>,
    /// Median wall-clock time of a step from `measure_from` on \[us\].
    pub step_us_median: Option<f64>,
}

impl Summary {
    /// Of a run that failed on its way: how it would have ended is not known.
    pub(super) fn forget_the_end(&mut self) {
        self.outcome = None;
        self.final_offset_m = None;
        self.creep_m_per_s = None;
    }

    /// Of full mode, which has nothing to latch.
    pub(super) fn forget_the_latch(&mut self) {
        self.latched_share = None;
        self.substructured_share = None;
    }
}

/// Motion of the target since `measure_from`, in the palm's axes.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// \[m\]
    pub offset: Vector3<f64>,
    /// Turn from the starting attitude.
    pub rotation: UnitQuaternion<f64>,
}

impl Motion {
    /// From `start` to `now`.
    pub fn between(start: &Sample, now: &Sample) -> Self {
        Self { offset: now.position - start.position, rotation: now.rotation * start.rotation.inverse() }
    }
}

/// Index of the sample in which the target is lost for good: when it has first moved 5 cm, or when the last contact ended
/// that nothing followed. `None` when it is not lost, or when the run did not reach `measure_from`.
pub fn lost_at(trajectory: &Trajectory, measure_from: f64) -> Option<usize> {
    let first = trajectory.index_at(measure_from)?;
    let window = &trajectory.samples()[first..];
    let start = window.first()?;
    let moved = window.iter().position(|s| Motion::between(start, s).offset.norm() >= LOSS_DISTANCE);
    let untouched = match window.iter().rposition(|s| s.touching) {
        Some(last) if last + 1 == window.len() => None,
        Some(last) => Some(last + 1),
        None => Some(0),
    };
    let lost = [moved, untouched].into_iter().flatten().min()?;
    Some(first + lost)
}

/// The numbers of one run. `pushed_until`: when the last push ends \[s\], if there is one.
pub fn summarize(trajectory: &Trajectory, measure_from: f64, pushed_until: Option<f64>) -> Summary {
    let samples = trajectory.samples();
    let latch = samples.iter().position(|s| s.grasped);
    let release = latch.and_then(|l| samples[l..].iter().position(|s| !s.grasped).map(|r| l + r));
    let mut summary = Summary {
        outcome: None,
        latched_at_s: latch.map(|i| samples[i].time),
        released_at_s: release.map(|i| samples[i].time),
        latched_share: None,
        substructured_share: None,
        changes: changes(samples),
        peak_motion_m: None,
        peak_rotation_rad: None,
        final_offset_m: None,
        max_penetration_m: None,
        creep_m_per_s: None,
        quality_at_latch_n: latch.map(|i| samples[i].quality),
        normal_force_total_n: None,
        slip_onset_s: None,
        step_us_median: None,
    };
    let Some(first) = trajectory.index_at(measure_from) else {
        return summary;
    };
    let window = &samples[first..];
    let (Some(start), Some(end)) = (window.first(), window.last()) else {
        return summary;
    };
    let peak = window.iter().map(|s| Motion::between(start, s).offset.norm()).fold(0.0, f64::max);
    let offset = Motion::between(start, end).offset.norm();
    let lost = lost_at(trajectory, measure_from).is_some();
    let touched = &window[..window.iter().rposition(|s| s.gripped).map_or(0, |last| last + 1)];
    let latched = touched.iter().filter(|s| s.grasped).count();
    summary.latched_share = (!touched.is_empty()).then(|| latched as f64 / touched.len() as f64);
    let frozen = touched.iter().filter(|s| s.frozen).count();
    summary.substructured_share = (latched > 0).then(|| frozen as f64 / latched as f64);
    summary.outcome = Some(classify(lost, peak, offset));
    summary.peak_motion_m = Some(peak);
    summary.peak_rotation_rad =
        Some(window.iter().map(|s| Motion::between(start, s).rotation.angle()).fold(0.0, f64::max));
    summary.final_offset_m = Some(offset);
    summary.max_penetration_m = Some(window.iter().map(|s| s.penetration).fold(0.0, f64::max));
    summary.creep_m_per_s = if lost { None } else { creep(window, pushed_until) };
    summary.normal_force_total_n = Some(trajectory.normal_forces(first).iter().sum());
    summary.slip_onset_s = window.iter().find(|s| s.slip > SLIP_ONSET).map(|s| s.time);
    summary.step_us_median = median(window.iter().map(|s| s.step_ns as f64 * 1e-3).collect());
    summary
}

/// Every latch and release; a run starts ungrasped.
fn changes(samples: &[Sample]) -> Vec<Change> {
    let mut grasped = false;
    let changed = samples.iter().filter(|s| s.grasped != std::mem::replace(&mut grasped, s.grasped));
    changed.map(|s| Change { time_s: s.time, phase: u8::from(s.grasped) }).collect()
}

/// Held, slid or lost, from the peak and the final offset \[m\].
pub fn classify(lost: bool, peak: f64, final_offset: f64) -> Outcome {
    if lost {
        Outcome::Lost
    } else if final_offset < HELD_OFFSET.max(HELD_SHARE_OF_PEAK * peak) {
        Outcome::Held
    } else {
        Outcome::Slid
    }
}

/// Length of the path in the last second over its time.
fn creep(window: &[Sample], pushed_until: Option<f64>) -> Option<f64> {
    let (first, end) = (window.first()?.time, window.last()?.time);
    let from = end - CREEP_TIME;
    let tolerance = 1e-9;
    if first > from + tolerance || pushed_until.is_some_and(|t| t > from + tolerance) {
        return None;
    }
    let last_second = &window[window.partition_point(|s| s.time < from - tolerance)..];
    let path: f64 = last_second.windows(2).map(|w| (w[1].position - w[0].position).norm()).sum();
    Some(path / (end - last_second.first()?.time))
}

/// Median of finite values; of an even number, the mean of the middle two. `None` of nothing.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(values[n / 2]),
        _ => Some(0.5 * (values[n / 2 - 1] + values[n / 2])),
    }
}

/// The value below which a `share` of the values lies, linear between neighbours. `None` of nothing.
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = share.clamp(0.0, 1.0) * last as f64;
    let (below, above) = (values[at.floor() as usize], values[at.ceil() as usize]);
    Some(below + (above - below) * at.fract())
}
