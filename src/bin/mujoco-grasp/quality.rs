//! `mujoco-grasp quality`.

use std::process::ExitCode;

use mujoco_grasp::grasp::metrics::quality::QualityReport;
use mujoco_grasp::scenario::measure::quality_at_measure;
use mujoco_grasp::scenario::plan::Plan;

use crate::output::{Output, complain, table};
use crate::signals;

/// `quality SCENARIO`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A built-in scenario's name, or the path of a scenario file.
    scenario: String,
}

/// Grasp quality of the full contact solve at `measure_from`.
pub fn quality(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let mut plan = Plan::load(&args.scenario)?;
    plan.stop = signals::stop();
    let report = quality_at_measure(&plan)?;
    if report.contacts == 0 {
        complain("warning", "nothing touches the target then");
    }
    output.write(&report, || text(&report))?;
    Ok(ExitCode::SUCCESS)
}

fn text(report: &QualityReport) -> String {
    let yes = |b: bool| if b { "yes" } else { "no" }.to_owned();
    let row = |name: &str, value: String| vec![name.to_owned(), value];
    table(&[
        row("smallest singular value (thesis Eq. 2.18)", format!("{:.4} N", report.min_singular_value_n)),
        row("Ferrari-Canny epsilon", format!("{:.4} N", report.ferrari_canny_n)),
        row("volume of the wrench hull", format!("{:.4e} N^6", report.hull_volume)),
        row("isotropy", format!("{:.4}", report.isotropy)),
        row("force closure", yes(report.force_closure)),
        row("holds its own weight", yes(report.holds_own_weight)),
        row("contacts", report.contacts.to_string()),
    ])
}
