//! How long a run may be: what is recorded of it has to fit in memory.

use super::error::{Error, Field};
use super::plan::Plan;
use super::trajectory::Sample;

/// Steps of a whole run: one for each multiple of the time step from 0 to the duration.
pub(super) fn steps(plan: &Plan) -> f64 {
    (plan.timeline.duration / plan.model.timestep() + 0.5).floor() + 1.0
}

/// Bytes that one run records: a sample and the normal force of each link for every step and grasp.
pub(super) fn bytes(plan: &Plan, links: impl Iterator<Item = usize>) -> f64 {
    let a_step: usize = links.map(|n| size_of::<Sample>() + n * size_of::<f64>()).sum();
    steps(plan) * a_step as f64
}

/// Refuses `runs` runs that record `bytes` each, if they cannot fit in the memory that is free.
///
/// # Errors
/// [`Error::Field`], with steps and bytes.
pub(super) fn check_memory(plan: &Plan, bytes: f64, runs: usize) -> Result<(), Error> {
    let Some(free) = free_memory() else { return Ok(()) };
    let needed = bytes * runs as f64;
    if needed <= free {
        return Ok(());
    }
    let (step, duration) = (plan.model.timestep(), plan.timeline.duration);
    let longest = duration * (free / needed);
    Err(Field::new(&plan.file, "timeline.duration").wrong(format!(
        "is {duration:?} s: at {step} s a step that makes {:.3e} steps, and what {runs} run(s) record takes {}; {} of \
         memory are free: give less than {} s, a larger time step, or fewer pushes at once",
        steps(plan),
        amount(needed),
        amount(free),
        longest.floor()
    )))
}

fn amount(bytes: f64) -> String {
    const GIB: f64 = (1_u64 << 30) as f64;
    if bytes < 1e6 * GIB { format!("{:.1} GiB", bytes / GIB) } else { format!("{:.3e} GiB", bytes / GIB) }
}

/// What Linux says can be had without swapping \[bytes\]; `None` if it does not say.
fn free_memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? * 1024.0)
}

#[cfg(test)]
mod tests {
    #[test]
    fn free_memory_is_known_here() {
        let free = super::free_memory().expect("/proc/meminfo");
        assert!(free > 1e6 && free < 1e15, "{free}");
    }
}
