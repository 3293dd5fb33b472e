//! `run`, `bench` and `agree` of scenario files, as the JSON of the command line; the package makes dataclasses of it.

use crate::errors::{ScenarioError, of_scenario};
use crate::pool::SHARED;
use crate::spec;
use mujoco_grasp::grasp::Limits;
use mujoco_grasp::mujoco::mujoco_version;
use mujoco_grasp::scenario::agree::Ground;
use mujoco_grasp::scenario::agreement::Agreement;
use mujoco_grasp::scenario::bench::bench;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::run::{Observer, Options, Pair, Run, run_all};
use mujoco_grasp::scenario::runner::Mode;
use mujoco_grasp::scenario::stop::Stop;
use mujoco_grasp::scenario::sweep::{self, Shard, Sweep};
use mujoco_grasp::scenario::{Error, source};
use pyo3::prelude::*;
use rayon::ThreadPool;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

/// How soon an interrupt is seen.
const POLL: Duration = Duration::from_millis(50);

#[derive(Serialize)]
struct RunReport<'a> {
    scenario: &'a str,
    engine: String,
    nv: usize,
    timestep_s: f64,
    runs: &'a [Pair],
    error: Option<String>,
}

/// The scenario with what was given in the place of its own.
fn load(
    scenario: &str,
    limits: Option<Limits>,
    frozen_tolerance: Option<f64>,
    duration: Option<f64>,
) -> Result<Plan, Error> {
    let plan = Plan::load_with(scenario, limits)?.with_frozen_tolerance(frozen_tolerance)?;
    match duration {
        Some(duration) => plan.lasting(duration),
        None => Ok(plan),
    }
}

fn stop_of_plan(plan: &Plan) -> &Stop {
    &plan.stop
}

fn json(report: &impl Serialize) -> String {
    // Numbers that are none are null, and keys are texts: nothing can fail.
    serde_json::to_string(report).unwrap_or_default()
}

/// Runs `work` on a thread of its own, which has the engine's handlers for itself, or on those of a pool, and sees to
/// Python's signals meanwhile.
fn detached<T: Sync>(
    py: Python<'_>,
    pool: Option<&ThreadPool>,
    load: impl FnOnce() -> Result<T, Error> + Send,
    stop_of: fn(&T) -> &Stop,
    work: impl FnOnce(&T) -> Result<String, Error> + Send,
) -> PyResult<String> {
    let (hand_over, loaded) = sync_channel(1);
    let (done, mut result) = sync_channel(1);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let made = load().and_then(|loaded| {
                let _ = hand_over.send(stop_of(&loaded).clone());
                match pool {
                    Some(pool) => pool.install(|| work(&loaded)),
                    None => work(&loaded),
                }
            });
            let _ = done.send(made);
        });
        let mut signalled = Ok(());
        let mut stop = None;
        loop {
            let waited;
            (waited, result) = py.detach(move || (result.recv_timeout(POLL), result));
            stop = stop.or_else(|| loaded.try_recv().ok());
            match waited {
                Ok(_) if signalled.is_err() => return signalled.map(|()| String::new()),
                Ok(made) => return made.map_err(of_scenario),
                Err(RecvTimeoutError::Timeout) => {
                    signalled = signalled.and_then(|()| py.check_signals());
                    if let (true, Some(stop)) = (signalled.is_err(), &stop) {
                        stop.ask();
                    }
                }
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(ScenarioError::new_err("the simulation has ended without a result"));
                }
            }
        }
    })
}

/// All built-in scenarios.
#[pyfunction]
pub fn scenarios_json() -> PyResult<String> {
    source::list().map(|list| json(&list)).map_err(of_scenario)
}

