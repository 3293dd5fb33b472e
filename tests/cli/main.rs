//! The program as a user calls it.

mod display;
mod page;
mod program;

mod agree;
mod bad_input;
mod calibrate;
mod documented;
mod isolated;
mod pointer;
mod reasons;
mod report;
#[cfg(feature = "rerun")]
mod rerun;
mod results;
mod run;
mod session;
mod sweep;
mod window;
