//! What a step costs, beside the thesis's Table 5.1.

use mujoco_grasp::report::{BenchRow, BenchTable, Timing};
use mujoco_grasp::scenario::bench::{self, PARTS, Phases, bench};
use mujoco_grasp::scenario::plan::Plan;

use crate::output::{complain, message};
use crate::progress::Progress;

/// Timed steps of each variant, and steps in one call, as `bench` has it.
const STEPS: usize = 2000;
const SUBSTEPS: usize = 10;

/// The table, or why there is none.
pub type Cost = Result<BenchTable, String>;

/// Times the holding phase. What fails is said, and the page has it in the table's place.
pub fn measure(plan: &Plan) -> Cost {
    let progress = Progress::new(PARTS, "timing");
    let report = bench(plan, STEPS, SUBSTEPS, &|n| progress.advance(n));
    progress.finish();
    let report = report.map_err(|e| {
        let why = format!("the holding phase could not be timed: {}", message(&e.into()));
        complain("warning", &why);
        why
    })?;
    let phases = [("still", Some(&report.still)), ("pushed", report.pushed.as_ref())];
    let rows = phases.into_iter().filter_map(|(label, phases)| row(label, phases?, report.ik_us)).collect();
    Ok(BenchTable { title: String::new(), rows })
}

fn row(phase: &str, phases: &Phases, ik_us: Option<f64>) -> Option<BenchRow> {
    let timing = |t: &bench::Timing| Some(Timing { step_us: t.step_us?, contact_us: t.contact_us });
    Some(BenchRow {
        label: format!("here, {phase}"),
        ik_us,
        full: timing(&phases.full)?,
        full_noslip: timing(&phases.full_noslip)?,
        grasp: timing(&phases.grasp)?,
        exact: timing(&phases.exact),
        floor: timing(&phases.floor)?,
    })
}
