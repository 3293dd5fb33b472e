//! Grasp quality against known cases.

mod support;

mod closed_forms;
mod closure;
mod hull;
mod invariance;
mod report;
