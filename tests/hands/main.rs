//! Hands that nobody here made, out of PyPI wheels.

#[path = "../common/one_step.rs"]
mod one_step;
mod wheel;

mod fetched;
mod other_hands;
mod shadow;
