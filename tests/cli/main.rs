//! The program as a user calls it.

mod page;
mod program;

mod agree;
mod bad_input;
mod calibrate;
mod documented;
mod isolated;
mod report;
#[cfg(feature = "rerun")]
mod rerun;
mod results;
mod run;
mod sweep;
