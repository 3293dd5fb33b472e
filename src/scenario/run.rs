//! Whole runs: each push in each mode, in parallel, and what came of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use super::compare::{Comparison, compare};
use super::error::Error;
use super::moment::{Moment, pressing};
use super::outcome::{Summary, summarize};
use super::plan::{Plan, Push};
use super::runner::{Mode, Runner};
use super::trajectory::Trajectory;
use crate::mujoco::{BodyId, Simulation};

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

/// One run: what was recorded until its end, or until it failed. Serialises as its summary, with those of the other grasps.
#[derive(Debug, Serialize)]
pub struct Run {
    /// The mode.
    #[serde(skip)]
    pub mode: Mode,
    /// The push, by name, or "none".
    #[serde(skip)]
    pub push: String,
    /// Every step.
    #[serde(skip)]
    pub trajectory: Trajectory,
    /// In numbers.
    #[serde(flatten)]
    pub summary: Summary,
    /// Why latched steps were not made on frozen geometry, and how many, see
    /// [`Grasps::whole_steps`](crate::grasp::Grasps::whole_steps).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub whole_steps: BTreeMap<&'static str, u64>,
    /// The other grasps of the scenario, if it has any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<OtherGrasp>,
    /// At [`POSES_PER_SECOND`], for pictures.
    #[serde(skip)]
    pub moments: Vec<Moment>,
    /// Why it ended early.
    #[serde(skip)]
    pub error: Option<Error>,
    /// Why its results could not be stored.
    #[serde(skip)]
    pub unwritten: Option<Error>,
    /// What the engine warned of.
    #[serde(skip)]
    pub warnings: Vec<String>,
    /// Highest quality of the run once the target was free \[N\], for those that never latch.
    #[serde(skip)]
    pub best_quality: f64,
    /// The quality that it takes to latch \[N\].
    #[serde(skip)]
    pub latch_quality: f64,
}

impl Run {
    /// `full-fp1`, as in file names.
    pub fn stem(&self) -> String {
        format!("{}-{}", self.mode.name(), self.push)
    }

    /// Writes the trajectory to `MODE-PUSH.csv` in `folder`, and those of other grasps to `MODE-PUSH.grasp1.csv` and so on.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write_csv(&self, folder: &Path) -> Result<PathBuf, Error> {
        let path = folder.join(format!("{}.csv", self.stem()));
        self.trajectory.write_csv(&path)?;
        for other in &self.others {
            other.trajectory.write_csv(&folder.join(format!("{}.grasp{}.csv", self.stem(), other.index)))?;
        }
        Ok(path)
    }
}

/// A grasp besides the one that a run is about.
#[derive(Debug, Serialize)]
pub struct OtherGrasp {
    /// Its place in the scenario file, from 0.
    #[serde(rename = "grasp")]
    pub index: usize,
    /// Name of its target.
    pub target: String,
    /// Name of its palm.
    pub palm: String,
    /// Every step.
    #[serde(skip)]
    pub trajectory: Trajectory,
    /// In numbers.
    #[serde(flatten)]
    pub summary: Summary,
    /// Highest quality of the run once the target was free \[N\].
    #[serde(skip)]
    pub best_quality: f64,
    /// The quality that it takes to latch \[N\].
    #[serde(skip)]
    pub latch_quality: f64,
}

/// Both modes under one push.
#[derive(Debug, Serialize)]
pub struct Pair {
    /// The push, by name, or "none".
    pub push: String,
    /// MuJoCo's own contact solve.
    pub full: Option<Run>,
    /// The grasp controller.
    pub grasp: Option<Run>,
    /// Both, compared.
    pub compare: Option<Comparison>,
}

impl Pair {
    /// The runs that there are, full mode's first.
    pub fn runs(&self) -> impl Iterator<Item = &Run> {
        [&self.full, &self.grasp].into_iter().flatten()
    }
}

/// Compares the runs' grasps one by one.
fn compare_runs(full: &Run, grasp: &Run, measure_from: f64) -> Comparison {
    let mut comparison = compare((&full.trajectory, &full.summary), (&grasp.trajectory, &grasp.summary), measure_from);
    let pairs = full.others.iter().zip(&grasp.others);
    comparison.others =
        pairs.map(|(f, g)| compare((&f.trajectory, &f.summary), (&g.trajectory, &g.summary), measure_from)).collect();
    comparison
}

