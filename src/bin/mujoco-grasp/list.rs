//! `mujoco-grasp list`.

use std::process::ExitCode;

use mujoco_grasp::scenario::source;
use serde_json::json;

use crate::output::{Output, table};

/// Lists the built-in scenarios.
pub fn list(output: Output) -> anyhow::Result<ExitCode> {
    let scenarios = source::list()?;
    output.write(&json!({ "scenarios": scenarios }), || {
        let rows: Vec<Vec<String>> = scenarios.iter().map(|s| vec![format!("{}  {}", s.name, s.about)]).collect();
        table(&rows)
    })?;
    Ok(ExitCode::SUCCESS)
}
