//! A contact between hand and target: where it is, how soft it is, what its friction cone allows.
pub(crate) mod contacts;
pub mod cost;
pub mod softness;
