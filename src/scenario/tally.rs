//! Random pushes counted: the JSON object of `agree`, and its tables.

use std::path::Path;

use serde::{Serialize, Serializer};

use super::agree::{Onset, Trial};
use super::checkpoint::Ending;
use super::draw::{Kind, directions};
use super::error::Error;
use super::outcome::{Outcome, median, quantile};
use super::rows;

/// Peaks of the rotation smaller than this do not make a relative error larger \[rad\].
pub const SMALLEST_ROTATION: f64 = 0.02;
/// A difference of less counts as none \[m\].
pub const NO_DIFFERENCE: f64 = 1e-4;

/// How often and how closely the modes agree. Counts are by full mode's outcome; numbers that do not exist are `None`.
#[derive(Debug, Serialize)]
pub struct Tally {
    /// Pushes that were made.
    pub trials: usize,
    /// Of them those in which grasp mode was latched for none of the compare window: they say nothing, and no other figure
    /// but the counts by outcome takes them in.
    pub vacuous_trials: usize,
    /// Of the rest held, slid or lost alike.
    pub same_outcome: usize,
    /// `same_outcome` over `trials - vacuous_trials`.
    pub agreement: Option<f64>,
    /// Disagreements in which full mode itself has another outcome with 10 times the noslip iterations from the start of the
    /// push on. `None` without any noslip iterations.
    pub chaotic_trials: Option<usize>,
    /// Of the steps from `measure_from` to the last touch, those that were latched: over held and slid trials.
    pub latched_share: Spread,
    /// Of those, the ones with hand and object stepped apart from the arm.
    pub substructured_share: Spread,
    /// Full mode held.
    pub held: Held,
    /// Full mode slid.
    pub slid: Slid,
    /// Full mode lost it.
    pub lost: Lost,
    /// The simulation failed in one mode or both: never a same outcome, and in no other count if it was full mode's.
    pub failed: usize,
    /// Difference of the times from the start of the push to the slip's onset over full mode's, where both slip after it.
    pub slip_onset_relative_error_median: Option<f64>,
    /// Of the directions that have an onset in both modes.
    pub onset_relative_error_median: Option<f64>,
    /// Directions with an onset in one mode and none in the other.
    pub onsets_in_one_mode_only: usize,
    /// Every direction's.
    pub onsets: Vec<OnsetEntry>,
    /// Trials with different outcomes, or with a simulation that failed.
    pub disagreements: Vec<Disagreement>,
}

/// The middle and the low end of a share.
#[derive(Debug, Serialize)]
pub struct Spread {
    /// Half of the trials are above.
    pub median: Option<f64>,
    /// Nine tenths of the trials are above.
    pub p10: Option<f64>,
}

impl Spread {
    fn of(values: Vec<f64>) -> Self {
        Self { median: median(values.clone()), p10: quantile(values, 0.1) }
    }
}

/// Trials that full mode held.
#[derive(Debug, Serialize)]
pub struct Held {
    /// How many.
    pub count: usize,
    /// In grasp mode too.
    pub same_outcome: usize,
    /// Of [`counted_error`].
    pub median_relative_error: Option<f64>,
    /// Of the same, the ninth decile.
    pub p90_relative_error: Option<f64>,
    /// The largest relative error of the motion as it is, without [`NO_DIFFERENCE`].
    pub worst_relative_error: Option<f64>,
    /// RMS angle between the motions over the larger of full mode's peak rotation and 0.02 rad, median.
    pub rotation_relative_error: Option<f64>,
    /// RMS difference of the links' normal forces over RMS of full mode's, median.
    pub normal_force_relative_error: Option<f64>,
    /// RMS difference of the motions as it is \[m\].
    pub median_position_rmse_m: Option<f64>,
    /// Its ninth decile.
    pub p90_position_rmse_m: Option<f64>,
}

/// Trials that slid in full mode.
#[derive(Debug, Serialize)]
pub struct Slid {
    /// How many.
    pub count: usize,
    /// In grasp mode too.
    pub same_outcome: usize,
    /// Of [`counted_offset_error`].
    pub median_final_offset_relative_error: Option<f64>,
    /// Difference of the final offsets as it is \[m\].
    pub median_final_offset_difference_m: Option<f64>,
}

/// Trials that full mode lost.
#[derive(Debug, Serialize)]
pub struct Lost {
    /// How many.
    pub count: usize,
    /// In grasp mode too.
    pub same_outcome: usize,
}

/// One direction.
#[derive(Debug, Serialize)]
pub struct OnsetEntry {
    /// Force or torque.
    pub kind: Kind,
    /// Unit vector, world axes.
    pub direction: [f64; 3],
    /// Smallest size that full mode does not hold \[N or N m\].
    pub full: Option<f64>,
    /// Smallest size that grasp mode does not hold.
    pub grasp: Option<f64>,
}

