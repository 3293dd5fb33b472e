//! Scenarios, the models that they use, and the pictures made of them.

#[path = "../common/random.rs"]
mod random;

mod builtin;
mod carry;
mod file;
mod handover;
mod kinematics;
mod models;
mod outcome;
mod policy;
mod regression;
mod render;
mod report_plots;
mod report_strip;
mod runner;
mod schedule;
