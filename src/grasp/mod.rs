//! Grasps: their contacts, their quality, and what they can hold.
pub mod closure;
mod conic;
pub mod gram;
pub mod hull;
pub mod quality;
mod quickhull;
pub mod wrench;
