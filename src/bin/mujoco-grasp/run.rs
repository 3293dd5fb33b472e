//! `mujoco-grasp run`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueEnum;
use mujoco_grasp::grasp::Limits;
use mujoco_grasp::mujoco;
use mujoco_grasp::scenario::Error;
use mujoco_grasp::scenario::onset::{full_at_measure, onset};
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::{Observer, Options, Pair, Run, run_all};
use mujoco_grasp::scenario::runner::{Mode, Runner};
use rayon::prelude::*;

use crate::output::{FAILURE, Output, complain, folder, message, unwritten};
use crate::progress::Progress;
use crate::summary::{self, AtOnset, Report, ScaledPush};
use crate::{leftovers, signals, warnings};

/// `run SCENARIO`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A built-in scenario's name, or the path of a scenario file.
    scenario: String,
    /// MuJoCo's own contact solve, the grasp controller, or both and their comparison.
    #[arg(long, value_enum, default_value = "both")]
    mode: Modes,
    /// One push by its name; each by itself; or none.
    #[arg(long, default_value = "all", value_name = "NAME|all|none")]
    push: String,
    /// Folder for trajectories and pictures [default: out/NAME]
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    overrides: Overrides,
    /// Multiplies every push.
    #[arg(long, value_name = "X", default_value_t = 1.0, allow_negative_numbers = true)]
    scale_push: f64,
    /// Scales each push to this share of the smallest that full mode does not hold (found by bisection).
    #[arg(long, value_name = "X", conflicts_with = "scale_push", allow_negative_numbers = true)]
    at_onset: Option<f64>,
    /// Length of the simulation, instead of the scenario's [s].
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Writes no plots and renders no frames.
    #[arg(long)]
    no_pictures: bool,
    /// Records scenes and time series of all runs for the Rerun viewer (needs the cargo feature `rerun`).
    #[arg(long, value_name = "FILE.rrd")]
    rerun: Option<PathBuf>,
}

/// What the command line puts in the place of the scenario's or the model's.
#[derive(Debug, clap::Args)]
pub struct Overrides {
    /// Bounds every grasp in this way, whatever the scenario says.
    #[arg(long, value_enum)]
    limits: Option<LimitsArg>,
    /// Noslip iterations of MuJoCo's solver, all of them made, instead of the model's.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(..=1000))]
    noslip: Option<u16>,
    /// Angle by which anything may turn between two whole steps of a latched grasp [rad], instead of the scenario's; 0: every
    /// step is whole.
    #[arg(long, value_name = "RAD", allow_negative_numbers = true)]
    frozen_tolerance: Option<f64>,
}

impl Overrides {
    /// The scenario's plan.
    pub fn load(&self, scenario: &str) -> Result<Plan, Error> {
        Plan::load_with(scenario, self.limits.map(LimitsArg::limits))?.with_frozen_tolerance(self.frozen_tolerance)
    }

    /// Options of the runs.
    pub fn options(&self) -> Options {
        Options { noslip: self.noslip.map(usize::from) }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Modes {
    Full,
    Grasp,
    Both,
}

impl Modes {
    fn modes(self) -> &'static [Mode] {
        match self {
            Self::Full => &[Mode::Full],
            Self::Grasp => &[Mode::Grasp],
            Self::Both => &[Mode::Full, Mode::Grasp],
        }
    }
}

/// `--limits`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LimitsArg {
    /// Each contact's friction cone.
    Cones,
    /// The thesis's Eqs. 4.1 to 4.3.
    Box,
    /// A plain weld.
    Rigid,
}

impl LimitsArg {
    /// As the library has it.
    pub fn limits(self) -> Limits {
        match self {
            Self::Cones => Limits::Cones,
            Self::Box => Limits::Box,
            Self::Rigid => Limits::Rigid,
        }
    }
}

/// Simulates, compares, and writes what came of it.
pub fn run(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let options = args.overrides.options();
    let mut plan = args.overrides.load(&args.scenario)?.scale_pushes(args.scale_push)?;
    plan.stop = signals::stop();
    if let Some(duration) = args.duration {
        plan = plan.lasting(duration)?;
    }
    let mut at_onset = None;
    if let Some(share) = args.at_onset {
        at_onset = Some(scale_to_onset(&mut plan, share, &args.push, options)?);
    }
    let out = folder(args.out.as_deref(), &plan.name);
    let record = args.rerun.as_deref().map(|path| anyhow::Ok((path, recorder(path)?))).transpose()?;
    let mut simulated = simulate(&plan, args.mode.modes(), &args.push, options, &out)?;
    if let Some((path, record)) = record
        && let Err(e) = record(&plan, &simulated.pairs, path)
    {
        let failure = format!("no recording: {}; the trajectories are in {}", message(&e), out.display());
        complain("error", &failure);
        simulated.failures.push(failure);
    }
    let report = simulated.report(&plan, at_onset);
    let notes = warnings::creep_notes(&simulated.pairs, options.noslip.unwrap_or(plan.model.noslip_iterations()));
    output.write(&report, || summary::text(&report, &notes, &out))?;
    if !args.no_pictures && simulated.all_written() {
        crate::pictures::save_all(&plan, &simulated.pairs, &out);
    }
    Ok(exit_status(&simulated.failures))
}

/// Writes a recording, and returns its size in bytes.
type Record = fn(&Plan, &[Pair], &Path) -> anyhow::Result<u64>;

/// What writes the recording once there is something to record; the reason, before that takes its time, why it cannot.
#[cfg(feature = "rerun")]
fn recorder(path: &Path) -> anyhow::Result<Record> {
    if path.extension().is_none_or(|ending| ending != "rrd") {
        let (option, value) = ("--rerun", path.display().to_string());
        return Err(Error::Option { option, value, expected: "its name must end in .rrd" }.into());
    }
    if let Some(folder) = path.parent() {
        leftovers::clear_of(&[], folder)?;
    }
    Ok(crate::recording::save)
}

