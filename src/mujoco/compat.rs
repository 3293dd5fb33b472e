//! Everything that depends on MuJoCo's version, for 2.2.2.
//!
//! A second version means a second file like this one with the same items; nothing else in the crate asks for the
//! version. `build.rs` refuses headers that no such file knows.

use super::error::Error;
use super::ffi;
use std::ffi::c_char;

/// What the engine calls with a message; it may unwind through the engine.
pub(super) type Handler = unsafe extern "C-unwind" fn(*const c_char);

unsafe extern "C-unwind" {
    /// Exported by the library, but not declared in the headers of 2.2.2.
    pub(super) fn mj_implicit(m: *const ffi::mjModel, d: *mut ffi::mjData);

    // The calling thread's handlers; they take precedence over the process-wide `mju_user_error`.
    fn _mjPRIVATE__set_tls_error_fn(handler: Option<Handler>);
    fn _mjPRIVATE__set_tls_warning_fn(handler: Option<Handler>);
}

/// Makes the engine call these on the current thread instead of printing, logging and exiting.
pub(super) fn install_handlers(on_error: Handler, on_warning: Handler) {
    // SAFETY: both calls only store the pointer in a thread-local of the engine.
    unsafe {
        _mjPRIVATE__set_tls_error_fn(Some(on_error));
        _mjPRIVATE__set_tls_warning_fn(Some(on_warning));
    }
}

/// Numbers per equality constraint in `eq_data` (mjNEQDATA).
pub(super) const EQ_DATA: usize = ffi::mjNEQDATA as usize;

/// The version that the headers are of, e.g. "2.2.2".
pub(super) fn header_version() -> String {
    readable(ffi::mjVERSION_HEADER)
}

/// Checks that the library loaded at run time is the one that the headers describe: structures differ between versions.
pub(super) fn check_version() -> Result<(), Error> {
    // SAFETY: no arguments, returns a constant.
    let library = unsafe { ffi::mj_version() };
    if u32::try_from(library) == Ok(ffi::mjVERSION_HEADER) {
        return Ok(());
    }
    Err(Error::Version { header: header_version(), library: readable(u32::try_from(library).unwrap_or(0)) })
}

fn readable(version: u32) -> String {
    format!("{}.{}.{}", version / 100, version / 10 % 10, version % 10)
}

/// Where the switch of each equality constraint is: in the model (2.2.2).
pub(super) fn eq_active(m: *mut ffi::mjModel, _d: *mut ffi::mjData) -> *mut u8 {
    // SAFETY: the caller's model is alive for as long as the simulation that owns it.
    unsafe { (*m).eq_active }
}

/// The engine's names for "inertia matrix to dense" differ between versions.
///
/// # Safety
/// `m` and `d` belong together; `dst` has room for `nv * nv` numbers.
pub(super) unsafe fn full_mass_matrix(m: *const ffi::mjModel, d: *const ffi::mjData, dst: *mut f64) {
    // SAFETY: as the caller promises.
    unsafe { ffi::mj_fullM(m, dst, (*d).qM) }
}
