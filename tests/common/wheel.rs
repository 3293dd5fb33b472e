//! Real models that nobody here wrote: the MJCF of the PyPI wheel gymnasium-robotics, fetched once into `target/wheels`.
#![allow(dead_code)]

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const PACKAGE: &str = "gymnasium-robotics==1.4.2";
const SHA256: &str = "a1743530431cb377e6b3b956d284bc96436fc68bac1648ef205054c178e7dc4b";
const FOLDER: &str = "gymnasium_robotics-1.4.2";
const ASSETS: &str = "gymnasium_robotics/envs/assets";
/// With this set to 1, a test that cannot have the wheel passes, loudly.
const OFFLINE: &str = "MUJOCO_GRASP_OFFLINE";

/// The wheel's `gymnasium_robotics/envs/assets`, unpacked; `None`, after a banner, where the wheel cannot be fetched and
/// that was allowed by `MUJOCO_GRASP_OFFLINE=1`. Otherwise a wheel that cannot be fetched fails the test.
pub fn assets() -> Option<PathBuf> {
    let wheels = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("wheels");
    let assets = wheels.join(FOLDER).join(ASSETS);
    if assets.is_dir() {
        return Some(assets);
    }
    match fetch(&wheels) {
        Ok(()) => Some(assets),
        Err(why) => {
            let allowed = std::env::var_os(OFFLINE).as_deref() == Some(OsStr::new("1"));
            banner(&why, allowed);
            assert!(allowed, "the wheel {PACKAGE} cannot be fetched: {why}");
            None
        }
    }
}

/// Downloads and unpacks beside the final folder and moves it there in one step: tests run at the same time.
fn fetch(wheels: &Path) -> Result<(), String> {
    let text = |e: std::io::Error| e.to_string();
    fs::create_dir_all(wheels).map_err(text)?;
    let staging = tempfile::tempdir_in(wheels).map_err(text)?;
    let requirements = staging.path().join("requirements.txt");
    fs::write(&requirements, format!("{PACKAGE} --hash=sha256:{SHA256}\n")).map_err(text)?;
    python(
        ["-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:", "--require-hashes"]
            .map(OsStr::new)
            .into_iter()
            .chain([OsStr::new("--dest"), staging.path().as_os_str(), OsStr::new("-r"), requirements.as_os_str()]),
    )?;
    let wheel = fs::read_dir(staging.path())
        .map_err(text)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .find(|path| path.extension() == Some(OsStr::new("whl")))
        .ok_or("pip left no wheel")?;
    let unpacked = staging.path().join(FOLDER);
    python([OsStr::new("-m"), OsStr::new("zipfile"), OsStr::new("-e"), wheel.as_os_str(), unpacked.as_os_str()])?;
    match fs::rename(&unpacked, wheels.join(FOLDER)) {
        // another test was faster
        Err(_) if wheels.join(FOLDER).join(ASSETS).is_dir() => Ok(()),
        other => other.map_err(text),
    }
}

/// Runs Debian's own python if there is one: it is the one that `make test` gives pip.
fn python<'a>(arguments: impl IntoIterator<Item = &'a OsStr>) -> Result<(), String> {
    let program = if Path::new("/usr/bin/python3").is_file() { "/usr/bin/python3" } else { "python3" };
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null());
    let output = command.output().map_err(|e| format!("{program}: {e}"))?;
    if output.status.success() {
        Ok(())
    } else {
        Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr).trim()))
    }
}

/// Straight to standard error, past the test harness, which shows the output of failing tests only.
fn banner(why: &str, allowed: bool) {
    let line = "!".repeat(100);
    let outcome = if allowed {
        format!("{OFFLINE}=1: the tests on the Shadow Hand are SKIPPED. Nothing is known about them.")
    } else {
        format!("The tests on the Shadow Hand fail. Without network, {OFFLINE}=1 lets them pass unseen.")
    };
    let text = format!("\n{line}\nThe PyPI wheel {PACKAGE} cannot be fetched.\n{why}\n{outcome}\n{line}\n");
    // nothing is left to be done if standard error is gone
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}
