//! Grasps on MuJoCo at a fraction of the cost.
#![deny(unsafe_code)]

pub mod grasp;
pub mod kinematics;
#[allow(unsafe_code)]
pub mod mujoco;
pub mod report;
pub mod scenario;
