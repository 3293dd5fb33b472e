//! Real models that nobody here wrote: MJCF of PyPI wheels, fetched once into `target/wheels`.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A wheel, pinned.
#[derive(Clone, Copy, Debug)]
pub struct Wheel {
    package: &'static str,
    sha256: &'static str,
    /// Where it is unpacked.
    folder: &'static str,
    /// The folder in it that has its models.
    assets: &'static str,
}

pub const GYMNASIUM_ROBOTICS: Wheel = Wheel {
    package: "gymnasium-robotics==1.4.2",
    sha256: "a1743530431cb377e6b3b956d284bc96436fc68bac1648ef205054c178e7dc4b",
    folder: "gymnasium_robotics-1.4.2",
    assets: "gymnasium_robotics/envs/assets",
};
pub const GYM_ALOHA: Wheel = Wheel {
    package: "gym-aloha==0.1.5",
    sha256: "1794dd9a1146268a9b56f4a4931bcba69ca27714c2ac9ac146e471801bf0c7b3",
    folder: "gym_aloha-0.1.5",
    assets: "gym_aloha",
};
pub const METAWORLD: Wheel = Wheel {
    package: "metaworld==3.1.1",
    sha256: "99e25d9baf97f2f1a19ca89c0d2ca9c6a2b396d9a9be81729de64eedc683f0d3",
    folder: "metaworld-3.1.1",
    assets: "metaworld/assets",
};
pub const ORCA_SIM: Wheel = Wheel {
    package: "orca-sim==0.1.0",
    sha256: "4e7c8c9aa7d05cb8d6ca380176c5dc53498c73d4cd34a997d939ca60c4be3ee6",
    folder: "orca_sim-0.1.0",
    assets: "orca_sim",
};

/// With this set to 1, a test that cannot have the wheel passes, loudly.
const OFFLINE: &str = "MUJOCO_GRASP_OFFLINE";

/// The models of gymnasium-robotics, as [`Wheel::assets`].
pub fn assets() -> Option<PathBuf> {
    GYMNASIUM_ROBOTICS.assets()
}

impl Wheel {
    /// The wheel's folder of models, unpacked; `None`, after a banner, where the wheel cannot be fetched and that was
    /// allowed by `MUJOCO_GRASP_OFFLINE=1`. Otherwise a wheel that cannot be fetched fails the test.
    pub fn assets(&self) -> Option<PathBuf> {
        let wheels = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("wheels");
        let assets = wheels.join(self.folder).join(self.assets);
        if assets.is_dir() {
            return Some(assets);
        }
        match self.fetch(&wheels) {
            Ok(()) => Some(assets),
            Err(why) => {
                let allowed = std::env::var_os(OFFLINE).as_deref() == Some(OsStr::new("1"));
                banner(self.package, &why, allowed);
                assert!(allowed, "the wheel {} cannot be fetched: {why}", self.package);
                None
            }
        }
    }

    /// Downloads and unpacks beside the final folder and moves it there in one step: tests run at the same time.
    fn fetch(&self, wheels: &Path) -> Result<(), String> {
        let text = |e: std::io::Error| e.to_string();
        fs::create_dir_all(wheels).map_err(text)?;
        let staging = tempfile::tempdir_in(wheels).map_err(text)?;
        let requirements = staging.path().join("requirements.txt");
        fs::write(&requirements, format!("{} --hash=sha256:{}\n", self.package, self.sha256)).map_err(text)?;
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
        let unpacked = staging.path().join(self.folder);
        python([OsStr::new("-m"), OsStr::new("zipfile"), OsStr::new("-e"), wheel.as_os_str(), unpacked.as_os_str()])?;
        match fs::rename(&unpacked, wheels.join(self.folder)) {
            // another test was faster
            Err(_) if wheels.join(self.folder).join(self.assets).is_dir() => Ok(()),
            other => other.map_err(text),
        }
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
fn banner(package: &str, why: &str, allowed: bool) {
    let line = "!".repeat(100);
    let outcome = if allowed {
        format!("{OFFLINE}=1: the tests on its models are SKIPPED. Nothing is known about them.")
    } else {
        format!("The tests on its models fail. Without network, {OFFLINE}=1 lets them pass unseen.")
    };
    let text = format!("\n{line}\nThe PyPI wheel {package} cannot be fetched.\n{why}\n{outcome}\n{line}\n");
    // nothing is left to be done if standard error is gone
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}