#[cfg(not(feature = "rerun"))]
fn recorder(path: &Path) -> anyhow::Result<Record> {
    let (option, value) = ("--rerun", path.display().to_string());
    let expected = "this program was built without it: build it with the cargo feature `rerun`, as in `cargo install --path . --features rerun`";
    Err(Error::Option { option, value, expected }.into())
}

/// What came of the runs, and has been said on standard error.
pub struct Simulated {
    pub pairs: Vec<Pair>,
    pub warnings: Vec<String>,
    pub failures: Vec<String>,
}

impl Simulated {
    /// The JSON object.
    pub fn report<'a>(&'a self, plan: &'a Plan, at_onset: Option<AtOnset>) -> Report<'a> {
        Report {
            scenario: &plan.name,
            engine: mujoco::mujoco_version(),
            nv: plan.model.nv(),
            timestep_s: plan.model.timestep(),
            runs: &self.pairs,
            at_onset,
            warnings: self.warnings.clone(),
            error: (!self.failures.is_empty()).then(|| self.failures.join("; ")),
        }
    }

    /// Whether every trajectory is in its file.
    pub fn all_written(&self) -> bool {
        self.pairs.iter().flat_map(Pair::runs).all(|run| run.unwritten.is_none())
    }
}

/// Runs `modes` under the selected pushes, and writes the trajectories to `out`.
pub fn simulate(plan: &Plan, modes: &[Mode], push: &str, options: Options, out: &Path) -> anyhow::Result<Simulated> {
    let pushes = plan.select_pushes(push)?;
    // Sets a run up before anything is written: bad input leaves no folder behind.
    let runner = Runner::new(plan, modes[0], pushes.first().copied().flatten())?;
    let runs = modes.len() * pushes.len();
    runner.check_memory(plan, runs)?;
    leftovers::clear_of_runs(out)?;

    let progress = Progress::new(runner.total_steps() * runs as u64, "simulating");
    let observer = Observer { steps: &|n| progress.advance(n), finished: &|run: &Run| run.write_csv(out).map(drop) };
    let pairs = run_all(plan, modes, &pushes, options, &observer);
    progress.finish();
    let pairs = pairs?;

    let warnings = warnings::warnings(plan, &pairs);
    warnings.iter().for_each(|message| complain("warning", message));
    let failures = failures(&pairs, runs);
    failures.iter().for_each(|message| complain("error", message));
    Ok(Simulated { pairs, warnings, failures })
}

/// Of a call whose results have been told.
pub fn exit_status(failures: &[String]) -> ExitCode {
    match signals::received() {
        Some((_, status)) => status,
        None if failures.is_empty() => ExitCode::SUCCESS,
        None => ExitCode::from(FAILURE),
    }
}

/// What failed: runs on their way, files that could not be written (each reason of the system once), and what a signal cut
/// short of `wanted` runs.
fn failures(pairs: &[Pair], wanted: usize) -> Vec<String> {
    let runs = || pairs.iter().flat_map(Pair::runs);
    let mut failures: Vec<String> = runs().filter_map(|r| r.error.as_ref()).map(ToString::to_string).collect();
    failures.extend(unwritten(runs().filter_map(|run| run.unwritten.as_ref())));
    if let Some((signal, _)) = signals::received() {
        failures.push(format!("interrupted by {signal}: {} of {wanted} runs were finished", runs().count()));
    }
    failures
}

/// Multiplies the selected pushes so that each is `share` of the smallest that full mode does not hold.
fn scale_to_onset(plan: &mut Plan, share: f64, selection: &str, options: Options) -> anyhow::Result<AtOnset> {
    if !share.is_finite() {
        let (option, value, expected) = ("--at-onset", format!("{share:?}"), "it must be a finite number");
        return Err(Error::Option { option, value, expected }.into());
    }
    let selected: Vec<String> = plan.select_pushes(selection)?.into_iter().flatten().map(|p| p.name.clone()).collect();
    let progress = Progress::new(plan.pushes.len() as u64, "finding onsets");
    let start = full_at_measure(plan, options)?;
    let find = |start: &mut Runner, push: &Push| {
        let factor = selected.contains(&push.name).then(|| onset(start, plan, push));
        progress.advance(1);
        factor
    };
    let factors: Vec<Option<Result<f64, &str>>> = plan.pushes.par_iter().map_with(start, find).collect();
    progress.finish();
    plan.stop.check()?;
    let mut pushes = Vec::new();
    for (push, factor) in plan.pushes.iter_mut().zip(factors).filter_map(|(push, found)| Some((push, found?))) {
        let onset = factor.ok().map(|factor| push.scaled(factor));
        match factor {
            Ok(factor) => *push = push.scaled(share * factor),
            Err(why) => complain("warning", &format!("push {} has no onset: {why}; left as it is", push.name)),
        }
        pushes.push(ScaledPush {
            push: push.name.clone(),
            onset_factor: factor.ok(),
            onset: onset.map(|onset| [onset.force.norm(), onset.torque.norm()]),
            force_n: push.force.into(),
            torque_nm: push.torque.into(),
        });
    }
    let finite = |p: &ScaledPush| p.force_n.iter().chain(&p.torque_nm).all(|v| v.is_finite());
    if !pushes.iter().all(finite) {
        let (option, value) = ("--at-onset", format!("{share:?}"));
        return Err(Error::Option {
            option,
            value,
            expected: "it must be a finite number, and so must each push at it",
        }
        .into());
    }
    Ok(AtOnset { share, pushes })
}
