//! `mujoco-grasp agree`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use mujoco_grasp::scenario::agree::{Ground, TRIALS_PER_ONSET};
use mujoco_grasp::scenario::agreement::Agreement;
use mujoco_grasp::scenario::draw::directions;
use mujoco_grasp::scenario::tally::{Tally, write_onsets, write_trials};

use crate::output::{FAILURE, Output, complain, folder, number, table, unwritten};
use crate::progress::Progress;
use crate::run::Overrides;
use crate::{leftovers, scatters, signals};

/// `agree SCENARIO`
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A built-in scenario's name, or the path of a scenario file.
    scenario: String,
    /// Random pushes.
    #[arg(long, value_name = "N", default_value_t = 300, allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    trials: u64,
    /// The same seed draws the same pushes.
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,
    /// Folder for tables and pictures [default: out/NAME]
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    overrides: Overrides,
    /// Draws no pictures.
    #[arg(long)]
    no_pictures: bool,
}

/// What it writes.
const FILES: [&str; 4] = ["agree-onsets.csv", "agree-trials.csv", "agree-peak.svg", "agree-final.svg"];

/// Random pushes in both modes.
pub fn agree(args: &Args, output: Output) -> anyhow::Result<ExitCode> {
    let mut plan = args.overrides.load(&args.scenario)?;
    plan.stop = signals::stop();
    let ground = Ground::new(&plan, args.overrides.options())?;
    let out = folder(args.out.as_deref(), &plan.name);
    leftovers::clear_of(&FILES, &out)?;
    if !ground.is_latched() {
        complain("warning", "the grasp is not latched when the push starts: both modes are the same simulation");
    }

    let directions = directions().len();
    let progress = Progress::new(directions as u64 * TRIALS_PER_ONSET + args.trials, "pushing");
    let onsets = ground.onsets(&|| progress.advance(TRIALS_PER_ONSET));
    // Kept whatever comes.
    let mut errors = Vec::from_iter(write_onsets(&onsets, &out.join(FILES[0])).err());
    let mut trials = Vec::new();
    if !plan.stop.is_asked() {
        trials = ground.trials(&onsets, args.trials, args.seed, &|| progress.advance(1));
        errors.extend(write_trials(&onsets, &trials, &out.join(FILES[1])).err());
    }
    progress.finish();
    if trials.is_empty() && !plan.stop.is_asked() {
        complain(
            "warning",
            "no trials: full mode has no onset in any direction (it holds, or does not, whatever the push)",
        );
    }
    let mut failures = unwritten(errors.iter());
    if let Some((signal, _)) = signals::received() {
        let (found, made) = (onsets.len(), trials.len());
        failures.push(format!(
            "interrupted by {signal}: the onsets of {found} of {directions} directions were found, and {made} of {} trials \
             made",
            args.trials
        ));
    }
    failures.iter().for_each(|message| complain("error", message));

    let error = (!failures.is_empty()).then(|| failures.join("; "));
    let report = Agreement::of(&ground, args.seed, &onsets, &trials, error);
    output.write(&report, || text(&report, &out))?;
    if !args.no_pictures && !trials.is_empty() && errors.is_empty() {
        scatters::save(&plan.name, &trials, &out);
    }
    Ok(match signals::received() {
        Some((_, status)) => status,
        None if failures.is_empty() => ExitCode::SUCCESS,
        None => ExitCode::from(FAILURE),
    })
}

