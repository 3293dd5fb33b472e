//! Pictures of a run: the target's motion as a plot, and a strip of rendered frames, both modes one above the other.

use std::path::Path;

use mujoco_grasp::report::{Mark, MotionPlot, Push as Shade, Row, Strip, Threshold, Trace};
use mujoco_grasp::scenario::outcome::Motion;
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::Pair;

use crate::artist::{Artist, pose_at, pushing};
use crate::output::{complain, message};
use crate::progress::Progress;

const FRAME: (u32, u32) = (400, 320);
/// Frames of a strip, one for each column.
const COLUMNS: usize = 6;
/// Plots stop here: what is lost falls for metres \[mm\].
pub const PLOTTED_MOTION_MM: f64 = 60.0;
/// So much of what is plotted is before the latch.
const BEFORE: f64 = 0.05;

/// Plots begin here \[s\]: shortly before the grasp latches or measuring starts. The way of the hand to its target would take the
/// room of what happens in it.
pub fn plotted_from(plan: &Plan, latched_at: Option<f64>) -> f64 {
    let timeline = plan.timeline;
    let first = timeline.measure_from().min(latched_at.unwrap_or(f64::INFINITY));
    (first - BEFORE * (timeline.duration - first)).max(0.0)
}

/// Writes `motion-PUSH.svg` and `strip-PUSH.png` for each push. Results are there without pictures: what fails is said
/// and left out.
pub fn save_all(plan: &Plan, pairs: &[Pair], out: &Path) {
    let progress = Progress::new(pairs.len() as u64, "drawing");
    let mut artist = match Artist::new(plan, FRAME) {
        Ok(artist) => Some(artist),
        Err(e) => {
            complain("warning", &format!("no rendered frames: {}", message(&e)));
            None
        }
    };
    for pair in pairs.iter().filter(|p| p.runs().next().is_some()).take_while(|_| !plan.stop.is_asked()) {
        let push = plan.pushes.iter().find(|p| p.name == pair.push);
        if let Err(e) = motion(plan, pair, push, &out.join(format!("motion-{}.svg", pair.push))) {
            complain("warning", &format!("no plot of push {}: {}", pair.push, message(&e)));
        }
        if let Some(artist) = &mut artist
            && let Err(e) = strip(artist, plan, pair, push, &out.join(format!("strip-{}.png", pair.push)))
        {
            complain("warning", &format!("no frames of push {}: {}", pair.push, message(&e)));
        }
        progress.advance(1);
    }
    progress.finish();
}

/// The push and its force, for titles.
pub fn describe(push: Option<&Push>) -> String {
    push.map_or_else(
        || "no push".to_owned(),
        |p| {
            let vector = |v: &nalgebra::Vector3<f64>| format!("({:.3}, {:.3}, {:.3})", v.x, v.y, v.z);
            let torque = if p.torque.norm() > 0.0 { format!(", {} N m", vector(&p.torque)) } else { String::new() };
            format!("{}: {} N{torque}", p.name, vector(&p.force))
        },
    )
}

fn motion(plan: &Plan, pair: &Pair, push: Option<&Push>, path: &Path) -> anyhow::Result<()> {
    let mut marks = Vec::new();
    let mut traces = Vec::new();
    let mut thresholds = Vec::new();
    for run in pair.runs() {
        let trajectory = &run.trajectory;
        let Some(first) = trajectory.index_at(plan.timeline.measure_from()) else { continue };
        let samples = trajectory.samples();
        let mut trace = Trace { label: run.mode.name().to_owned(), ..Trace::default() };
        for (i, sample) in samples.iter().enumerate() {
            let moved = Motion::between(&samples[first], sample);
            trace.time_s.push(sample.time);
            trace.position_mm.push((moved.offset * 1e3).into());
            trace.rotation_deg.push(moved.rotation.angle().to_degrees());
            trace.normal_force_n.push(trajectory.normal_forces(i).iter().sum());
            trace.quality_n.push(sample.quality);
        }
        traces.push(trace);
        let events = [("latched", run.summary.latched_at_s), ("released", run.summary.released_at_s)];
        marks.extend(
            events.into_iter().filter_map(|(label, at)| at.map(|time_s| Mark { time_s, label: label.to_owned() })),
        );
        thresholds = vec![Threshold { quality_n: run.latch_quality, label: "Q_Th".to_owned() }];
    }
    let end = plan.timeline.duration;
    MotionPlot {
        title: format!("{}, {}", plan.name, describe(push)),
        push: push.map(|p| Shade { start_s: p.start, end_s: p.end, label: describe(Some(p)) }),
        marks,
        thresholds,
        traces,
        window_s: Some((plotted_from(plan, pair.grasp.as_ref().and_then(|run| run.summary.latched_at_s)), end)),
        motion_limit_mm: Some(PLOTTED_MOTION_MM),
    }
    .save(path)?;
    Ok(())
}

/// Frames at telling times, both modes.
fn strip(artist: &mut Artist, plan: &Plan, pair: &Pair, push: Option<&Push>, path: &Path) -> anyhow::Result<()> {
    let times = times(plan, push);
    let Some(first) = pair.runs().find_map(|run| pose_at(run, times[0])) else {
        anyhow::bail!("the run ended before there was anything to see");
    };
    let camera = artist.camera(plan, first)?;
    let mut rows = Vec::new();
    for run in pair.runs() {
        let mut frames = Vec::new();
        for &time in &times {
            if let Some(pose) = pose_at(run, time) {
                frames.push((time, artist.frame(pose, camera, pushing(push, time))?));
            }
        }
        rows.push(Row { label: run.mode.name().to_owned(), frames });
    }
    Strip::new(format!("{}, {}", plan.name, describe(push)), rows).save(path)?;
    Ok(())
}

/// Just before the push, during it, and a little after; without a push all of the measured time.
fn times(plan: &Plan, push: Option<&Push>) -> Vec<f64> {
    let end = plan.timeline.duration - 0.05;
    let (from, to) = push.map_or((plan.timeline.measure_from(), end), |p| {
        ((p.start - 0.1).max(plan.timeline.measure_from()), (p.end + 0.4).min(end))
    });
    (0..COLUMNS).map(|i| from + (to - from) * i as f64 / (COLUMNS - 1) as f64).collect()
}
