//! Scenarios: files that say what a hand does to an object, and what became of it.
//!
//! ```text
//! source -> file -> plan -> runner -> trajectory -> outcome -> compare
//! (where)  (TOML)  (names) (steps)    (samples)    (one run)  (both modes)
//! ```
pub mod actuator;
pub mod agree;
pub mod agreement;
pub mod bench;
pub mod builtin;
pub mod calibrate;
pub mod checkpoint;
pub mod compare;
pub mod control;
pub mod draw;
pub mod error;
pub mod file;
mod length;
pub mod measure;
pub mod moment;
pub mod onset;
pub mod outcome;
mod pin;
pub mod plan;
pub mod press;
mod rows;
pub mod run;
pub mod runner;
pub mod source;
pub mod start;
pub mod stop;
#[cfg(feature = "sweep")]
pub mod sweep;
pub mod tally;
pub mod tracker;
pub mod trajectory;
mod watch;

pub use error::Error;
