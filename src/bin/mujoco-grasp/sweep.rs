//! `mujoco-grasp sweep`.

use std::path::PathBuf;
use std::process::ExitCode;

use mujoco_grasp::scenario::runner::Mode;
use mujoco_grasp::scenario::sweep::{self, Report, Shard, Sweep, Verdict};

use crate::output::{Output, complain, folder, number, table};
use crate::progress::Progress;
use crate::signals;

/// `sweep SPEC`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The path of a sweep's spec.
    spec: PathBuf,
    /// Folder for the Parquet files; those that it has are not made again [default: out/NAME]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Only shard I of N, from 0 to N - 1.
    #[arg(long, value_name = "I/N")]
    shard: Option<String>,
    /// The grasp controller, or MuJoCo's own contact solve.
    #[arg(long, value_enum, default_value = "grasp")]
    mode: ModeArg,
}

/// How contacts are simulated.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum ModeArg {
    Grasp,
    Full,
}

/// Many grasps, shaken and pushed: which survive?
pub fn sweep(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let shard = args.shard.as_deref().map_or(Ok(Shard::ALL), str::parse)?;
    let mut sweep = Sweep::load(&args.spec)?;
    sweep.plan.stop = signals::stop();
    let out = folder(args.out.as_deref(), &sweep.spec.name);
    let mode = match args.mode {
        ModeArg::Grasp => Mode::Grasp,
        ModeArg::Full => Mode::Full,
    };
    let progress = Progress::new(sweep.grasps_of(shard) as u64, "grasps tested");
    let report = sweep::run(&sweep, mode, shard, &out, &|grasps| progress.advance(grasps));
    progress.finish();
    let report = report?;
    let failed = report.verdicts["failed"];
    if failed > 0 {
        complain("warning", &format!("{failed} simulations failed; the column `error` says why"));
    }
    if report.grasps == 0 {
        complain("warning", "the shard has no grasps: there are fewer files than shards");
    } else if mode == Mode::Grasp && report.latched_share.median.is_none_or(|share| share == 0.0) {
        complain("warning", "most grasps have not latched: their steps were those of MuJoCo's own solve");
    }
    output.write(&report, || text(&report))?;
    Ok(ExitCode::SUCCESS)
}

fn text(report: &Report) -> String {
    let row = |verdict: Verdict| vec![verdict.name().to_owned(), report.verdicts[verdict.name()].to_string()];
    let rows = Verdict::ALL.map(row);
    let rate = (report.seconds > 0.0).then(|| report.tested as f64 / report.seconds);
    format!(
        "{}: {} grasps in {} files in {}\n\n{}\n{} tested now, {} a second on {} threads; latched {} % of the steps under loads \
         (median)\n",
        report.sweep,
        report.grasps,
        report.files,
        report.out.display(),
        table(&rows),
        report.tested,
        number(rate, 1.0, 2),
        report.threads,
        number(report.latched_share.median, 100.0, 1),
    )
}
