//! `mujoco-grasp run`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::ValueEnum;
use mujoco_grasp::grasp::Limits;
use mujoco_grasp::mujoco;
use mujoco_grasp::scenario::Error;
use mujoco_grasp::scenario::compare::Comparison;
use mujoco_grasp::scenario::onset::{full_at_measure, onset};
use mujoco_grasp::scenario::outcome::{Outcome, Summary};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::run::{Observer, Options, Pair, Run, run_all};
use mujoco_grasp::scenario::runner::{Mode, Runner};
use rayon::prelude::*;
use serde::Serialize;

use crate::output::{FAILURE, Output, complain, number, table};
use crate::progress::Progress;

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
    #[arg(long, value_name = "X", conflicts_with = "scale_push")]
    at_onset: Option<f64>,
    /// Length of the simulation, instead of the scenario's [s].
    #[arg(long, value_name = "SECONDS")]
    duration: Option<f64>,
    /// Writes no plots and renders no frames.
    #[arg(long)]
    no_pictures: bool,
}

/// What the command line puts in the place of the scenario's or the model's.
#[derive(Debug, clap::Args)]
pub struct Overrides {
    /// Bounds every grasp in this way, whatever the scenario says.
    #[arg(long, value_enum)]
    limits: Option<LimitsArg>,
    /// Noslip iterations of MuJoCo's solver, all of them made, instead of the model's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(..=1000))]
    noslip: Option<u16>,
}

