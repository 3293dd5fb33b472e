//! The binding: real MuJoCo behind safe calls.

#[path = "../common/random.rs"]
mod random;
mod robot;

#[cfg(mujoco3)]
mod arena;
mod clearance;
mod contact;
mod faults;
mod hostile_models;
mod jacobian;
mod loading;
mod memory;
mod pairs;
mod rows;
mod stages;
