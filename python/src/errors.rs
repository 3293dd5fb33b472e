//! The library's errors as Python's exceptions, with the same texts.

use mujoco_grasp::{grasp, mujoco, scenario};
use pyo3::PyErr;

mod py {
    use pyo3::import_exception;

    import_exception!(mujoco_grasp.errors, BadControlError);
    import_exception!(mujoco_grasp.errors, BufferFullError);
    import_exception!(mujoco_grasp.errors, BusyError);
    import_exception!(mujoco_grasp.errors, DivergedError);
    import_exception!(mujoco_grasp.errors, EngineError);
    import_exception!(mujoco_grasp.errors, EngineWarning);
    import_exception!(mujoco_grasp.errors, ModelError);
    import_exception!(mujoco_grasp.errors, ResetError);
    import_exception!(mujoco_grasp.errors, ScenarioError);
    import_exception!(mujoco_grasp.errors, SpecError);
    import_exception!(mujoco_grasp.errors, StateError);
    import_exception!(mujoco_grasp.errors, UnknownNameError);
    import_exception!(mujoco_grasp.errors, VersionError);
}

pub use py::{
    BusyError, DivergedError, EngineWarning, ModelError, ResetError, ScenarioError, SpecError, StateError,
    UnknownNameError,
};

/// Of the binding.
pub fn of_engine(error: mujoco::Error) -> PyErr {
    use mujoco::Error as E;
    let text = error.to_string();
    match error {
        E::Version { .. } => py::VersionError::new_err(text),
        E::UnknownName { .. } | E::OutOfRange { .. } => UnknownNameError::new_err(text),
        E::Diverged { .. } => DivergedError::new_err(text),
        E::BufferFull { .. } => py::BufferFullError::new_err(text),
        E::BadControl { .. } => py::BadControlError::new_err(text),
        E::Engine { .. } | E::Interrupted { .. } => py::EngineError::new_err(text),
        E::Length { .. } | E::Value { .. } => SpecError::new_err(text),
        _ => ModelError::new_err(text),
    }
}

/// Of grasps.
pub fn of_grasp(error: grasp::Error) -> PyErr {
    use grasp::Error as E;
    // What would be right is said in Python's words where Rust's are other ones.
    let text = match &error {
        E::NoWeld { limits, target } => format!(
            "limits {limits:?} need a weld between the hand and the target {target}, and the model has none: put \
             mujoco_grasp.weld_xml(target) at the end of the MJCF's text, before </mujoco> and after all other equality \
             constraints"
        ),
        E::WeldActive(_) => error.to_string().replace("grasp::", "mujoco_grasp."),
        E::Integrator => format!("{error}: set model.opt.integrator to mjINT_IMPLICITFAST or mjINT_EULER"),
        _ => error.to_string(),
    };
    match error {
        E::Engine(error) => of_engine(error),
        E::NoSuchBody { .. } => UnknownNameError::new_err(text),
        E::Diverged { .. } | E::BadAcceleration { .. } | E::BadContact { .. } => DivergedError::new_err(text),
        E::OtherState { .. } | E::BadState(_) => StateError::new_err(text),
        E::OtherModel { .. } | E::Integrator | E::WeldRows { .. } => ModelError::new_err(text),
        _ => SpecError::new_err(text),
    }
}

/// Of scenarios.
pub fn of_scenario(error: scenario::Error) -> PyErr {
    match error {
        scenario::Error::Step { source, .. } => of_grasp(source),
        // an option of the command line is an argument here
        scenario::Error::Option { option, value, expected } => {
            let argument = option.trim_start_matches('-').replace('-', "_");
            ScenarioError::new_err(format!("{argument} is {value}; {expected}"))
        }
        other => ScenarioError::new_err(other.to_string()),
    }
}
