//! `mujoco-grasp view`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::view::{Digest, Recording, Summary, show};
use serde::Serialize;

use crate::output::{Output, number, table};
use crate::run::LimitsArg;
use crate::signals;

/// `view SCENARIO`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A built-in scenario's name, or the path of a scenario file.
    scenario: String,
    /// Bounds every grasp in this way, whatever the scenario says.
    #[arg(long, value_enum)]
    limits: Option<LimitsArg>,
    /// Writes what is done to the simulation to this file when the window is closed.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Does what was recorded in this file, and pauses at its end.
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
}

/// What was seen, as JSON.
#[derive(Debug, Serialize)]
struct Report {
    scenario: String,
    engine: String,
    steps: u64,
    digest: Option<Digest>,
    same_as_replayed: Option<bool>,
    frames: u64,
    frames_per_second: Option<f64>,
    drawing_ms: Option<f64>,
}

/// Shows the scenario until the window is closed.
pub fn view(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let mut plan = Plan::load_with(&args.scenario, args.limits.map(LimitsArg::limits))?;
    plan.stop = signals::stop();
    let replay = args.replay.as_deref().map(|file| Recording::read(file, &plan)).transpose()?;
    let mut ended = None;
    let shown = show(&plan, replay, &mut ended);
    // What was done is kept, however it ended; a window that was never there leaves no file.
    let ended = ended.filter(|summary| summary.frames > 0);
    if let (Some(summary), Some(file)) = (&ended, &args.record) {
        summary.recording.write(file)?;
    }
    shown?;
    let Some(summary) = ended else { bail!("the window was closed before anything was drawn") };
    let report = report(summary);
    output.write(&report, || text(&report))?;
    Ok(ExitCode::SUCCESS)
}

fn report(summary: Summary) -> Report {
    let Summary { recording, same_as_replayed, frames, shown_s, drawing_s } = summary;
    Report {
        scenario: recording.scenario,
        engine: recording.engine,
        steps: recording.steps,
        digest: recording.digest,
        same_as_replayed,
        frames,
        frames_per_second: (frames > 1).then(|| (frames - 1) as f64 / shown_s),
        drawing_ms: (frames > 0).then(|| 1e3 * drawing_s / frames as f64),
    }
}

fn text(report: &Report) -> String {
    let row = |name: &str, value: String| vec![name.to_owned(), value];
    let mut rows = vec![
        row("steps", report.steps.to_string()),
        row("digest", report.digest.map_or_else(String::new, |d| d.to_string())),
        row("frames per second", number(report.frames_per_second, 1.0, 1)),
        row("time to draw one", format!("{} ms", number(report.drawing_ms, 1.0, 1))),
    ];
    if let Some(same) = report.same_as_replayed {
        rows.push(row("same as recorded", if same { "yes, bit for bit" } else { "no" }.to_owned()));
    }
    table(&rows)
}
