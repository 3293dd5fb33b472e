//! What goes to standard output and to standard error, and the exit status.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use mujoco_grasp::scenario;
use serde::Serialize;
use serde_json::json;

use crate::signals;

/// Exit status of anything that failed but bad input.
pub const FAILURE: u8 = 1;
/// Exit status of bad usage and bad input.
pub const BAD_INPUT: u8 = 2;

/// Where results go.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// One JSON object instead of tables.
    pub json: bool,
}

impl Output {
    /// Writes the result: `value` as JSON, or `text`.
    pub fn write(self, value: &impl Serialize, text: impl FnOnce() -> String) -> anyhow::Result<()> {
        let mut out = if self.json { serde_json::to_string_pretty(value)? } else { text().trim_end().to_owned() };
        out.push('\n');
        let mut stdout = std::io::stdout().lock();
        match stdout.write_all(out.as_bytes()).and_then(|()| stdout.flush()) {
            // The reader has seen enough, as in `| head`.
            Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
            other => other.context("cannot write to standard output"),
        }
    }

    /// Tells of an error that left no result, and gives its exit status.
    pub fn fail(self, error: &anyhow::Error) -> ExitCode {
        let mut message = message(error);
        if let Some((signal, _)) = signals::received().filter(|_| was_interrupted(error)) {
            message = format!("{message} by {signal}");
        }
        complain("error", &message);
        if self.json {
            // A message on standard error has been given; nothing more can be done if this one fails.
            let _ = self.write(&json!({ "error": message }), String::new);
        }
        status(error)
    }
}

/// The error and its causes; a cause whose text an error bears already is not said again.
pub fn message(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |said, cause| match cause.to_string() {
        cause if said.is_empty() => cause,
        cause if said.contains(&cause) => said,
        cause => format!("{said}: {cause}"),
    })
}

/// Files that could not be written, each reason of the system once.
pub fn unwritten<'a>(errors: impl Iterator<Item = &'a scenario::Error>) -> Vec<String> {
    let mut by_reason: Vec<(String, Vec<String>)> = Vec::new();
    for error in errors {
        let (file, reason) = match error {
            scenario::Error::Write { file, source } => (file.display().to_string(), source.to_string()),
            other => ("results".to_owned(), other.to_string()),
        };
        match by_reason.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, files)) => files.push(file),
            None => by_reason.push((reason, vec![file])),
        }
    }
    by_reason.into_iter().map(|(why, files)| format!("{}: cannot be written: {why}", files.join(", "))).collect()
}

fn was_interrupted(error: &anyhow::Error) -> bool {
    error.chain().any(|e| matches!(e.downcast_ref(), Some(scenario::Error::Interrupted)))
}

/// 130 or 143 for what a signal cut short, 2 for bad input, 1 for the rest.
pub fn status(error: &anyhow::Error) -> ExitCode {
    if let Some((_, status)) = signals::received().filter(|_| was_interrupted(error)) {
        return status;
    }
    let bad = error.chain().filter_map(|e| e.downcast_ref::<scenario::Error>()).any(scenario::Error::is_bad_input);
    ExitCode::from(if bad { BAD_INPUT } else { FAILURE })
}

/// Answers a command line that cannot be parsed, or that asks for help.
pub fn usage(error: &clap::Error) -> ExitCode {
    let asked = !error.use_stderr();
    // Nothing can be done if the terminal is gone.
    let _ = error.print();
    if asked {
        return ExitCode::SUCCESS;
    }
    if std::env::args_os().any(|a| a == "--json") {
        let message = error.to_string();
        let message = message.trim_start_matches("error: ").trim();
        let _ = Output { json: true }.write(&json!({ "error": message }), String::new);
    }
    ExitCode::from(BAD_INPUT)
}

/// The folder of files: the one that is asked for, or one with the name of what they are about.
pub fn folder(asked: Option<&Path>, name: &str) -> PathBuf {
    asked.map_or_else(|| Path::new("out").join(name), Path::to_owned)
}

/// One line on standard error.
pub fn complain(kind: &str, message: &str) {
    // Nothing can be done if standard error is gone.
    let _ = writeln!(std::io::stderr().lock(), "{kind}: {message}");
}

/// Columns, the first aligned left and the others right.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (c, (cell, width)) in row.iter().zip(&widths).enumerate() {
            if c == 0 {
                line.push_str(&format!("{cell:<width$}"));
            } else {
                line.push_str(&format!("  {cell:>width$}"));
            }
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// `value * scale` with `digits` decimals; "-" for what does not exist.
pub fn number(value: Option<f64>, scale: f64, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{:.digits$}", v * scale))
}

/// Four decimals, and of a small number no fewer than four digits.
pub fn significant(value: f64) -> String {
    if value == 0.0 || value.abs() >= 0.1 { format!("{value:.4}") } else { format!("{value:.3e}") }
}
