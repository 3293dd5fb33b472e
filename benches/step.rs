//! One step of the claw while it holds its ball: full solve, full with noslip 10, grasp, and the floor without contacts.
//!
//! All four take turns from the same saved state whichever is being measured, so that they see the same machine. The
//! ratios at the end are those of `mujoco-grasp bench`, which interleaves likewise.

use criterion::{Criterion, Throughput};
use mujoco_grasp::grasp::{Grasps, Phase};
use mujoco_grasp::mujoco::{Simulation, State};
use mujoco_grasp::scenario::bench::bench;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use std::time::{Duration, Instant};

/// Steps of one turn.
const TURN: u64 = 50;
const SCENES: [&str; 2] = ["claw", "claw4"];

/// One way of stepping the scene.
struct Lane {
    name: &'static str,
    sim: Simulation,
    grasps: Grasps,
}

/// Four ways of stepping the same held grasp, and where they start.
struct Lanes {
    lanes: Vec<Lane>,
    state: State,
    held: Grasps,
}

impl Lanes {
    fn new(plan: &Plan) -> anyhow::Result<Lanes> {
        let mut runner = Runner::new(plan, Mode::Grasp, None)?;
        runner.advance_to(plan.timeline.measure_from())?;
        let (sim, held) = runner.into_parts();
        anyhow::ensure!(held.iter().all(|g| g.phase() == Phase::Grasped), "{} is not latched", plan.name);
        let state = sim.save();
        let engine = |name, noslip| -> anyhow::Result<Lane> {
            let mut sim = Simulation::new(&plan.model)?;
            sim.set_noslip_iterations(noslip)?;
            Ok(Lane { name, sim, grasps: Grasps::new() })
        };
        let mut floor = engine("floor", 0)?;
        floor.sim.set_contacts_enabled(false);
        let grasp = Lane { name: "grasp", sim, grasps: held.clone() };
        Ok(Lanes { lanes: vec![engine("full", 0)?, engine("full noslip 10", 10)?, grasp, floor], state, held })
    }

    /// A turn of every lane; the time of lane `measured`.
    fn turn(&mut self, measured: usize) -> anyhow::Result<Duration> {
        let mut time = Duration::ZERO;
        for (i, lane) in self.lanes.iter_mut().enumerate() {
            lane.sim.restore(&self.state)?;
            if !lane.grasps.is_empty() {
                lane.grasps.clone_from(&self.held);
            }
            let start = Instant::now();
            for _ in 0..TURN {
                lane.grasps.step(&mut lane.sim)?;
            }
            if i == measured {
                time = start.elapsed();
            }
        }
        Ok(time)
    }
}

fn steps(criterion: &mut Criterion, plan: &Plan) -> anyhow::Result<()> {
    let mut lanes = Lanes::new(plan)?;
    let mut group = criterion.benchmark_group(format!("step/{}", plan.name));
    group.throughput(Throughput::Elements(1));
    for measured in 0..lanes.lanes.len() {
        let name = lanes.lanes[measured].name;
        group.bench_function(name, |bencher| {
            bencher.iter_custom(|steps| {
                let turns = steps.div_ceil(TURN);
                let turn = |_| lanes.turn(measured).unwrap_or_else(|e| panic!("{name}: {e}"));
                let total: Duration = (0..turns).map(turn).sum();
                total.mul_f64(steps as f64 / (turns * TURN) as f64)
            });
        });
    }
    group.finish();
    Ok(())
}

fn ratios(plan: &Plan) -> anyhow::Result<()> {
    let report = bench(plan, 5000, 10, &|_| ())?;
    for (load, phases) in [("still", Some(&report.still)), ("pushed", report.pushed.as_ref())] {
        let Some(phases) = phases else { continue };
        let r = &phases.ratio;
        let times = [r.contact, r.contact_noslip, r.step, r.step_noslip, r.step_over_floor]
            .map(|x| x.map_or("-".to_owned(), |x| format!("{x:.2}")));
        let [contact, contact_noslip, step, step_noslip, floor] = times;
        println!(
            "{} {load}: full/grasp {contact} (noslip 10: {contact_noslip}) in the contact part, {step} ({step_noslip}) in the \
             step; grasp/floor {floor}",
            plan.name
        );
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let mut criterion = Criterion::default()
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
        .sample_size(30)
        .configure_from_args();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");
    for scene in SCENES {
        steps(&mut criterion, &Plan::load(&format!("{folder}/{scene}.toml"))?)?;
    }
    // `cargo bench` passes --bench; with a filter, --list or --test the ratios were not asked for
    if std::env::args().skip(1).eq(["--bench"]) {
        for scene in SCENES {
            ratios(&Plan::load(&format!("{folder}/{scene}.toml"))?)?;
        }
    }
    criterion.final_summary();
    Ok(())
}