/// One trial on which the modes disagree.
#[derive(Debug, Serialize)]
pub struct Disagreement {
    /// Its number.
    pub trial: u64,
    /// World axes.
    pub force_n: [f64; 3],
    /// World axes.
    pub torque_nm: [f64; 3],
    /// Of the push.
    pub duration_s: f64,
    /// Size over full mode's onset.
    pub size_over_onset: f64,
    /// Full mode's outcome.
    #[serde(serialize_with = "outcome_only")]
    pub full: Ending,
    /// Grasp mode's.
    #[serde(serialize_with = "outcome_only")]
    pub grasp: Ending,
    /// Grasp mode was latched for none of the compare window; not counted as a disagreement.
    pub vacuous: bool,
    /// Full mode itself has another outcome with 10 times the noslip iterations. `None` without any.
    pub chaotic: Option<bool>,
    /// Why a simulation failed, if one did.
    pub error: Option<String>,
    /// Full mode's final offset \[m\].
    pub full_final_offset_m: Option<f64>,
    /// Grasp mode's.
    pub grasp_final_offset_m: Option<f64>,
}

fn outcome_only<S: Serializer>(ending: &Ending, serializer: S) -> Result<S::Ok, S::Error> {
    ending.outcome.serialize(serializer)
}

impl Tally {
    /// Counts. `noslip`: iterations of full mode.
    pub fn new(onsets: &[Onset], trials: &[Trial], noslip: usize) -> Self {
        let by_full = |outcome: Outcome| trials.iter().filter(move |t| t.full.outcome == Some(outcome));
        let telling = |outcome: Outcome| by_full(outcome).filter(|t| !t.compare.vacuous);
        let alike = |outcome: Outcome| telling(outcome).filter(|t| t.compare.same_outcome).count();
        let of_held = |f: fn(&Trial) -> Option<f64>| -> Vec<f64> { telling(Outcome::Held).filter_map(f).collect() };
        let of_slid = |f: fn(&Trial) -> Option<f64>| -> Vec<f64> { telling(Outcome::Slid).filter_map(f).collect() };
        let kept = |f: fn(&Trial) -> Option<f64>| -> Vec<f64> {
            by_full(Outcome::Held).chain(by_full(Outcome::Slid)).filter_map(f).collect()
        };
        let vacuous_trials = trials.iter().filter(|t| t.compare.vacuous).count();
        let counted = trials.len() - vacuous_trials;
        let same_outcome = trials.iter().filter(|t| t.compare.same_outcome && !t.compare.vacuous).count();
        let slips = trials.iter().filter(|t| !t.compare.vacuous).filter_map(slip_onset_error);
        Self {
            trials: trials.len(),
            vacuous_trials,
            same_outcome,
            agreement: (counted > 0).then(|| same_outcome as f64 / counted as f64),
            chaotic_trials: (noslip > 0)
                .then(|| trials.iter().filter(|t| !t.compare.vacuous && t.chaotic == Some(true)).count()),
            latched_share: Spread::of(kept(|t| t.grasp.latched_share)),
            substructured_share: Spread::of(kept(|t| t.grasp.substructured_share)),
            held: Held {
                count: by_full(Outcome::Held).count(),
                same_outcome: alike(Outcome::Held),
                median_relative_error: median(of_held(counted_error)),
                p90_relative_error: quantile(of_held(counted_error), 0.9),
                worst_relative_error: of_held(|t| t.compare.relative_error).into_iter().reduce(f64::max),
                rotation_relative_error: median(of_held(rotation_error)),
                normal_force_relative_error: median(of_held(|t| t.compare.normal_force_relative_error)),
                median_position_rmse_m: median(of_held(|t| t.compare.position_rmse_m)),
                p90_position_rmse_m: quantile(of_held(|t| t.compare.position_rmse_m), 0.9),
            },
            slid: Slid {
                count: by_full(Outcome::Slid).count(),
                same_outcome: alike(Outcome::Slid),
                median_final_offset_relative_error: median(of_slid(counted_offset_error)),
                median_final_offset_difference_m: median(of_slid(offset_difference)),
            },
            lost: Lost { count: by_full(Outcome::Lost).count(), same_outcome: alike(Outcome::Lost) },
            failed: trials.iter().filter(|t| failure(t).is_some()).count(),
            slip_onset_relative_error_median: median(slips.collect()),
            onset_relative_error_median: median(onsets.iter().filter_map(Onset::relative_error).collect()),
            onsets_in_one_mode_only: onsets.iter().filter(|o| o.full.is_some() != o.grasp.is_some()).count(),
            onsets: onsets.iter().map(OnsetEntry::new).collect(),
            disagreements: trials.iter().filter(|t| !t.compare.same_outcome).map(Disagreement::new).collect(),
        }
    }
}

impl OnsetEntry {
    fn new(onset: &Onset) -> Self {
        let Onset { direction, full, grasp } = *onset;
        Self { kind: direction.kind, direction: direction.unit.into(), full, grasp }
    }
}

