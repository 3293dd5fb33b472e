//! Turns engine faults into errors.
//!
//! MuJoCo's default reaction to a fault is to print, wait for a key and exit the process, and a handler that returns
//! lets the engine run on past the fault. So the handler installed here, on each thread that calls the engine, unwinds
//! (without the panic hook) with the message, and [`call`] catches it outside the engine. Warnings are kept as text,
//! so that nothing is printed and no `MUJOCO_LOG.TXT` is written.

use super::compat;
use super::error::Error;
use std::cell::{Cell, RefCell};
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// More different warning texts than this between two calls of [`take_texts`] are dropped.
const MAX_TEXTS: usize = 32;

thread_local! {
    static INSTALLED: Cell<bool> = const { Cell::new(false) };
    static HAS_TEXTS: Cell<bool> = const { Cell::new(false) };
    static TEXTS: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
}

/// The payload with which the handler unwinds.
struct Fault(String);

/// Runs `f`, which calls the engine; a fault in it becomes [`Error::Engine`] with the name `call`.
#[inline]
pub(super) fn call<R>(call: &'static str, f: impl FnOnce() -> R) -> Result<R, Error> {
    if !INSTALLED.get() {
        install();
    }
    catch_unwind(AssertUnwindSafe(f)).map_err(|payload| fault(call, payload))
}

/// Installs the handlers again: the model compiler swaps them while it works.
pub(super) fn install() {
    let _ = compat::install_handlers();
    INSTALLED.set(true);
}

/// Runs `f` with the handlers installed, on a thread where another binding may have others: those are back afterwards, also
/// when `f` unwinds. Texts of warnings that nobody has taken by then are dropped.
pub(super) fn visit<R>(f: impl FnOnce() -> R) -> R {
    struct Before(compat::Handlers, bool);
    impl Drop for Before {
        fn drop(&mut self) {
            if has_texts() {
                take_texts();
            }
            compat::put_back_handlers(self.0);
            INSTALLED.set(self.1);
        }
    }
    let _before = Before(compat::install_handlers(), INSTALLED.replace(true));
    f()
}

#[cold]
fn fault(call: &'static str, payload: Box<dyn std::any::Any + Send>) -> Error {
    match payload.downcast::<Fault>() {
        Ok(fault) => Error::Engine {
            call,
            message: match compat::full_stack(&fault.0) {
                Some(size) => format!("Stack overflow: raise {size} in the model's <size> element"),
                None => fault.0,
            },
        },
        // Not the engine's: a panic of the closure itself goes on.
        Err(other) => resume_unwind(other),
    }
}

/// Whether the engine has warned on this thread since [`take_texts`].
#[inline]
pub(super) fn has_texts() -> bool {
    HAS_TEXTS.get()
}

/// The different warning texts of this thread since the last call.
pub(super) fn take_texts() -> Vec<String> {
    HAS_TEXTS.set(false);
    TEXTS.take()
}

/// The engine's error handler: unwinds to [`call`].
pub(super) fn raise(text: String) -> ! {
    resume_unwind(Box::new(Fault(text)))
}

/// The engine's warning handler: keeps the text.
pub(super) fn note(text: &str) {
    TEXTS.with_borrow_mut(|texts| {
        if texts.len() < MAX_TEXTS && !texts.iter().any(|known| *known == text) {
            texts.push(text.into());
        }
    });
    HAS_TEXTS.set(true);
}

/// # Safety
/// `message` is null or a NUL-terminated string that outlives the result.
pub(super) unsafe fn text_of<'a>(message: *const c_char) -> std::borrow::Cow<'a, str> {
    if message.is_null() {
        return "(no message)".into();
    }
    // SAFETY: as the caller promises.
    unsafe { CStr::from_ptr(message) }.to_string_lossy()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mujoco::ffi;

    #[test]
    fn a_fault_returns_the_engines_message() {
        let result = call("mju_error", || compat::raise_fault(c"a wheel fell off"));
        match result {
            Err(Error::Engine { call, message }) => {
                assert_eq!(call, "mju_error");
                assert_eq!(message, "a wheel fell off");
            }
            other => panic!("expected a fault, got {other:?}"),
        }
    }

    #[test]
    fn warnings_are_kept_once_each() {
        let (first, second) = (c"one", c"two");
        let warn = |text: &CStr| call("mju_warning", || compat::raise_warning(text)).unwrap();
        [first, first, second].into_iter().for_each(warn);
        assert!(has_texts());
        assert_eq!(take_texts(), ["one", "two"]);
        assert!(!has_texts());
    }

    #[test]
    fn a_panic_of_ours_is_not_taken_for_a_fault() {
        let caught = catch_unwind(|| call("none", || resume_unwind(Box::new(7_u8))));
        assert_eq!(caught.unwrap_err().downcast_ref::<u8>(), Some(&7));
    }

    #[test]
    fn a_visit_leaves_the_threads_handlers_as_they_were() {
        std::thread::spawn(|| {
            let none = compat::install_handlers();
            compat::put_back_handlers(none);
            let fault = || call("mju_error", || compat::raise_fault(c"a wheel fell off"));
            // also where an earlier call has left ours to another binding's
            for was_installed in [false, true] {
                INSTALLED.set(was_installed);
                compat::put_back_handlers(none);
                assert!(matches!(visit(fault), Err(Error::Engine { .. })));
                assert_eq!(INSTALLED.get(), was_installed);
                assert_eq!(format!("{:?}", compat::install_handlers()), format!("{none:?}"));
            }
            compat::put_back_handlers(none);
            let caught = catch_unwind(|| visit(|| resume_unwind(Box::new(7_u8))));
            assert!(caught.is_err());
            assert_eq!(format!("{:?}", compat::install_handlers()), format!("{none:?}"));
        })
        .join()
        .unwrap();
    }

    /// The hot loop has about twenty guarded calls per step, of some microseconds each.
    #[test]
    fn the_guard_costs_nanoseconds() {
        const CALLS: u32 = 10_000;
        let batch = |_| {
            let start = std::time::Instant::now();
            for _ in 0..CALLS {
                // SAFETY: no arguments, returns a constant.
                std::hint::black_box(call("mj_version", || unsafe { ffi::mj_version() })).unwrap();
            }
            start.elapsed().as_nanos() as f64 / f64::from(CALLS)
        };
        let fastest = (0..50).map(batch).fold(f64::INFINITY, f64::min);
        println!("a guarded call of an empty function takes {fastest:.1} ns");
        assert!(fastest < 50.0, "{fastest} ns");
    }
}
