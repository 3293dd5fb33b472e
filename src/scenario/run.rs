//! Whole runs: each push in each mode, in parallel, and what came of it.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use super::compare::{Comparison, compare};
use super::error::Error;
use super::outcome::{Summary, summarize};
use super::plan::{Plan, Push};
use super::runner::{Mode, Runner};
use super::trajectory::Trajectory;
use crate::mujoco::Simulation;

/// Poses kept for pictures, per second of simulation.
pub const POSES_PER_SECOND: f64 = 25.0;

/// What to run, besides the scenario.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Iterations of MuJoCo's noslip solver, all of them made; `None`: as the MJCF has it, where they end at a tolerance. In
    /// both modes, so that before the latch and after the release these are the same.
    pub noslip: Option<usize>,
}

impl Options {
    /// Sets MuJoCo's noslip solver.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn set_noslip(&self, sim: &mut Simulation) -> Result<(), Error> {
        if let Some(noslip) = self.noslip {
            sim.set_noslip_iterations(noslip)?;
            sim.set_noslip_tolerance(0.0)?;
        }
        Ok(())
    }
}

/// Who is told how runs go, from several threads at once.
pub struct Observer<'a> {
    /// So many more steps were made.
    pub steps: &'a (dyn Fn(u64) + Sync),
    /// A run is over.
    pub finished: &'a (dyn Fn(&Run) -> Result<(), Error> + Sync),
}

impl Observer<'_> {
    /// Nobody is told.
    pub const NOBODY: Observer<'static> = Observer { steps: &|_| (), finished: &|_| Ok(()) };
}

/// One run: what was recorded until its end, or until it failed.
#[derive(Debug)]
pub struct Run {
    /// The mode.
    pub mode: Mode,
    /// The push, by name, or "none".
    pub push: String,
    /// Every step.
    pub trajectory: Trajectory,
    /// In numbers.
    pub summary: Summary,
    /// (time \[s\], qpos) at [`POSES_PER_SECOND`], for pictures.
    pub poses: Vec<(f64, Vec<f64>)>,
    /// Why it ended early.
    pub error: Option<Error>,
    /// What the engine warned of.
    pub warnings: Vec<String>,
    /// Highest quality of the run \[N\], for those that never latch.
    pub best_quality: f64,
    /// The quality that it takes to latch \[N\].
    pub latch_quality: f64,
}

impl Run {
    /// `full-fp1`, as in file names.
    pub fn stem(&self) -> String {
        format!("{}-{}", self.mode.name(), self.push)
    }

    /// Writes the trajectory to `MODE-PUSH.csv` in `folder`.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write_csv(&self, folder: &Path) -> Result<PathBuf, Error> {
        let path = folder.join(format!("{}.csv", self.stem()));
        self.trajectory.write_csv(&path)?;
        Ok(path)
    }
}

/// Both modes under one push.
#[derive(Debug, Serialize)]
pub struct Pair {
    /// The push, by name, or "none".
    pub push: String,
    /// MuJoCo's own contact solve.
    #[serde(serialize_with = "as_summary")]
    pub full: Option<Run>,
    /// The grasp controller.
    #[serde(serialize_with = "as_summary")]
    pub grasp: Option<Run>,
    /// Both, compared.
    pub compare: Option<Comparison>,
}

fn as_summary<S: serde::Serializer>(run: &Option<Run>, serializer: S) -> Result<S::Ok, S::Error> {
    run.as_ref().map(|r| &r.summary).serialize(serializer)
}

/// Runs `modes` x `pushes` in parallel. A result that cannot be stored ends them all.
///
/// # Errors
/// What prevents a run from starting, and what `observer` reports; a run that fails on its way keeps what it has, and its [`Run::error`].
pub fn run_all(
    plan: &Plan,
    modes: &[Mode],
    pushes: &[Option<&Push>],
    options: Options,
    observer: &Observer<'_>,
) -> Result<Vec<Pair>, Error> {
    let jobs: Vec<(Mode, Option<&Push>)> =
        pushes.iter().flat_map(|&push| modes.iter().map(move |&mode| (mode, push))).collect();
    let mut runs: Vec<Run> =
        jobs.par_iter().map(|&(mode, push)| run(plan, mode, push, options, observer)).collect::<Result<_, _>>()?;
    let mut pairs = Vec::with_capacity(pushes.len());
    for _ in pushes {
        let mut pair = Pair { push: String::new(), full: None, grasp: None, compare: None };
        for run in runs.drain(..modes.len()) {
            pair.push.clone_from(&run.push);
            match run.mode {
                Mode::Full => pair.full = Some(run),
                Mode::Grasp => pair.grasp = Some(run),
            }
        }
        if let (Some(full), Some(grasp)) = (&pair.full, &pair.grasp) {
            let measure_from = plan.timeline.measure_from();
            pair.compare =
                Some(compare((&full.trajectory, &full.summary), (&grasp.trajectory, &grasp.summary), measure_from));
        }
        pairs.push(pair);
    }
    Ok(pairs)
}

/// One run from start to end.
///
/// # Errors
/// As [`run_all`].
pub fn run(
    plan: &Plan,
    mode: Mode,
    push: Option<&Push>,
    options: Options,
    observer: &Observer<'_>,
) -> Result<Run, Error> {
    const REPORT_EVERY: u64 = 100;
    let mut runner = Runner::new(plan, mode, push)?;
    options.set_noslip(runner.sim_mut())?;
    let mut trajectory = runner.trajectory();
    let mut poses = Vec::new();
    let mut error = None;
    let mut steps = 0;
    while !runner.is_over() {
        let time = runner.time();
        if time >= poses.len() as f64 / POSES_PER_SECOND {
            poses.push((time, runner.sim().qpos().to_vec()));
        }
        match runner.step() {
            Ok(sample) => trajectory.push(sample, runner.normal_forces()),
            Err(source) => {
                let what = format!("{} mode, push {}", mode.name(), push.map_or("none", |p| &p.name));
                error = Some(Error::Step { what, time, source });
                break;
            }
        }
        steps += 1;
        if steps % REPORT_EVERY == 0 {
            (observer.steps)(REPORT_EVERY);
        }
    }
    (observer.steps)(steps % REPORT_EVERY);
    let mut summary = summarize(&trajectory, plan.timeline.measure_from(), push.map(|p| p.end));
    if error.is_some() {
        // How it would have ended is not known.
        summary.outcome = None;
        summary.final_offset_m = None;
        summary.creep_m_per_s = None;
    }
    let best_quality = trajectory.samples().iter().map(|s| s.quality).fold(0.0, f64::max);
    let warnings = runner
        .sim_mut()
        .take_warnings()
        .into_iter()
        .map(|w| {
            if w.text.is_empty() {
                format!("{:?} ({} times, last at {:.3} s)", w.kind, w.count, w.time)
            } else {
                w.text
            }
        })
        .collect();
    let run = Run {
        mode,
        push: push.map_or_else(|| "none".to_owned(), |p| p.name.clone()),
        latch_quality: runner.grasp().latch_quality(),
        trajectory,
        summary,
        poses,
        error,
        warnings,
        best_quality,
    };
    (observer.finished)(&run)?;
    Ok(run)
}
