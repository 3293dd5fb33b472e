//! Grasps: their contacts, their quality, and what they can hold.
pub mod closure;
pub mod hull;
pub mod quality;
pub mod wrench;