impl Overrides {
    /// Bounds of every grasp.
    pub fn limits(&self) -> Option<Limits> {
        self.limits.map(LimitsArg::limits)
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

/// The JSON object of `run`.
#[derive(Serialize)]
struct Report<'a> {
    scenario: &'a str,
    engine: String,
    nv: usize,
    timestep_s: f64,
    runs: &'a [Pair],
    /// Only when a run failed on its way.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// Simulates, compares, and writes what came of it.
pub fn run(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let options = args.overrides.options();
    let limits = args.overrides.limits();
    let mut plan = Plan::load_with(&args.scenario, limits)?.scale_pushes(args.scale_push)?;
    if let Some(duration) = args.duration {
        plan = plan.lasting(duration)?;
    }
    if let Some(share) = args.at_onset {
        plan = scale_to_onset(plan, share, &args.push, options)?;
    }
    let pushes = plan.select_pushes(&args.push)?;
    let modes = args.mode.modes();
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from("out").join(&plan.name));
    // Sets a run up before anything is written: bad input leaves no folder behind.
    let steps = Runner::new(&plan, modes[0], pushes.first().copied().flatten())?.total_steps();
    std::fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;

    let progress = Progress::new(steps * (modes.len() * pushes.len()) as u64, "simulating");
    let observer = Observer { steps: &|n| progress.advance(n), finished: &|run: &Run| run.write_csv(&out).map(drop) };
    let pairs = run_all(&plan, modes, &pushes, options, &observer);
    progress.finish();
    let pairs = pairs?;

    let runs = || pairs.iter().flat_map(|p| [&p.full, &p.grasp]).flatten();
    runs().for_each(|run| warn(run, plan.model.has_contacts()));
    let failures: Vec<String> = runs().filter_map(|r| r.error.as_ref()).map(ToString::to_string).collect();
    failures.iter().for_each(|message| complain("error", message));
    let error = (!failures.is_empty()).then(|| failures.join("; "));
    let failed = error.is_some();
    let report = Report {
        scenario: &plan.name,
        engine: mujoco::mujoco_version(),
        nv: plan.model.nv(),
        timestep_s: plan.model.timestep(),
        runs: &pairs,
        error,
    };
    output.write(&report, || text(&report, &out))?;
    if !args.no_pictures {
        crate::pictures::save_all(&plan, &pairs, &out);
    }
    Ok(if failed { ExitCode::from(FAILURE) } else { ExitCode::SUCCESS })
}

/// Multiplies the selected pushes so that each is `share` of the smallest that full mode does not hold.
fn scale_to_onset(mut plan: Plan, share: f64, selection: &str, options: Options) -> anyhow::Result<Plan> {
    if !share.is_finite() {
        let (option, value, expected) = ("--at-onset", share.to_string(), "it must be a finite number");
        return Err(Error::Option { option, value, expected }.into());
    }
    let selected: Vec<String> = plan.select_pushes(selection)?.into_iter().flatten().map(|p| p.name.clone()).collect();
    let start = full_at_measure(&plan, options)?;
    let factors: Vec<Option<f64>> = plan
        .pushes
        .par_iter()
        .map_with(start, |start, p| selected.contains(&p.name).then(|| onset(start, &plan, p)).flatten())
        .collect();
    for (push, factor) in plan.pushes.iter_mut().zip(factors) {
        match factor {
            Some(factor) => *push = push.scaled(share * factor),
            None if selected.contains(&push.name) => {
                complain(
                    "warning",
                    &format!("push {}: no size of it is found that is not held; left as it is", push.name),
                );
            }
            None => {}
        }
    }
    Ok(plan)
}

/// Says what the numbers do not show.
fn warn(run: &Run, contacts: bool) {
    for warning in &run.warnings {
        complain("warning", &format!("{}: {warning}", run.stem()));
    }
    if run.mode == Mode::Grasp && run.error.is_none() {
        if run.summary.latched_at_s.is_none() {
            never_latched(&format!("{}: the grasp", run.stem()), run.best_quality, run.latch_quality, contacts);
        }
        for o in run.others.iter().filter(|o| o.summary.latched_at_s.is_none()) {
            let who = format!("{}: grasp {} of {} by {}", run.stem(), o.index, o.target, o.palm);
            never_latched(&who, o.best_quality, o.latch_quality, contacts);
        }
    }
}

fn never_latched(who: &str, best: f64, needed: f64, contacts: bool) {
    let why = if !contacts {
        ": the model's flags switch contacts or constraints off"
    } else if best == 0.0 {
        ": no effector pressed on the target, or its contacts cannot hold it in every direction"
    } else {
        ""
    };
    let message = format!(
        "{who} never latched: its quality reached {best:.4} N, and it takes {needed:.4} N (latch_quality){why}"
    );
    complain("warning", &message);
}

fn text(report: &Report<'_>, out: &std::path::Path) -> String {
    let heads = [
        "push",
        "mode",
        "outcome",
        "latched s",
        "released s",
        "peak mm",
        "final mm",
        "sinks in mm",
        "creep um/s",
        "squeeze N",
        "slips at s",
        "step us",
    ];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    let mut compared = vec![
        ["push", "same outcome", "position rmse mm", "relative", "rotation rmse mrad", "normal force"]
            .map(str::to_owned)
            .to_vec(),
    ];
    for pair in report.runs {
        for run in [&pair.full, &pair.grasp].into_iter().flatten() {
            rows.push(summary_row(pair.push.clone(), run.mode, &run.summary));
            for other in &run.others {
                rows.push(summary_row(format!("{} ({})", pair.push, other.palm), run.mode, &other.summary));
            }
        }
        if let Some(c) = &pair.compare {
            compared.push(comparison_row(pair.push.clone(), c));
            let palms = pair.full.iter().flat_map(|run| run.others.iter().map(|o| &o.palm));
            for (other, palm) in c.others.iter().zip(palms) {
                compared.push(comparison_row(format!("{} ({palm})", pair.push), other));
            }
        }
    }
    let mut text = format!(
        "{}: {} degrees of freedom, MuJoCo {}, steps of {} ms\n\n{}",
        report.scenario,
        report.nv,
        report.engine,
        report.timestep_s * 1e3,
        table(&rows)
    );
    if compared.len() > 1 {
        text.push_str(&format!("\ngrasp mode against full\n{}", table(&compared)));
    }
    text.push_str(&format!("\nwritten to {}\n", out.display()));
    text
}

fn summary_row(push: String, mode: Mode, s: &Summary) -> Vec<String> {
    vec![
        push,
        mode.name().to_owned(),
        outcome(s.outcome).to_owned(),
        number(s.latched_at_s, 1.0, 3),
        number(s.released_at_s, 1.0, 3),
        number(s.peak_motion_m, 1e3, 3),
        number(s.final_offset_m, 1e3, 3),
        number(s.max_penetration_m, 1e3, 3),
        number(s.creep_m_per_s, 1e6, 3),
        number(s.normal_force_total_n, 1.0, 3),
        number(s.slip_onset_s, 1.0, 3),
        number(s.step_us_median, 1.0, 1),
    ]
}

fn comparison_row(push: String, c: &Comparison) -> Vec<String> {
    vec![
        push,
        if c.same_outcome { "yes" } else { "NO" }.to_owned(),
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
