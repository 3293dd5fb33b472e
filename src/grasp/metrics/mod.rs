//! Grasp quality as the field measures it: for reports, not for every step.
pub mod closure;
mod conic;
mod error;
pub mod hull;
pub mod quality;
mod quickhull;
