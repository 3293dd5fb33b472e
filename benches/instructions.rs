//! What one step of a held grasp costs in instructions, counted by callgrind: the same on every run and every machine of
//! one kind, however noisy.
//!
//! `scripts/instructions` runs this program under callgrind, which counts inside `counted_steps` only. By hand, for a
//! profile:
//!
//! ```sh
//! cargo bench --bench instructions --no-run   # prints the program's path
//! perf record PROGRAM SCENARIO grasp 200000
//! ```

use anyhow::Context;
use mujoco_grasp::grasp::{Grasps, Phase};
use mujoco_grasp::mujoco::Simulation;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use std::hint::black_box;

/// Steps before counting begins: buffers get their sizes, and the solver its memory.
const WARM_UP: usize = 100;
/// Steps of one call, as in `bench`.
const SUBSTEPS: usize = 10;

fn main() -> anyhow::Result<()> {
    // cargo's own arguments begin with a dash
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    let [scenario, variant, steps] = args.as_slice() else {
        println!("instructions SCENARIO grasp|exact|full|floor STEPS");
        return Ok(());
    };
    let steps: usize = steps.parse().context("STEPS is a number")?;
    let plan = Plan::load(scenario)?;
    let mut runner = Runner::new(&plan, Mode::Grasp, None)?;
    runner.advance_to(plan.timeline.measure_from())?;
    let (mut sim, mut grasps) = runner.into_parts();
    match variant.as_str() {
        "grasp" | "exact" => {}
        "full" => grasps.iter_mut().for_each(|grasp| {
            grasp.release();
            grasp.allow_latch(false);
        }),
        "floor" => {
            sim.set_contacts_enabled(false);
            grasps = Grasps::new();
        }
        other => anyhow::bail!("no variant {other}: grasp, exact, full or floor"),
    }
    for _ in 0..WARM_UP {
        grasps.step(&mut sim)?;
    }
    let call = if variant == "grasp" { SUBSTEPS } else { 1 };
    let counted = counted_steps(&mut sim, &mut grasps, steps, call)?;
    let [main, friction] = counted.iterations.map(|iterations| iterations as f64 / steps as f64);
    println!("{scenario} {variant}: latched in {} of {steps} steps", counted.latched);
    let whole: Vec<String> = grasps.whole_steps().map(|(why, count)| format!("{why} {count}")).collect();
    println!("on frozen geometry since the start: {} steps; whole: {}", grasps.frozen_steps(), whole.join(", "));
    println!("Newton iterations a step: {main} with soft contacts, {friction} in the friction pass");
    Ok(())
}

/// What happened in the counted steps.
struct Counted {
    /// Steps in which every grasp was latched.
    latched: usize,
    /// Newton iterations of the two passes, all grasps together.
    iterations: [usize; 2],
}

/// Callgrind counts inside this function; `--toggle-collect` finds it by its name.
#[inline(never)]
fn counted_steps(sim: &mut Simulation, grasps: &mut Grasps, steps: usize, call: usize) -> anyhow::Result<Counted> {
    let mut counted = Counted { latched: 0, iterations: [0; 2] };
    for k in 1..=steps {
        let grasps = black_box(&mut *grasps);
        if k % call == 0 {
            grasps.step(sim)?
        } else {
            grasps.substep(sim)?
        }
        counted.latched +=
            usize::from(!grasps.is_empty() && grasps.iter().all(|grasp| grasp.phase() == Phase::Grasped));
        for status in grasps.iter().map(|grasp| grasp.solve_status()) {
            counted.iterations[0] += status.main.iterations;
            counted.iterations[1] += status.noslip.iterations;
        }
    }
    Ok(counted)
}
