//! Grasps on MuJoCo at a fraction of the cost.
pub mod grasp;
pub mod kinematics;
pub mod mujoco;
pub mod report;
pub mod scenario;
