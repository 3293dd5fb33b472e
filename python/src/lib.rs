//! The compiled core of the Python package `mujoco_grasp`, for one version of MuJoCo.
//!
//! It links against the soname of the official wheel's library, which is in the process before it: grasps work in place on
//! the wheel's own `MjModel` and `MjData`. The package chooses the core by `mujoco.mj_version()` and documents what is here.
#![deny(unsafe_code)]

mod arguments;
mod batch;
mod contact;
mod errors;
mod grasp;
mod grasps;
mod owner;
mod parts;
mod pool;
mod quality;
mod scenario;
mod session;
mod spec;
mod state;
mod turn;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::batch::Batch;
    #[pymodule_export]
    use crate::contact::Contact;
    #[pymodule_export]
    use crate::grasp::Grasp;
    #[pymodule_export]
    use crate::grasps::Grasps;
    #[pymodule_export]
    use crate::quality::QualityReport;
    #[pymodule_export]
    use crate::scenario::{agree_json, bench_json, run_json, scenarios_json, sweep_json};
    #[pymodule_export]
    use crate::spec::weld_xml;
    #[pymodule_export]
    use crate::state::State;

    use super::*;

    /// The version of MuJoCo that this core is for, e.g. "3.17.0".
    #[pyfunction]
    fn mujoco_version() -> String {
        mujoco_grasp::mujoco::mujoco_version()
    }
}
