//! `mujoco-grasp`: runs, compares and times grasps on MuJoCo. See docs/reference.md for what scripts rely on.
#![forbid(unsafe_code)]

mod agree;
mod artist;
mod bench;
mod calibrate;
mod leftovers;
mod list;
mod output;
mod pictures;
mod progress;
mod quality;
#[cfg(feature = "rerun")]
mod recording;
mod report;
mod run;
mod scatters;
mod signals;
mod summary;
mod sweep;
mod view;
mod warnings;

use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, Subcommand};
use mujoco_grasp::mujoco;

use output::{Output, complain};

/// Grasps on MuJoCo: once a grasp is good enough, its contacts become one six-axis constraint.
///
/// SCENARIO is the name of a built-in scenario (see `list`) or the path of a scenario file.
#[derive(Debug, Parser)]
#[command(name = "mujoco-grasp", version)]
struct Cli {
    /// One JSON object on standard output, and nothing else there.
    #[arg(long, global = true)]
    json: bool,
    /// Compiles models in a child process, for files from strangers: one that crashes or hangs MuJoCo is an error.
    #[arg(long, global = true)]
    isolated: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Lists the built-in scenarios.
    List,
    /// Simulates a scenario in both modes, push by push, and compares.
    Run(run::Args),
    /// One page with all that there is to see of a scenario: films, plots, costs, numbers.
    Report(report::Args),
    /// An interactive window: pause, single steps, forces with the mouse, full or grasp mode.
    View(view::Args),
    /// Times the holding phase.
    Bench(bench::Args),
    /// Random pushes: do both modes tell the same story?
    Agree(agree::Args),
    /// Finds both quality thresholds: latch_quality and release_quality.
    Calibrate(calibrate::Args),
    /// Grasp quality when measuring starts.
    Quality(quality::Args),
    /// Many grasps, shaken and pushed: which survive?
    Sweep(sweep::Args),
}

/// A model that takes longer than this to load hangs.
const LOADING_LIMIT: Duration = Duration::from_secs(60);

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return output::usage(&error),
    };
    let output = Output { json: cli.json };
    if cli.isolated {
        mujoco::isolate_loading(Some(LOADING_LIMIT));
    }
    if let Err(error) = signals::install() {
        complain("warning", &format!("an interrupted call will keep nothing: no handler for signals: {error}"));
    }
    let result = match &cli.command {
        Command::List => list::list(output),
        Command::Run(args) => run::run(args, output),
        Command::Report(args) => report::report(args, output),
        Command::View(args) => view::view(args, output),
        Command::Bench(args) => bench::bench(args, output),
        Command::Agree(args) => agree::agree(args, output),
        Command::Calibrate(args) => calibrate::calibrate(args, output),
        Command::Quality(args) => quality::quality(args, output),
        Command::Sweep(args) => sweep::sweep(args, output),
    };
    result.unwrap_or_else(|error| output.fail(&error))
}
