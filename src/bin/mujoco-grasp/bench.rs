//! `mujoco-grasp bench`.

use std::process::ExitCode;

use mujoco_grasp::scenario::bench::{PARTS, Phases, Report, Timing, bench as measure};
use mujoco_grasp::scenario::plan::Plan;

use crate::output::{Output, complain, number, table};
use crate::progress::Progress;
use crate::run::LimitsArg;
use crate::signals;

/// `bench SCENARIO`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A built-in scenario's name, or the path of a scenario file.
    scenario: String,
    /// Timed steps of each variant, at least.
    #[arg(long, default_value_t = 10_000, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    /// Steps in one call, with controls held.
    #[arg(long, default_value_t = 10, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    substeps: u32,
    /// Bounds every grasp in this way, whatever the scenario says.
    #[arg(long, value_enum)]
    limits: Option<LimitsArg>,
    /// Angle by which anything may turn between two whole steps of a latched grasp [rad], instead of the scenario's; 0: every
    /// step is whole.
    #[arg(long, value_name = "RAD", allow_negative_numbers = true)]
    frozen_tolerance: Option<f64>,
}

/// Times the holding phase.
pub fn bench(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let plan = Plan::load_with(&args.scenario, args.limits.map(LimitsArg::limits))?;
    let mut plan = plan.with_frozen_tolerance(args.frozen_tolerance)?;
    plan.stop = signals::stop();
    let progress = Progress::new(PARTS, "timing");
    let report = measure(&plan, args.steps as usize, args.substeps as usize, &|n| progress.advance(n));
    progress.finish();
    let report = report?;
    if !report.latched {
        complain("warning", "the grasp is not latched at measure_from: its steps are those of the full solve");
    }
    if let Some(why) = &report.not_pushed {
        complain("warning", &format!("{why}; there is nothing to time for \"pushed\""));
    }
    output.write(&report, || text(&report))?;
    Ok(ExitCode::SUCCESS)
}

fn text(report: &Report) -> String {
    let mut text = format!("{}: {} degrees of freedom, MuJoCo {}\n", report.scenario, report.nv, report.engine);
    text.push_str(&format!("inverse kinematics: {} us per solve\n", number(report.ik_us, 1.0, 2)));
    text.push_str(&phases("still", &report.still));
    if let Some(pushed) = &report.pushed {
        let share = report.onset_factor.map(|f| 0.5 * f);
        text.push_str(&phases(&format!("pushed (the first push times +-{})", number(share, 1.0, 3)), pushed));
    }
    text
}

fn phases(title: &str, phases: &Phases) -> String {
    let row = |name: &str, t: &Timing| {
        let solver = match (&t.solver, t.kept_outcome) {
            (Some(solver), Some(false)) => format!("{solver} (another outcome)"),
            (Some(solver), _) => solver.clone(),
            (None, _) => String::new(),
        };
        let numbers = [t.step_us, t.step_mean_us, t.contact_us].map(|us| number(us, 1.0, 2));
        [vec![name.to_owned()], numbers.to_vec(), vec![solver]].concat()
    };
    let ratio = |name: &str, of: [Option<f64>; 3]| {
        [vec![name.to_owned()], of.map(|ratio| number(ratio, 1.0, 2)).to_vec(), vec![String::new()]].concat()
    };
    let r = &phases.ratio;
    let head = ["", "step us", "mean us", "contact us", "solver"].map(str::to_owned).to_vec();
    let rows = [
        head,
        row("full", &phases.full),
        row("full, noslip 10", &phases.full_noslip),
        row("full, model's own", &phases.full_default),
        row("grasp", &phases.grasp),
        row("grasp, every step whole", &phases.exact),
        row("floor", &phases.floor),
        ratio("cheaper full / grasp", [r.step_default, r.mean_default, None]),
        ratio("full / grasp", [r.step, None, r.contact]),
        ratio("full noslip / grasp", [r.step_noslip, r.mean_noslip, r.contact_noslip]),
        ratio("grasp / floor", [r.step_over_floor, None, None]),
    ];
    format!("\n{title}, medians and means of {} steps each\n{}", phases.steps, table(&rows))
}
