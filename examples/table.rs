//! The thesis's Table 5.1 with ours beside it, from what `mujoco-grasp bench SCENARIO --json` printed.
//!
//! `cargo run --example table -- PICTURE.svg BENCH.json...`
#![forbid(unsafe_code)]

use anyhow::{Context, bail};
use mujoco_grasp::report::{BenchRow, BenchTable, Timing};
use serde_json::Value;
use std::path::Path;

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let picture = arguments.next().context("usage: table PICTURE.svg BENCH.json...")?;
    let mut table = BenchTable { title: "What a step costs".to_owned(), rows: Vec::new() };
    for file in arguments {
        let file = Path::new(&file);
        let rows = rows(file).with_context(|| format!("{} is not the JSON of `bench`", file.display()))?;
        table.rows.extend(rows);
    }
    if table.rows.is_empty() {
        bail!("no bench to show: name at least one file");
    }
    println!("{}", table.text());
    table.save(&picture)?;
    Ok(())
}

/// The phases of one bench.
fn rows(file: &Path) -> anyhow::Result<Vec<BenchRow>> {
    let bench: Value = serde_json::from_str(&std::fs::read_to_string(file)?)?;
    let scenario = bench["scenario"].as_str().context("no field `scenario`")?;
    let phases = ["still", "pushed"].into_iter().filter(|phase| !bench[phase].is_null());
    phases
        .map(|phase| {
            let timing =
                |mode: &str| timing(&bench[phase][mode]).with_context(|| format!("no times of {phase}.{mode}"));
            Ok(BenchRow {
                label: format!("{scenario}, {phase}"),
                ik_us: bench["ik_us"].as_f64(),
                full: timing("full")?,
                full_noslip: timing("full_noslip")?,
                grasp: timing("grasp")?,
                exact: Some(timing("exact")?),
                floor: timing("floor")?,
            })
        })
        .collect()
}

fn timing(mode: &Value) -> Option<Timing> {
    Some(Timing { step_us: mode["step_us"].as_f64()?, contact_us: mode["contact_us"].as_f64() })
}
