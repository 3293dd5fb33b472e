//! Runs the program as a user does.

pub mod reference;

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

/// What a call left behind.
pub struct Called {
    pub status: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Called {
    /// The one JSON object on standard output.
    #[track_caller]
    pub fn json(&self) -> Value {
        let mut objects = serde_json::Deserializer::from_str(&self.stdout).into_iter::<Value>();
        let first = objects.next().expect("standard output is empty").expect("standard output is no JSON");
        assert!(first.is_object(), "{first}");
        assert!(objects.next().is_none(), "more than one JSON value: {}", self.stdout);
        first
    }
}

/// Calls `mujoco-grasp` in `folder`.
pub fn call_in(folder: &Path, args: &[&str]) -> Called {
    let output = Command::new(env!("CARGO_BIN_EXE_mujoco-grasp")).args(args).current_dir(folder).output().unwrap();
    Called {
        status: output.status.code().expect("ended by a signal"),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

/// The file of `tests/data`, absolute.
pub fn data(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name).to_str().unwrap().to_owned()
}

/// A folder of its own with copies of the claw and its scenario, the one changed by `model`, the other by `scenario`.
#[allow(dead_code)] // Not every test file changes the claw.
pub fn changed_claw(model: &[(&str, &str)], scenario: &[(&str, &str)]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    for (file, changes) in [("claw.xml", model), ("claw.toml", scenario)] {
        let mut text = std::fs::read_to_string(data(file)).unwrap();
        for (from, to) in changes {
            assert!(text.contains(from), "{file} has no {from}");
            text = text.replacen(from, to, 1);
        }
        std::fs::write(folder.path().join(file), text).unwrap();
    }
    let path = folder.path().join("claw.toml");
    (folder, path)
}
