//! Scenarios: files that say what a hand does to an object, and what became of it.
//!
//! ```text
//! source -> file -> plan -> runner -> trajectory -> outcome -> compare
//! (where)  (TOML)  (names) (steps)    (samples)    (one run)  (both modes)
//! ```
pub mod builtin;
pub mod compare;
pub mod control;
pub mod error;
pub mod file;
pub mod measure;
pub mod outcome;
pub mod plan;
pub mod run;
pub mod runner;
pub mod source;
pub mod tracker;
pub mod trajectory;

pub use error::Error;