/// Runs `modes` x `pushes` in parallel. What the plan's [`Stop`](super::stop::Stop) interrupts is left out of the pairs.
///
/// # Errors
/// What prevents a run from starting. A run that fails on its way keeps what it has, and its [`Run::error`]; one that
/// `observer` cannot store has its [`Run::unwritten`].
pub fn run_all(
    plan: &Plan,
    modes: &[Mode],
    pushes: &[Option<&Push>],
    options: Options,
    observer: &Observer<'_>,
) -> Result<Vec<Pair>, Error> {
    let jobs: Vec<(Mode, Option<&Push>)> =
        pushes.iter().flat_map(|&push| modes.iter().map(move |&mode| (mode, push))).collect();
    if let Some(&(mode, push)) = jobs.first() {
        Runner::new(plan, mode, push)?.check_memory(plan, jobs.len())?;
    }
    let finished = |&(mode, push): &(Mode, Option<&Push>)| match run(plan, mode, push, options, observer) {
        Err(Error::Interrupted) => Ok(None),
        other => other.map(Some),
    };
    let mut runs: Vec<Option<Run>> = jobs.par_iter().map(finished).collect::<Result<_, _>>()?;
    let mut pairs = Vec::with_capacity(pushes.len());
    for push in pushes {
        let mut pair = Pair { push: push_name(*push), full: None, grasp: None, compare: None };
        for run in runs.drain(..modes.len()).flatten() {
            match run.mode {
                Mode::Full => pair.full = Some(run),
                Mode::Grasp => pair.grasp = Some(run),
            }
        }
        if let (Some(full), Some(grasp)) = (&pair.full, &pair.grasp) {
            pair.compare = Some(compare_runs(full, grasp, plan.timeline.measure_from()));
        }
        pairs.push(pair);
    }
    Ok(pairs)
}

/// As in file names and on the command line.
fn push_name(push: Option<&Push>) -> String {
    push.map_or_else(|| "none".to_owned(), |p| p.name.clone())
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
    let mut trajectories = runner.trajectories();
    let mut moments: Vec<Moment> = Vec::new();
    let mut error = None;
    let mut steps = 0;
    while !runner.is_over() {
        let time = runner.time();
        let moment = (time >= moments.len() as f64 / POSES_PER_SECOND).then(|| Moment {
            time,
            qpos: runner.sim().qpos().to_vec(),
            contacts: Vec::new(),
        });
        match runner.step() {
            Ok(_) => {
                runner.record(&mut trajectories);
                moments.extend(moment.map(|moment| Moment { contacts: pressing(&runner), ..moment }));
            }
            Err(Error::Interrupted) => return Err(Error::Interrupted),
            Err(failed) => {
                error = Some(failed);
                break;
            }
        }
        steps += 1;
        if steps % REPORT_EVERY == 0 {
            (observer.steps)(REPORT_EVERY);
        }
    }
    (observer.steps)(steps % REPORT_EVERY);
    let pushed_until = push.map(|p| p.end);
    let mut grasps: Vec<OtherGrasp> = trajectories
        .into_iter()
        .zip(runner.grasps())
        .enumerate()
        .map(|(index, (trajectory, grasp))| {
            let mut summary = summarize(&trajectory, plan.timeline.measure_from(), pushed_until);
            if error.is_some() {
                summary.forget_the_end();
            }
            if mode == Mode::Full {
                summary.forget_the_latch();
            }
            let model = runner.sim().model();
            let name = |body: BodyId| model.body_name(body).map_or_else(|| model.label(body), str::to_owned);
            OtherGrasp {
                index,
                target: name(grasp.target()),
                palm: name(grasp.palm()),
                best_quality: best_quality(&trajectory, plan.timeline.pin_until),
                latch_quality: grasp.latch_quality(),
                trajectory,
                summary,
            }
        })
        .collect();
    let OtherGrasp { trajectory, summary, best_quality, latch_quality, .. } = grasps.remove(runner.watched());
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
    let mut run = Run {
        mode,
        push: push_name(push),
        latch_quality,
        trajectory,
        summary,
        whole_steps: runner.grasps().whole_steps().collect(),
        others: grasps,
        moments,
        error,
        unwritten: None,
        warnings,
        best_quality,
    };
    run.unwritten = (observer.finished)(&run).err();
    Ok(run)
}

/// Highest quality from the time on when the target is free: what the pin holds is no grasp.
fn best_quality(trajectory: &Trajectory, pin_until: f64) -> f64 {
    let free = trajectory.index_at(pin_until).unwrap_or(trajectory.samples().len());
    trajectory.samples()[free..].iter().map(|s| s.quality).fold(0.0, f64::max)
}