impl Disagreement {
    fn new(trial: &Trial) -> Self {
        Self {
            trial: trial.trial,
            force_n: trial.push.force.into(),
            torque_nm: trial.push.torque.into(),
            duration_s: trial.push.end - trial.push.start,
            size_over_onset: trial.share,
            full: trial.full.clone(),
            grasp: trial.grasp.clone(),
            vacuous: trial.compare.vacuous,
            chaotic: trial.chaotic,
            error: failure(trial),
            full_final_offset_m: trial.full.final_offset_m,
            grasp_final_offset_m: trial.grasp.final_offset_m,
        }
    }
}

/// The relative error of the motion; 0 where the motions differ by less than [`NO_DIFFERENCE`].
pub fn counted_error(trial: &Trial) -> Option<f64> {
    let none = trial.compare.position_rmse_m? < NO_DIFFERENCE;
    if none { Some(0.0) } else { trial.compare.relative_error }
}

fn rotation_error(trial: &Trial) -> Option<f64> {
    let peak = trial.full.peak_rotation_rad?;
    trial.compare.rotation_rmse_rad.map(|rmse| rmse / peak.max(SMALLEST_ROTATION))
}

/// Of the times from the start of the push to the slip's onset; `None` where a mode does not slip, or slipped before.
fn slip_onset_error(trial: &Trial) -> Option<f64> {
    let since = |onset: Option<f64>| onset.map(|t| t - trial.push.start).filter(|&t| t > 0.0);
    since(trial.full.slip_onset_s).zip(since(trial.grasp.slip_onset_s)).map(|(full, grasp)| (grasp - full).abs() / full)
}

/// Difference of the final offsets over full mode's; 0 where it is below [`NO_DIFFERENCE`].
pub fn counted_offset_error(trial: &Trial) -> Option<f64> {
    let difference = offset_difference(trial)?;
    let none = difference < NO_DIFFERENCE;
    if none { Some(0.0) } else { trial.full.final_offset_m.filter(|&f| f > 0.0).map(|full| difference / full) }
}

fn offset_difference(trial: &Trial) -> Option<f64> {
    trial.full.final_offset_m.zip(trial.grasp.final_offset_m).map(|(full, grasp)| (grasp - full).abs())
}

/// Why the simulation failed in either mode.
pub fn failure(trial: &Trial) -> Option<String> {
    let errors: Vec<&str> = [&trial.full, &trial.grasp].into_iter().filter_map(|e| e.error.as_deref()).collect();
    (!errors.is_empty()).then(|| errors.join("; "))
}

/// Writes the onsets of all directions, a row for each.
///
/// # Errors
/// [`Error::Write`].
pub fn write_onsets(onsets: &[Onset], path: &Path) -> Result<(), Error> {
    let all = directions();
    let rows = onsets.iter().map(|o| {
        let u = o.direction.unit;
        let number = all.iter().position(|d| *d == o.direction);
        (number, o.direction.kind, (u.x, u.y, u.z), (o.full, o.grasp, o.relative_error()))
    });
    let head = ["direction", "kind", "x", "y", "z", "full_onset", "grasp_onset", "relative_error"];
    rows::write(path, head.iter().map(ToString::to_string), rows)
}

const TRIAL_COLUMNS: [&str; 26] = [
    "trial",
    "direction",
    "kind",
    "force_x_n",
    "force_y_n",
    "force_z_n",
    "torque_x_nm",
    "torque_y_nm",
    "torque_z_nm",
    "duration_s",
    "size_over_onset",
    "full",
    "grasp",
    "same_outcome",
    "relative_error",
    "position_rmse_m",
    "full_peak_motion_m",
    "grasp_peak_motion_m",
    "full_final_offset_m",
    "grasp_final_offset_m",
    "full_slip_onset_s",
    "grasp_slip_onset_s",
    "latched_share",
    "vacuous",
    "chaotic",
    "error",
];

/// Writes all trials, a row for each; numbers as they are, without [`NO_DIFFERENCE`].
///
/// # Errors
/// [`Error::Write`].
pub fn write_trials(onsets: &[Onset], trials: &[Trial], path: &Path) -> Result<(), Error> {
    let rows = trials.iter().map(|t| {
        let (f, m) = (t.push.force, t.push.torque);
        let (full, grasp, c) = (&t.full, &t.grasp, &t.compare);
        (
            (t.trial, t.direction, onsets[t.direction].direction.kind),
            (f.x, f.y, f.z, m.x, m.y, m.z),
            (t.push.end - t.push.start, t.share),
            (full.outcome, grasp.outcome, c.same_outcome, c.relative_error, c.position_rmse_m),
            (full.peak_motion_m, grasp.peak_motion_m, full.final_offset_m, grasp.final_offset_m),
            (full.slip_onset_s, grasp.slip_onset_s),
            (grasp.latched_share, c.vacuous, t.chaotic, failure(t)),
        )
    });
    rows::write(path, TRIAL_COLUMNS.iter().map(ToString::to_string), rows)
}
