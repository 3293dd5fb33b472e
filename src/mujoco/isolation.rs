//! Loading a model in a child process: what ends or hangs MuJoCo's compiler ends the child alone.

use super::error::Error;
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::{FromRawFd, RawFd};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

static SECONDS: AtomicU32 = AtomicU32::new(0);

/// From now on every model of this process is compiled in a child process, for models from strangers: no file can then
/// crash, end or hang this process, or use up its memory. A load that takes longer than `limit` (whole seconds, at least
/// one), or more than half of the machine's memory, is an [`Error::Load`]; so is one in which MuJoCo dies. What the
/// child has compiled comes back as MuJoCo's binary model. `None` switches this off.
///
/// The child is a fork: where other threads of this process are inside MuJoCo's compiler at that moment, it may wait for
/// them until `limit`.
pub fn isolate_loading(limit: Option<Duration>) {
    let seconds = limit.map_or(0, |limit| u32::try_from(limit.as_secs()).unwrap_or(u32::MAX).max(1));
    SECONDS.store(seconds, Ordering::Relaxed);
}

/// The time limit of a load in seconds, if it is to be isolated.
pub(super) fn limit() -> Option<u32> {
    Some(SECONDS.load(Ordering::Relaxed)).filter(|&seconds| seconds > 0)
}

/// What the child has to say: a mark, the length of a text, the text, and the model if the mark is [`LOADED`].
const LOADED: u8 = 1;
const REFUSED: u8 = 0;
const HEAD: usize = 9;

/// Runs `load` in a child process, and takes over what it gives: warnings, and a binary model.
pub(super) fn load(
    what: &str,
    seconds: u32,
    load: impl FnOnce() -> Result<(String, Vec<u8>), Error>,
) -> Result<(String, Vec<u8>), Error> {
    let failed = |message: String| Error::Load { what: what.into(), message };
    let system = |doing: &str| failed(format!("{doing}: {}", std::io::Error::last_os_error()));
    let mut ends: [RawFd; 2] = [0; 2];
    // SAFETY: an array of two.
    if unsafe { libc::pipe2(ends.as_mut_ptr(), libc::O_CLOEXEC) } != 0 {
        return Err(system("no pipe to a child process"));
    }
    // SAFETY: fresh descriptors that nobody else has.
    let [mut read, write] = ends.map(|end| unsafe { File::from_raw_fd(end) });
    // SAFETY: the child runs no code but `child`, which does not come back; glibc keeps its allocator usable in it.
    match unsafe { libc::fork() } {
        -1 => Err(system("no child process")),
        0 => {
            drop(read);
            child(seconds, write, load)
        }
        pid => {
            drop(write);
            let mut said = Vec::new();
            let heard = read.read_to_end(&mut said);
            let status = wait(pid);
            heard.map_err(|e| failed(format!("the child process that loads it cannot be heard: {e}")))?;
            if libc::WIFSIGNALED(status) {
                return Err(failed(death(libc::WTERMSIG(status), seconds)));
            }
            match understood(&said) {
                Some((LOADED, text, model)) => Ok((text.to_owned(), model.to_vec())),
                Some((_, text, _)) => Err(failed(text.into())),
                None => Err(failed("MuJoCo has ended the child process that loads it".into())),
            }
        }
    }
}

fn wait(pid: libc::pid_t) -> libc::c_int {
    let mut status = 0;
    // SAFETY: our own child and a place for its status.
    while unsafe { libc::waitpid(pid, &mut status, 0) } < 0 {
        if std::io::Error::last_os_error().kind() != std::io::ErrorKind::Interrupted {
            break;
        }
    }
    status
}

fn understood(said: &[u8]) -> Option<(u8, &str, &[u8])> {
    let (head, rest) = said.split_first_chunk::<HEAD>()?;
    let [mark, length @ ..] = *head;
    let (text, model) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(length)).ok()?)?;
    Some((mark, std::str::from_utf8(text).ok()?, model))
}

fn death(signal: libc::c_int, seconds: u32) -> String {
    let name = match signal {
        libc::SIGALRM => return format!("it has not loaded within {seconds} s, in a child process"),
        libc::SIGSEGV => "segmentation fault",
        libc::SIGBUS => "bus error",
        libc::SIGABRT => "abort",
        libc::SIGFPE => "arithmetic fault",
        libc::SIGKILL => "killed, perhaps for want of memory",
        _ => "see signal(7)",
    };
    format!("MuJoCo died of signal {signal} ({name}) while loading it, in a child process")
}

/// The child's whole life.
fn child(seconds: u32, mut write: File, load: impl FnOnce() -> Result<(String, Vec<u8>), Error>) -> ! {
    confine(seconds);
    let loaded = catch_unwind(AssertUnwindSafe(|| match load() {
        Ok((warnings, binary)) => (LOADED, warnings, binary),
        Err(Error::Load { message, .. }) => (REFUSED, message, Vec::new()),
        Err(other) => (REFUSED, other.to_string(), Vec::new()),
    }));
    let said = loaded.map(|(mark, text, binary)| {
        let length = (text.len() as u64).to_le_bytes();
        [&[mark][..], &length, text.as_bytes(), &binary].iter().all(|part| write.write_all(part).is_ok())
    });
    // SAFETY: ends the child without running what the parent has registered for its own end.
    unsafe { libc::_exit(i32::from(!matches!(said, Ok(true)))) }
}

/// Limits of time and memory; silence, and nobody to wait for a key.
fn confine(seconds: u32) {
    // SAFETY: calls that only concern this process, with valid arguments.
    unsafe {
        libc::signal(libc::SIGALRM, libc::SIG_DFL);
        let mut alarm: libc::sigset_t = std::mem::zeroed();
        libc::sigemptyset(&mut alarm);
        libc::sigaddset(&mut alarm, libc::SIGALRM);
        libc::sigprocmask(libc::SIG_UNBLOCK, &alarm, std::ptr::null_mut());
        libc::alarm(seconds);
        let null = libc::open(c"/dev/null".as_ptr(), libc::O_RDWR);
        for stream in 0..3 {
            libc::dup2(null, stream);
        }
        let none = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
        libc::setrlimit(libc::RLIMIT_CORE, &none);
        let (pages, size) = (libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE));
        if pages > 0 && size > 0 {
            let half = pages as libc::rlim_t * size as libc::rlim_t / 2;
            libc::setrlimit(libc::RLIMIT_AS, &libc::rlimit { rlim_cur: half, rlim_max: half });
        }
    }
}
