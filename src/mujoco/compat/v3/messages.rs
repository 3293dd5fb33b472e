//! The engine's messages: handlers, and what they say.

use crate::mujoco::ffi;
use crate::mujoco::guard;
use crate::mujoco::warnings::WarningKind;
#[cfg(not(mj_log_handler))]
use std::ffi::c_char;

/// The calling thread's handlers, with which the Python binding works; they take precedence over the process-wide ones.
#[cfg(mj_log_handler)]
mod engine {
    use super::*;

    type Handler = unsafe extern "C-unwind" fn(*const ffi::mjLogMessage);

    unsafe extern "C-unwind" {
        fn _mjPRIVATE_setTlsLogHandler(handler: Option<Handler>) -> Option<Handler>;
    }

    /// The handlers of a thread.
    pub type Handlers = Option<Handler>;

    pub fn install() -> Handlers {
        // SAFETY: only stores the pointer in a thread-local of the engine.
        unsafe { _mjPRIVATE_setTlsLogHandler(Some(on_message)) }
    }

    pub fn put_back(handlers: Handlers) {
        // SAFETY: as above.
        unsafe { _mjPRIVATE_setTlsLogHandler(handlers) };
    }

    unsafe extern "C-unwind" fn on_message(message: *const ffi::mjLogMessage) {
        // SAFETY: the engine passes a valid message, whose subject is NUL-terminated, that lives until we leave.
        let (level, text) = unsafe { ((*message).level, guard::text_of((&raw const (*message).subject).cast())) };
        match u32::try_from(level) {
            Ok(ffi::mjLOG_ERROR) => guard::raise(text.into_owned()),
            Ok(ffi::mjLOG_WARNING) => guard::note(&text),
            // Timing and the like, which has to be asked for.
            _ => {}
        }
    }
}

/// As above, one for errors and one for warnings.
#[cfg(not(mj_log_handler))]
mod engine {
    use super::*;

    type Handler = unsafe extern "C-unwind" fn(*const c_char);

    unsafe extern "C-unwind" {
        fn _mjPRIVATE__get_tls_error_fn() -> Option<Handler>;
        fn _mjPRIVATE__get_tls_warning_fn() -> Option<Handler>;
        fn _mjPRIVATE__set_tls_error_fn(handler: Option<Handler>);
        fn _mjPRIVATE__set_tls_warning_fn(handler: Option<Handler>);
    }

    /// The handlers of a thread: for errors, for warnings.
    pub type Handlers = [Option<Handler>; 2];

    pub fn install() -> Handlers {
        // SAFETY: the calls only read and store pointers in thread-locals of the engine.
        unsafe {
            let before = [_mjPRIVATE__get_tls_error_fn(), _mjPRIVATE__get_tls_warning_fn()];
            put_back([Some(on_error), Some(on_warning)]);
            before
        }
    }

    pub fn put_back([error, warning]: Handlers) {
        // SAFETY: as above.
        unsafe {
            _mjPRIVATE__set_tls_error_fn(error);
            _mjPRIVATE__set_tls_warning_fn(warning);
        }
    }

    unsafe extern "C-unwind" fn on_error(message: *const c_char) {
        // SAFETY: the engine passes a NUL-terminated string that lives until we leave.
        guard::raise(unsafe { guard::text_of(message) }.into_owned());
    }

    unsafe extern "C-unwind" fn on_warning(message: *const c_char) {
        // SAFETY: as above.
        guard::note(&unsafe { guard::text_of(message) });
    }
}

/// What a thread does with the engine's messages.
pub(in crate::mujoco) use engine::Handlers;

/// Makes the engine hand its messages to the guard on the current thread, instead of printing, logging and exiting; returns
/// what it did with them before.
pub(in crate::mujoco) fn install_handlers() -> Handlers {
    engine::install()
}

/// Gives the current thread the handlers that [`install_handlers`] has returned.
pub(in crate::mujoco) fn put_back_handlers(handlers: Handlers) {
    engine::put_back(handlers);
}

/// The attribute of `<size>` to raise, if the message of a fault means that the engine's stack is full.
pub(in crate::mujoco) fn full_stack(message: &str) -> Option<&'static str> {
    message.contains("stack overflow").then_some("memory")
}

/// The counted warnings, in the order of mjtWarning.
pub(in crate::mujoco) const COUNTED: [WarningKind; ffi::mjNWARNING as usize] = [
    WarningKind::Inertia,
    WarningKind::ContactsFull,
    WarningKind::ConstraintsFull,
    #[cfg(mj_warn_vgeomfull)]
    WarningKind::DrawnShapesFull,
    WarningKind::BadPosition,
    WarningKind::BadVelocity,
    WarningKind::BadAcceleration,
    WarningKind::BadControl,
];

/// What to raise in `<size>` when the contact list or the constraint rows are full.
pub(in crate::mujoco) const SIZE_OF_CONTACTS: &str = "memory";
pub(in crate::mujoco) const SIZE_OF_CONSTRAINTS: &str = "memory";
