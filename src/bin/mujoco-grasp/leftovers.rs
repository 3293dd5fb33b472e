//! Files of an earlier call in the folder of results: they must not lie beside those of this one, as if they belonged to it.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::Context;
use mujoco_grasp::scenario::trajectory::COLUMNS;

/// Makes the folder, and removes what an earlier `run` wrote there: trajectories by their first line, and the pictures of
/// the same pushes. Other files stay.
///
/// # Errors
/// The system's.
pub fn clear_of_runs(out: &Path) -> anyhow::Result<()> {
    make(out)?;
    let mut pushes = Vec::new();
    let failed = || format!("cannot read the folder {}", out.display());
    for entry in out.read_dir().with_context(failed)? {
        let path = entry.with_context(failed)?.path();
        let Some(stem) = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_suffix(".csv")) else {
            continue;
        };
        let Some(push) = stem.strip_prefix("full-").or_else(|| stem.strip_prefix("grasp-")) else { continue };
        if is_trajectory(&path) {
            pushes.push(push.to_owned());
            remove(&path)?;
        }
    }
    for push in pushes {
        remove(&out.join(format!("motion-{push}.svg")))?;
        remove(&out.join(format!("strip-{push}.png")))?;
    }
    Ok(())
}

/// Makes the folder, and removes `files` from it.
///
/// # Errors
/// The system's.
pub fn clear_of(files: &[&str], out: &Path) -> anyhow::Result<()> {
    make(out)?;
    files.iter().try_for_each(|file| remove(&out.join(file)))
}

fn make(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))
}

fn is_trajectory(path: &Path) -> bool {
    let head = COLUMNS.join(",");
    let mut start = vec![0; head.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == head.as_bytes()
}

fn remove(path: &Path) -> anyhow::Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(e).with_context(|| format!("cannot remove {}, which an earlier call wrote", path.display()))
        }
        _ => Ok(()),
    }
}