fn text(report: &Agreement<'_>, out: &Path) -> String {
    let t = &report.tally;
    let percent = |x: Option<f64>| number(x, 100.0, 2) + " %";
    let millimetres = |x: Option<f64>| number(x, 1e3, 4) + " mm";
    let row = |cells: [String; 6]| cells.to_vec();
    let head = ["full mode", "trials", "alike", "differ by, median", "error, median", "90 % below"];
    let none = String::new;
    let rows = [
        head.map(str::to_owned).to_vec(),
        row([
            "held".into(),
            t.held.count.to_string(),
            t.held.same_outcome.to_string(),
            millimetres(t.held.median_position_rmse_m),
            percent(t.held.median_relative_error),
            percent(t.held.p90_relative_error),
        ]),
        row([
            "slid".into(),
            t.slid.count.to_string(),
            t.slid.same_outcome.to_string(),
            millimetres(t.slid.median_final_offset_difference_m),
            percent(t.slid.median_final_offset_relative_error),
            none(),
        ]),
        row(["lost".into(), t.lost.count.to_string(), t.lost.same_outcome.to_string(), none(), none(), none()]),
        row(["all".into(), t.trials.to_string(), t.same_outcome.to_string(), none(), none(), none()]),
    ];
    let mut text = format!(
        "{}: {} random pushes from {} s on, seed {}, MuJoCo {}\n\n{}",
        report.scenario,
        t.trials,
        report.push_start_s,
        report.seed,
        report.engine,
        table(&rows)
    );
    text.push_str(
        "of the motion, error over its peak (held); of the final offset (slid); below 0.1 mm there is no error\n",
    );
    text.push_str(&format!(
        "held, as they are: motion {} at worst, rotation {}, normal forces {} (medians)\n",
        percent(t.held.worst_relative_error),
        percent(t.held.rotation_relative_error),
        percent(t.held.normal_force_relative_error)
    ));
    text.push_str(&format!(
        "\nagreement {} of {} trials; latched for {} of the time in contact (median of held and slid trials), {} in a tenth\n",
        percent(t.agreement),
        t.trials - t.vacuous_trials,
        percent(t.latched_share.median),
        percent(t.latched_share.p10)
    ));
    if t.vacuous_trials > 0 {
        text.push_str(&format!(
            "{} trials say nothing: grasp mode was latched for none of the compared time; they are left out\n",
            t.vacuous_trials
        ));
    }
    let both = t.onsets.iter().filter(|o| o.full.is_some() && o.grasp.is_some()).count();
    text.push_str(&format!(
        "\nonset: differs by {} (median of {both} of {} directions)\n",
        percent(t.onset_relative_error_median),
        t.onsets.len()
    ));
    text.push_str(&format!("slip onset: differs by {} (median)\n", percent(t.slip_onset_relative_error_median)));
    if report.noslip_iterations == 0 && t.same_outcome < t.trials - t.vacuous_trials {
        text.push_str("full mode runs without noslip iterations, so what it holds creeps: compare with --noslip 100\n");
    }
    if t.failed > 0 {
        text.push_str(&format!("simulations that failed: {} (see the disagreements)\n", t.failed));
    }
    if !t.disagreements.is_empty() {
        text.push_str(&format!("\n{}", disagreements(t)));
    }
    text.push_str(&format!("\nwritten to {}\n", out.display()));
    text
}

fn disagreements(tally: &Tally) -> String {
    let vector = |v: &[f64; 3]| format!("({:.3}, {:.3}, {:.3})", v[0], v[1], v[2]);
    let heads = ["trial", "force N", "torque N m", "for s", "of onset", "full", "mm", "grasp", "mm", "", "error"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    for d in &tally.disagreements {
        rows.push(vec![
            d.trial.to_string(),
            vector(&d.force_n),
            vector(&d.torque_nm),
            format!("{:.3}", d.duration_s),
            format!("{:.3}", d.size_over_onset),
            crate::summary::outcome(d.full.outcome).to_owned(),
            number(d.full_final_offset_m, 1e3, 2),
            crate::summary::outcome(d.grasp.outcome).to_owned(),
            number(d.grasp_final_offset_m, 1e3, 2),
            match (d.vacuous, d.chaotic) {
                (true, _) => "says nothing",
                (_, Some(true)) => "chaotic",
                _ => "",
            }
            .to_owned(),
            d.error.clone().unwrap_or_default(),
        ]);
    }
    let chaotic = if tally.chaotic_trials.is_some_and(|n| n > 0) {
        "chaotic: full mode itself has another outcome with 10 times the noslip iterations\n"
    } else {
        ""
    };
    format!("disagreements\n{}{chaotic}", table(&rows))
}
