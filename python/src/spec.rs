//! What a caller says of a grasp: bodies by name, and the fields of the library's `GraspSpec` by theirs.

use crate::errors::{SpecError, UnknownNameError, of_engine};
use mujoco_grasp::grasp::{self, GraspSpec, Limits};
use mujoco_grasp::mujoco::{BodyId, CompiledModel};
use nalgebra::{Quaternion, UnitQuaternion};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

const FIELDS: [&str; 12] = [
    "effectors",
    "latch_quality",
    "release_quality",
    "latch_time",
    "release_time",
    "limits",
    "relaxed",
    "axes",
    "solref",
    "solimp",
    "relaxed_solref",
    "relaxed_solimp",
];

/// The names of the axes of `relaxed`, as in scenario files.
const AXES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// Reads a spec.
///
/// # Errors
/// Names that the model does not have, fields that there are not, values of other types or lengths.
pub fn read(
    model: &CompiledModel,
    target: &Bound<'_, PyAny>,
    palm: Option<&Bound<'_, PyAny>>,
    fields: Option<&Bound<'_, PyDict>>,
) -> PyResult<GraspSpec> {
    let palm = palm.map(|palm| body(model, "palm", palm)).transpose()?;
    let mut spec = GraspSpec::new(body(model, "target", target)?, palm);
    for (name, value) in fields.into_iter().flat_map(|fields| fields.iter()) {
        let name: String = name.extract()?;
        if !FIELDS.contains(&name.as_str()) {
            let known = FIELDS.join(", ");
            return Err(PyTypeError::new_err(format!("a grasp has no option {name:?}; it has {known}")));
        }
        if !value.is_none() {
            set(&mut spec, model, &name, &value)?;
        }
    }
    Ok(spec)
}

fn set(spec: &mut GraspSpec, model: &CompiledModel, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    match name {
        "effectors" => {
            if value.is_instance_of::<PyString>() {
                return Err(wrong(name, value, "it must be a sequence of names of bodies"));
            }
            let items = value.try_iter().map_err(|_| wrong(name, value, "it must be a sequence of names of bodies"))?;
            spec.effectors = items.map(|item| body(model, "effector", &item?)).collect::<PyResult<_>>()?;
        }
        "latch_quality" => spec.latch_quality = Some(number(name, value)?),
        "release_quality" => spec.release_quality = Some(number(name, value)?),
        "latch_time" => spec.latch_time = number(name, value)?,
        "release_time" => spec.release_time = number(name, value)?,
        "limits" => spec.limits = limits(value)?,
        "relaxed" => spec.relaxed = relaxed(value)?,
        "axes" => {
            let [w, x, y, z] = numbers(name, value)?;
            let quaternion = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9);
            let expected = "it must be a quaternion [w, x, y, z] other than 0";
            spec.axes = quaternion
                .filter(|q| q.coords.iter().all(|c| c.is_finite()))
                .ok_or_else(|| wrong(name, value, expected))?;
        }
        "solref" => spec.solref = Some(numbers(name, value)?),
        "solimp" => spec.solimp = Some(numbers(name, value)?),
        "relaxed_solref" => spec.relaxed_solref = Some(numbers(name, value)?),
        _ => spec.relaxed_solimp = Some(numbers(name, value)?),
    }
    Ok(())
}

fn wrong(name: &str, value: &Bound<'_, PyAny>, expected: &str) -> PyErr {
    let shown = value.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
    SpecError::new_err(format!("{name} is {shown}; {expected}"))
}

/// A body by its name, or by its number for one without a name.
fn body(model: &CompiledModel, role: &str, value: &Bound<'_, PyAny>) -> PyResult<BodyId> {
    if let Ok(name) = value.extract::<String>() {
        return model.body(&name).map_err(|error| {
            let text = format!("{role}: {error}");
            match error {
                mujoco_grasp::mujoco::Error::UnknownName { .. } => UnknownNameError::new_err(text),
                other => of_engine(other),
            }
        });
    }
    match value.extract::<usize>() {
        Ok(index) if index < model.nbody() => Ok(BodyId::from_index(index)),
        Ok(index) => {
            Err(UnknownNameError::new_err(format!("{role}: body {index} does not exist: there are {}", model.nbody())))
        }
        Err(_) => Err(wrong(role, value, "it must be the name of a body, or its number")),
    }
}

fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| wrong(name, value, "it must be a number"))
}

fn numbers<const N: usize>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    let given: Option<Vec<f64>> =
        value.try_iter().ok().and_then(|items| items.map(|item| item.ok()?.extract().ok()).collect());
    let given = given.and_then(|given| <[f64; N]>::try_from(given).ok());
    given.ok_or_else(|| wrong(name, value, &format!("it must be {N} numbers")))
}

/// "cones", "box" or "rigid".
///
/// # Errors
/// Anything else.
pub fn limits(value: &Bound<'_, PyAny>) -> PyResult<Limits> {
    let name: Option<String> = value.extract().ok();
    let all = [Limits::Cones, Limits::Box, Limits::Rigid];
    let found = all.into_iter().find(|limits| name.as_deref() == Some(limits.name()));
    found.ok_or_else(|| wrong("limits", value, "it must be \"cones\", \"box\" or \"rigid\""))
}

fn relaxed(value: &Bound<'_, PyAny>) -> PyResult<[bool; 6]> {
    let names: Option<Vec<String>> = value.extract().ok();
    let mut relaxed = [false; 6];
    for name in names.as_deref().unwrap_or(&["?".to_owned()]) {
        match AXES.iter().position(|axis| axis == name) {
            Some(axis) => relaxed[axis] = true,
            None => return Err(wrong("relaxed", value, "it must be a sequence of x, y, z, rx, ry, rz")),
        }
    }
    Ok(relaxed)
}

/// The elements that an MJCF needs, besides its own, for a grasp of the body `target` with the limits "box" or "rigid": a
/// weld, switched off. To be put at the end of the model's text, after all other equality constraints.
#[pyfunction]
#[pyo3(signature = (target, hand=None))]
pub fn weld_xml(target: &str, hand: Option<&str>) -> String {
    grasp::weld_xml(target, hand)
}
