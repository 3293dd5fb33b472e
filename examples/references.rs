//! Writes the stored references of `tests/scenario/regression.rs`: MuJoCo's full contact solve of every built-in scenario and push.
//!
//! `cargo run --release --example references -- tests/data/reference`
//!
//! They go into a folder named after the engine's version. Full mode with 1000 noslip iterations, all of them made; from `measure_from` on one row each 20 ms, rounded to a
//! micrometre and a tenth of a millinewton.
#![forbid(unsafe_code)]

use anyhow::Context;
use mujoco_grasp::mujoco::mujoco_version;
use mujoco_grasp::scenario::builtin;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::run::{Observer, Options, run};
use mujoco_grasp::scenario::runner::Mode;
use std::path::PathBuf;

/// Rows of a reference per second.
const RATE: f64 = 50.0;

fn main() -> anyhow::Result<()> {
    let folder = PathBuf::from(std::env::args_os().nth(1).context("usage: references FOLDER")?);
    let folder = folder.join(mujoco_version());
    std::fs::create_dir_all(&folder)?;
    for scenario in builtin::ALL {
        let plan = Plan::load(scenario.name)?;
        for push in plan.select_pushes("all")? {
            let options = Options { noslip: Some(1000) };
            let full = run(&plan, Mode::Full, push, options, &Observer::NOBODY)?;
            anyhow::ensure!(full.error.is_none(), "{:?}", full.error);
            let name = push.map_or("none", |p| p.name.as_str());
            let mut rows = csv::Writer::from_path(folder.join(format!("{}-{name}.csv", plan.name)))?;
            let trajectory = &full.trajectory;
            let forces = trajectory.links().iter().map(|link| format!("normal_force_n:{link}"));
            let fixed = ["time_s", "px_m", "py_m", "pz_m"].map(str::to_owned);
            rows.write_record(fixed.into_iter().chain(forces))?;
            let mut next = plan.timeline.measure_from();
            for (i, s) in trajectory.samples().iter().enumerate() {
                if s.time + 1e-9 < next {
                    continue;
                }
                next += 1.0 / RATE;
                let p = s.position;
                let numbers = [p.x, p.y, p.z].map(|x| format!("{x:.6}"));
                let forces = trajectory.normal_forces(i).iter().map(|f| format!("{f:.4}"));
                rows.write_record([format!("{:.4}", s.time)].into_iter().chain(numbers).chain(forces))?;
            }
            rows.flush()?;
        }
    }
    Ok(())
}
