//! `mujoco-grasp report`.

pub mod charts;
mod cost;
mod film;
mod story;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::Mode;
use serde::Serialize;

use crate::output::{Output, complain, folder, message};
use crate::run::{Overrides, Simulated, exit_status, simulate};
use crate::{leftovers, signals, summary};

/// `report SCENARIO`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A built-in scenario's name, or the path of a scenario file.
    scenario: String,
    /// One push by its name; each by itself; or none.
    #[arg(long, default_value = "all", value_name = "NAME|all|none")]
    push: String,
    /// Folder for the page and the trajectories [default: out/NAME]
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    overrides: Overrides,
}

/// The page's name in its folder.
const PAGE: &str = "report.html";
/// So many pushes have a film and charts; a page about more would be too large.
const DETAILED: usize = 6;

/// The JSON object: that of `run`, and the page.
#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    runs: summary::Report<'a>,
    /// `None` if it could not be made.
    page: Option<&'a Path>,
    page_bytes: Option<u64>,
}

/// Simulates, times the holding phase, and writes a page about all of it.
pub fn report(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let mut plan = args.overrides.load(&args.scenario)?;
    plan.stop = signals::stop();
    let out = folder(args.out.as_deref(), &plan.name);
    let mut simulated = simulate(&plan, &[Mode::Full, Mode::Grasp], &args.push, args.overrides.options(), &out)?;
    let path = out.join(PAGE);
    let made = page(&plan, &simulated, &out, &path);
    if let Err(e) = &made {
        let failure = format!("no page {}: {}; the trajectories are in {}", path.display(), message(e), out.display());
        complain("error", &failure);
        simulated.failures.push(failure);
    }
    let bytes = made.ok();
    let page = bytes.map(|_| path.as_path());
    output.write(&Report { runs: simulated.report(&plan, None), page, page_bytes: bytes }, || {
        let size = bytes.map_or_else(String::new, |b| format!("{} ({:.1} MB)\n", path.display(), b as f64 * 1e-6));
        summary::text(&simulated.report(&plan, None), &[], &out) + &size
    })?;
    Ok(exit_status(&simulated.failures))
}

/// Writes the page, and returns its size in bytes.
fn page(plan: &Plan, simulated: &Simulated, out: &Path, path: &Path) -> anyhow::Result<u64> {
    leftovers::clear_of(&[PAGE], out)?;
    plan.stop.check()?;
    let cost = cost::measure(plan);
    plan.stop.check()?;
    let detailed = &simulated.pairs[..simulated.pairs.len().min(DETAILED)];
    let shot = film::shoot(plan, detailed);
    plan.stop.check()?;
    Ok(story::tell(plan, simulated, detailed, &cost, &shot, out)?.save(path)?)
}
