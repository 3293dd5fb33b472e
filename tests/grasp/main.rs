//! The grasp layer on real simulations.

mod bits;
mod claw;
mod hands;
mod hold;
#[path = "../common/one_step.rs"]
mod one_step;
mod oracle;
mod table;

mod any_hand;
mod arrow_solve;
mod bumpless;
mod cone_laws;
mod controller;
mod fidelity;
mod frozen;
mod hands_generator;
mod islands;
mod long_runs;
mod merged;
mod neighbours;
mod replay;
mod saved_state;
mod sensors;
mod several;
mod softness;
mod weld_softness;
