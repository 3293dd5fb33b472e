//! What `run` reports: its JSON object and its tables.

use std::path::Path;

use mujoco_grasp::scenario::compare::Comparison;
use mujoco_grasp::scenario::outcome::{Outcome, Summary};
use mujoco_grasp::scenario::run::Pair;
use mujoco_grasp::scenario::runner::Mode;

use crate::output::{number, table};
use serde::Serialize;

/// The JSON object of `run`.
#[derive(Serialize)]
pub struct Report<'a> {
    pub scenario: &'a str,
    pub engine: String,
    pub nv: usize,
    pub timestep_s: f64,
    pub runs: &'a [Pair],
    /// What `--at-onset` found; `None` without it.
    pub at_onset: Option<AtOnset>,
    /// As on standard error.
    pub warnings: Vec<String>,
    /// Only when a run failed on its way, could not be stored, or was interrupted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// Pushes scaled to a share of their onset.
#[derive(Serialize)]
pub struct AtOnset {
    /// Share of the smallest push that full mode does not hold.
    pub share: f64,
    pub pushes: Vec<ScaledPush>,
}

/// One of them.
#[derive(Serialize)]
pub struct ScaledPush {
    pub push: String,
    /// The scenario's push times this is the smallest that full mode does not hold; `None`: not found, and left as it is.
    pub onset_factor: Option<f64>,
    /// Force and torque of that \[N, N m\].
    #[serde(skip)]
    pub onset: Option<[f64; 2]>,
    /// As it is pushed.
    pub force_n: [f64; 3],
    /// As it is pushed.
    pub torque_nm: [f64; 3],
}

/// Heads of [`row`].
pub const HEADS: [&str; 13] = [
    "push",
    "mode",
    "outcome",
    "latched s",
    "released s",
    "latched %",
    "peak mm",
    "final mm",
    "sinks in mm",
    "creep um/s",
    "squeeze N",
    "slips at s",
    "step us",
];
/// Heads of [`comparison`].
pub const COMPARED: [&str; 6] =
    ["push", "same outcome", "position rmse mm", "relative", "rotation rmse mrad", "normal force"];

/// All that `run` says.
pub fn text(report: &Report<'_>, notes: &[String], out: &Path) -> String {
    let mut text = format!(
        "{}: {} degrees of freedom, MuJoCo {}, steps of {} ms\n\n",
        report.scenario,
        report.nv,
        report.engine,
        report.timestep_s * 1e3,
    );
    if let Some(found) = &report.at_onset {
        text.push_str(&format!("{}\n", onsets(found)));
    }
    text.push_str(&runs(report.runs));
    let compared = comparisons(report.runs);
    if compared.len() > 1 {
        text.push_str(&format!("\ngrasp mode against full\n{}", table(&compared)));
    }
    if report.runs.iter().filter_map(|p| p.compare.as_ref()).any(|c| c.vacuous || c.others.iter().any(|o| o.vacuous)) {
        text.push_str(
            "says nothing: grasp mode was latched for none of the compared time, so both modes were the same simulation\n",
        );
    }
    for note in notes {
        text.push_str(&format!("{note}\n"));
    }
    text.push_str(&format!("\nwritten to {}\n", out.display()));
    text
}

fn onsets(found: &AtOnset) -> String {
    let mut rows =
        vec![["push", "onset, times the push", "N", "N m", "pushed with N", "N m"].map(str::to_owned).to_vec()];
    let size = |v: &[f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    for push in &found.pushes {
        rows.push(vec![
            push.push.clone(),
            number(push.onset_factor, 1.0, 4),
            number(push.onset.map(|[force, _]| force), 1.0, 4),
            number(push.onset.map(|[_, torque]| torque), 1.0, 5),
            number(Some(size(&push.force_n)), 1.0, 4),
            number(Some(size(&push.torque_nm)), 1.0, 5),
        ]);
    }
    format!("smallest push that full mode does not hold, and {} of it\n{}", found.share, table(&rows))
}

fn runs(pairs: &[Pair]) -> String {
    let mut rows = vec![HEADS.map(str::to_owned).to_vec()];
    for pair in pairs {
        for run in pair.runs() {
            rows.push(row(pair.push.clone(), run.mode, &run.summary));
            for other in &run.others {
                rows.push(row(format!("{} ({})", pair.push, other.palm), run.mode, &other.summary));
            }
        }
    }
    table(&rows)
}

fn comparisons(pairs: &[Pair]) -> Vec<Vec<String>> {
    let mut rows = vec![COMPARED.map(str::to_owned).to_vec()];
    for pair in pairs {
        if let Some(c) = &pair.compare {
            rows.push(comparison(pair.push.clone(), c));
            let palms = pair.full.iter().flat_map(|run| run.others.iter().map(|o| &o.palm));
            for (other, palm) in c.others.iter().zip(palms) {
                rows.push(comparison(format!("{} ({palm})", pair.push), other));
            }
        }
    }
    rows
}

/// One run in numbers.
pub fn row(push: String, mode: Mode, s: &Summary) -> Vec<String> {
    vec![
        push,
        mode.name().to_owned(),
        outcome(s.outcome).to_owned(),
        number(s.latched_at_s, 1.0, 3),
        number(s.released_at_s, 1.0, 3),
        number(s.latched_share, 100.0, 1),
        number(s.peak_motion_m, 1e3, 3),
        number(s.final_offset_m, 1e3, 3),
        number(s.max_penetration_m, 1e3, 3),
        number(s.creep_m_per_s, 1e6, 3),
        number(s.normal_force_total_n, 1.0, 3),
        number(s.slip_onset_s, 1.0, 3),
        number(s.step_us_median, 1.0, 1),
    ]
}

/// Both modes compared.
pub fn comparison(push: String, c: &Comparison) -> Vec<String> {
    let same = match (c.vacuous, c.same_outcome) {
        (true, _) => "says nothing",
        (false, true) => "yes",
        (false, false) => "NO",
    };
    vec![
        push,
        same.to_owned(),
        number(c.position_rmse_m, 1e3, 4),
        number(c.relative_error, 100.0, 2) + " %",
        number(c.rotation_rmse_rad, 1e3, 3),
        number(c.normal_force_relative_error, 100.0, 2) + " %",
    ]
}

/// In tables; "-" for a run that failed.
pub fn outcome(outcome: Option<Outcome>) -> &'static str {
    match outcome {
        Some(Outcome::Held) => "held",
        Some(Outcome::Slid) => "slid",
        Some(Outcome::Lost) => "lost",
        None => "-",
    }
}
