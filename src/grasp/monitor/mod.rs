//! What a grasp watches in every step: contacts, their forces, live quality, phase.
pub(crate) mod detector;
pub mod gram;
pub mod phase;
pub mod wrench;
