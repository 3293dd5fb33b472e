//! Everything that depends on MuJoCo's version: `v2` for 2.2.2, `v3` for 3.x, with the same items.
//!
//! Nothing else in the crate asks for the version. `build.rs` reads it from the headers; of a version that was not tested
//! it looks for the names that these files use, and lists those that are missing.

use super::ffi;
#[cfg(test)]
use std::ffi::CStr;

#[cfg(not(mujoco3))]
mod v2;
#[cfg(mujoco3)]
mod v3;

#[cfg(not(mujoco3))]
pub use v2::MassRows;
#[cfg(not(mujoco3))]
pub(super) use v2::*;
#[cfg(mujoco3)]
pub use v3::MassRows;
#[cfg(mujoco3)]
pub(super) use v3::*;

/// Numbers per equality constraint in `eq_data` (mjNEQDATA).
pub(super) const EQ_DATA: usize = ffi::mjNEQDATA as usize;

/// The version that the headers are of, e.g. "2.2.2".
pub(super) fn header_version() -> String {
    readable(ffi::mjVERSION_HEADER)
}

/// The version of the library loaded at run time, if it is not the one that the headers describe: structures differ between
/// versions.
pub(super) fn other_library() -> Option<String> {
    // SAFETY: no arguments, returns a constant.
    let library = u32::try_from(unsafe { ffi::mj_version() }).unwrap_or(0);
    (library != ffi::mjVERSION_HEADER).then(|| readable(library))
}

/// 222 is 2.2.2; from 3.5 on the number is written 3005000.
fn readable(version: u32) -> String {
    match version {
        0..1000 => format!("{}.{}.{}", version / 100, version / 10 % 10, version % 10),
        _ => format!("{}.{}.{}", version / 1_000_000, version / 1000 % 1000, version % 1000),
    }
}

/// Raises an engine fault, for tests.
#[cfg(test)]
pub(in crate::mujoco) fn raise_fault(text: &CStr) {
    // SAFETY: a constant string without conversions.
    unsafe { ffi::mju_error(text.as_ptr()) }
}

/// Raises an engine warning, for tests.
#[cfg(test)]
pub(in crate::mujoco) fn raise_warning(text: &CStr) {
    // SAFETY: a constant string without conversions.
    unsafe { ffi::mju_warning(text.as_ptr()) }
}
