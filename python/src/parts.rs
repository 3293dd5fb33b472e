//! A call of many steps in parts, so that Python's signals, Ctrl-C among them, are seen to in between.

use crate::session::Advance;
use pyo3::intern;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// What a part is to take.
const PART: Duration = Duration::from_millis(100);

/// Fewer steps are one part: what it costs to look would be felt.
const FEW: usize = 64;

/// Time of a step \[ns\] as last measured, 0 before.
#[derive(Default)]
pub struct Pace(AtomicU64);

/// Makes `n` steps, of `simulations` each, by `make`. Results are those of one part: all of them but the last end with a step
/// after which the next may go on frozen geometry.
///
/// # Errors
/// What `make` returns; what a signal's handler raises, after a whole step.
pub fn make(
    py: Python<'_>,
    n: usize,
    simulations: usize,
    pace: &Pace,
    mut make: impl FnMut(Advance) -> PyResult<()>,
) -> PyResult<()> {
    if n < 2 || n.saturating_mul(simulations) < FEW || !on_main_thread(py)? {
        return make(Advance::steps(n));
    }
    let mut left = n;
    loop {
        let step = pace.0.load(Ordering::Relaxed);
        let fitting = (PART.as_nanos() as u64).checked_div(step).unwrap_or(1);
        let part = usize::try_from(fitting).unwrap_or(usize::MAX).clamp(1, left);
        let clock = Instant::now();
        make(if part == left { Advance::rest(part) } else { Advance::substeps(part) })?;
        pace.0.store((clock.elapsed().as_nanos() / part as u128).max(1) as u64, Ordering::Relaxed);
        left -= part;
        if left == 0 {
            return Ok(());
        }
        // Between two parts nothing is locked: a handler may read what it likes.
        if let Err(raised) = py.check_signals() {
            // All of the data is computed, as after any call; what else is wrong the next one says.
            let _ = make(Advance::rest(1));
            return Err(raised);
        }
    }
}

/// Python sees to signals on no other.
fn on_main_thread(py: Python<'_>) -> PyResult<bool> {
    let threading = py.import(intern!(py, "threading"))?;
    let main = threading.call_method0(intern!(py, "main_thread"))?.getattr(intern!(py, "ident"))?;
    threading.call_method0(intern!(py, "get_ident"))?.eq(main)
}
