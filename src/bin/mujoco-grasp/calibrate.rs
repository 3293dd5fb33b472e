//! `mujoco-grasp calibrate`.

use std::process::ExitCode;

use mujoco_grasp::scenario::calibrate::{Calibration, calibrate as find, simulations};
use mujoco_grasp::scenario::plan::Plan;

use crate::output::{Output, complain, significant, table};
use crate::progress::Progress;
use crate::signals;

/// `calibrate SCENARIO`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A built-in scenario's name, or the path of a scenario file.
    scenario: String,
}

/// Both thresholds of the first grasp.
pub fn calibrate(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let mut plan = Plan::load(&args.scenario)?;
    plan.stop = signals::stop();
    let progress = Progress::new(simulations(&plan)? as u64, "pressing");
    let calibration = find(&plan, &|| progress.advance(1));
    progress.finish();
    let calibration = calibration?;
    if calibration.carried {
        complain(
            "warning",
            "the target is held with quality 0: something else carries it, as the ground does, and there is no threshold; \
             have the hand lift it before measure_from",
        );
    } else if calibration.latch_quality.is_none() {
        complain("warning", "the target is not held at rest with any strength that was tried: there is no threshold");
    }
    output.write(&calibration, || text(&plan, &calibration))?;
    Ok(ExitCode::SUCCESS)
}

fn text(plan: &Plan, calibration: &Calibration) -> String {
    let mut rows = vec![[calibration.press, "quality N", "held", "slip mm", ""].map(str::to_owned).to_vec()];
    for t in &calibration.tried {
        rows.push(vec![
            significant(t.strength),
            significant(t.quality),
            if t.held { "yes" } else { "no" }.to_owned(),
            if t.slip_m < 1.0 { format!("{:.3}", t.slip_m * 1e3) } else { "-".to_owned() },
            t.error.clone().unwrap_or_default(),
        ]);
    }
    let newton = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), significant);
    format!(
        "{}: held at rest under gravity without slipping (1 mm)?\n\n{}\n\
         latch_quality = {}    # Q_Th, the least that holds\n\
         release_quality = {}    # Q_M; an opening hand lets the target slip at {} N\n",
        plan.name,
        table(&rows),
        newton(calibration.latch_quality),
        newton(calibration.release_quality),
        newton(calibration.slip_quality)
    )
}
