//! The generated bindings (see `build.rs`), plus what the installed headers leave out.
#![allow(non_upper_case_globals, non_camel_case_types, non_snake_case, dead_code, unused_imports, missing_docs)]
#![allow(unsafe_op_in_unsafe_fn, clippy::all)]

pub use super::compat::later::*;

include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
