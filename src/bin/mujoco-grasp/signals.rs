//! Ctrl-C and a request to terminate: what is finished is kept and reported. A second one ends the program at once.

use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

use mujoco_grasp::scenario::stop::Stop;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// What shells report of a program that a signal ended is this much and the signal's number.
const ENDED_BY_SIGNAL: i32 = 128;

static STOP: LazyLock<Stop> = LazyLock::new(Stop::default);
/// Number of the last signal; 0 for none.
static RECEIVED: LazyLock<Arc<AtomicUsize>> = LazyLock::new(Arc::default);

/// From now on signals set [`stop`].
///
/// # Errors
/// The system's.
pub fn install() -> std::io::Result<()> {
    for signal in [SIGINT, SIGTERM] {
        // In the order of these calls: the second signal finds the flag set by the first.
        flag::register_conditional_shutdown(signal, ENDED_BY_SIGNAL + signal, STOP.flag())?;
        flag::register_usize(signal, Arc::clone(&RECEIVED), signal as usize)?;
        flag::register(signal, STOP.flag())?;
    }
    Ok(())
}

/// The flag that plans are to have.
pub fn stop() -> Stop {
    STOP.clone()
}

/// Name and exit status of the signal that came, if one did.
pub fn received() -> Option<(&'static str, ExitCode)> {
    let signal = RECEIVED.load(Ordering::Relaxed) as i32;
    let name = match signal {
        SIGINT => "SIGINT",
        SIGTERM => "SIGTERM",
        _ => return None,
    };
    Some((name, ExitCode::from((ENDED_BY_SIGNAL + signal) as u8)))
}