#[pyfunction]
#[pyo3(signature = (scenario, mode, push, limits, noslip, frozen_tolerance, duration, out))]
#[allow(clippy::too_many_arguments)] // the options of the command line
pub fn run_json(
    py: Python<'_>,
    scenario: &str,
    mode: &str,
    push: &str,
    limits: Option<&Bound<'_, PyAny>>,
    noslip: Option<u16>,
    frozen_tolerance: Option<f64>,
    duration: Option<f64>,
    out: Option<PathBuf>,
) -> PyResult<String> {
    let modes: &[Mode] = match mode {
        "full" => &[Mode::Full],
        "grasp" => &[Mode::Grasp],
        "both" => &[Mode::Full, Mode::Grasp],
        other => {
            return Err(ScenarioError::new_err(format!(
                "mode is {other:?}; it must be \"full\", \"grasp\" or \"both\""
            )));
        }
    };
    if let Some(out) = &out {
        std::fs::create_dir_all(out).map_err(|e| ScenarioError::new_err(format!("{}: {e}", out.display())))?;
    }
    let limits = limits.map(spec::limits).transpose()?;
    let options = Options { noslip: noslip.map(usize::from) };
    let loaded = || load(scenario, limits, frozen_tolerance, duration);
    detached(py, Some(&*SHARED.get()?), loaded, stop_of_plan, |plan| {
        let pushes = plan.select_pushes(push)?;
        let write = |run: &Run| out.as_ref().map_or(Ok(()), |out| run.write_csv(out).map(drop));
        let observer = Observer { steps: &|_| (), finished: &write };
        let pairs = run_all(plan, modes, &pushes, options, &observer)?;
        plan.stop.check()?;
        let runs = pairs.iter().flat_map(Pair::runs);
        let failures: Vec<String> =
            runs.flat_map(|run| [&run.error, &run.unwritten]).flatten().map(ToString::to_string).collect();
        Ok(json(&RunReport {
            scenario: &plan.name,
            engine: mujoco_version(),
            nv: plan.model.nv(),
            timestep_s: plan.model.timestep(),
            runs: &pairs,
            error: (!failures.is_empty()).then(|| failures.join("; ")),
        }))
    })
}

#[pyfunction]
#[pyo3(signature = (scenario, steps, substeps, limits, frozen_tolerance))]
pub fn bench_json(
    py: Python<'_>,
    scenario: &str,
    steps: u32,
    substeps: u32,
    limits: Option<&Bound<'_, PyAny>>,
    frozen_tolerance: Option<f64>,
) -> PyResult<String> {
    if steps == 0 || substeps == 0 {
        return Err(ScenarioError::new_err("steps and substeps must be at least 1"));
    }
    let limits = limits.map(spec::limits).transpose()?;
    let loaded = || load(scenario, limits, frozen_tolerance, None);
    detached(py, None, loaded, stop_of_plan, |plan| Ok(json(&bench(plan, steps as usize, substeps as usize, &|_| ())?)))
}

#[pyfunction]
#[pyo3(signature = (scenario, trials, seed, limits, noslip, frozen_tolerance))]
pub fn agree_json(
    py: Python<'_>,
    scenario: &str,
    trials: u64,
    seed: u64,
    limits: Option<&Bound<'_, PyAny>>,
    noslip: Option<u16>,
    frozen_tolerance: Option<f64>,
) -> PyResult<String> {
    if !(1..=1_000_000).contains(&trials) {
        return Err(ScenarioError::new_err(format!("trials is {trials}; it must be from 1 to 1000000")));
    }
    let limits = limits.map(spec::limits).transpose()?;
    let options = Options { noslip: noslip.map(usize::from) };
    let loaded = || load(scenario, limits, frozen_tolerance, None);
    detached(py, Some(&*SHARED.get()?), loaded, stop_of_plan, |plan| {
        let ground = Ground::new(plan, options)?;
        let onsets = ground.onsets(&|| ());
        plan.stop.check()?;
        let trials = ground.trials(&onsets, trials, seed, &|| ());
        plan.stop.check()?;
        Ok(json(&Agreement::of(&ground, seed, &onsets, &trials, None)))
    })
}

#[pyfunction]
#[pyo3(signature = (spec, out, shard, mode))]
pub fn sweep_json(py: Python<'_>, spec: PathBuf, out: PathBuf, shard: Option<&str>, mode: &str) -> PyResult<String> {
    let mode = match mode {
        "full" => Mode::Full,
        "grasp" => Mode::Grasp,
        other => return Err(ScenarioError::new_err(format!("mode is {other:?}; it must be \"full\" or \"grasp\""))),
    };
    let shard = shard.map_or(Ok(Shard::ALL), str::parse).map_err(of_scenario)?;
    let loaded = || Sweep::load(&spec);
    detached(
        py,
        Some(&*SHARED.get()?),
        loaded,
        |sweep| &sweep.plan.stop,
        |sweep| Ok(json(&sweep::run(sweep, mode, shard, &out, &|_| ())?)),
    )
}
