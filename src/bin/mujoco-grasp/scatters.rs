//! Pictures of `agree`: each trial's motion in grasp mode against full mode. Disagreements bear their trial's number.

use std::path::Path;

use mujoco_grasp::report::{PointSet, Scatter};
use mujoco_grasp::scenario::agree::Trial;
use mujoco_grasp::scenario::checkpoint::Ending;
use mujoco_grasp::scenario::outcome::{LOSS_DISTANCE, Outcome};

use crate::output::complain;
use crate::summary::outcome;

/// Motions below this are drawn there: they are nothing that either mode could be held to \[mm\].
const LEAST_MM: f64 = 0.01;
const OUTCOMES: [Outcome; 3] = [Outcome::Held, Outcome::Slid, Outcome::Lost];

/// The quantity \[m\] that a figure shows.
type Value = fn(&Ending) -> Option<f64>;

/// A trial in a figure.
#[derive(serde::Deserialize)]
pub struct Point {
    trial: u64,
    /// Full mode's.
    #[serde(rename = "full")]
    outcome: Option<Outcome>,
    same_outcome: bool,
    #[serde(rename = "full_peak_motion_m")]
    x: Option<f64>,
    #[serde(rename = "grasp_peak_motion_m")]
    y: Option<f64>,
}

/// Writes `agree-peak.svg` and `agree-final.svg`. Results are there without pictures: what fails is said and left out.
pub fn save(scenario: &str, trials: &[Trial], out: &Path) {
    let figures: [(&str, &str, Value); 2] =
        [("agree-peak.svg", PEAK, |e| e.peak_motion_m), ("agree-final.svg", "final offset", |e| e.final_offset_m)];
    for (file, what, value) in figures {
        let point = |t: &Trial| Point {
            trial: t.trial,
            outcome: t.full.outcome,
            same_outcome: t.compare.same_outcome,
            x: value(&t.full),
            y: value(&t.grasp),
        };
        let points: Vec<Point> = trials.iter().map(point).collect();
        if let Err(e) = scatter(scenario, &points, what).save(out.join(file)) {
            complain("warning", &format!("no {file}: {e}"));
        }
    }
}

const PEAK: &str = "peak motion";

/// The peak motions in `agree-trials.csv`, as an earlier `agree` has written it, and how many trials there are and are alike.
///
/// # Errors
/// A table that is no such one.
pub fn of_table(scenario: &str, csv: &str) -> Result<(Scatter, [usize; 2]), csv::Error> {
    let points = csv::Reader::from_reader(csv.as_bytes()).deserialize().collect::<Result<Vec<Point>, _>>()?;
    let counts = [points.len(), points.iter().filter(|p| p.same_outcome).count()];
    Ok((scatter(scenario, &points, PEAK), counts))
}

fn scatter(scenario: &str, trials: &[Point], what: &str) -> Scatter {
    // What is lost has fallen somewhere; how far says nothing. What failed has no place, and the figure says how many.
    let shown = |v: Option<f64>| v.map_or(f64::NAN, |m| (m.min(LOSS_DISTANCE) * 1e3).max(LEAST_MM));
    let place = |p: &Point| (shown(p.x), shown(p.y));
    let mut sets = Vec::new();
    for kind in OUTCOMES {
        let alike = trials.iter().filter(|t| t.same_outcome && t.outcome == Some(kind));
        let label = format!("{} in both", outcome(Some(kind)));
        sets.push(PointSet { label, points: alike.map(place).collect(), names: Vec::new() });
    }
    for full in OUTCOMES.map(Some).into_iter().chain([None]) {
        let mut differ: Vec<&Point> = trials.iter().filter(|t| !t.same_outcome && t.outcome == full).collect();
        if differ.is_empty() {
            continue;
        }
        // Neighbours have their names on different sides.
        differ.sort_by(|a, b| shown(a.y).total_cmp(&shown(b.y)));
        sets.push(PointSet {
            label: format!("{} in full, not in grasp: trial", full.map_or("failed", |o| outcome(Some(o)))),
            points: differ.iter().map(|t| place(t)).collect(),
            names: differ.iter().map(|t| t.trial.to_string()).collect(),
        });
    }
    let same = trials.iter().filter(|t| t.same_outcome).count();
    Scatter {
        title: format!("{scenario}: {what} of the target, {same} of {} random pushes alike", trials.len()),
        x_label: format!("full: {what} [mm], from {LEAST_MM} to 50"),
        y_label: format!("grasp: {what} [mm], from {LEAST_MM} to 50"),
        sets,
        log: true,
    }
}
