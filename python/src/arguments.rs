//! Arguments that are read here, so that an error names them and says what would be right.

use crate::errors::SpecError;
use mujoco_grasp::grasp::FROZEN_TOLERANCE;
use mujoco_grasp::scenario::file::wrong_frozen_tolerance;
use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyOverflowError;
use pyo3::intern;
use pyo3::prelude::*;
use std::ops::RangeInclusive;

// what the signatures show
const _: () = assert!(FROZEN_TOLERANCE == 2e-3);

/// More only wait for each other.
const MAX_THREADS: usize = 1024;

fn whole(name: &str, value: &Bound<'_, PyAny>, range: RangeInclusive<usize>) -> PyResult<usize> {
    let given = value.extract::<usize>();
    match given {
        Ok(number) if range.contains(&number) => Ok(number),
        Err(error) if !error.is_instance_of::<PyOverflowError>(value.py()) => Err(error),
        _ => {
            let (least, most) = range.into_inner();
            Err(SpecError::new_err(format!("{name} is {value}; it must be a whole number from {least} to {most}")))
        }
    }
}

/// Steps.
pub fn n(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    whole("n", value, 0..=i64::MAX as usize)
}

/// Simulations.
pub fn nsim(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    whole("nsim", value, 1..=i32::MAX as usize)
}

/// As many as it says, or as there are cores.
pub fn threads(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    if value.is_none() { Ok(None) } else { whole("threads", value, 1..=MAX_THREADS).map(Some) }
}

/// A tolerance \[rad\].
pub fn frozen_tolerance(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let angle = value.extract().unwrap_or(f64::NAN);
    match wrong_frozen_tolerance(angle) {
        None => Ok(angle),
        Some(expected) => {
            let shown = value.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
            Err(SpecError::new_err(format!("frozen_tolerance is {shown}; {expected}")))
        }
    }
}

/// The numbers of an array of this shape, row by row, or of what numpy makes one of.
pub fn numbers(name: &str, value: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<Vec<f64>> {
    let py = value.py();
    let wrong =
        |what: String| SpecError::new_err(format!("{name} {what}; real numbers of the shape {shape:?} are needed"));
    let array = match value.cast::<PyArrayDyn<f64>>() {
        Ok(array) => array.clone(),
        Err(_) => {
            let numpy = py.import(intern!(py, "numpy"))?;
            let given =
                numpy.call_method1("asarray", (value,)).map_err(|error| wrong(format!("is no array: {error}")))?;
            let kind: String = given.getattr("dtype")?.getattr("kind")?.extract()?;
            // numbers, and objects that may be some
            if !"biufO".contains(&kind) {
                return Err(wrong(format!("is an array of {}", given.getattr("dtype")?)));
            }
            let made = given.call_method1("astype", ("float64",));
            made.map_err(|error| wrong(format!("is no array of numbers: {error}")))?.cast_into()?
        }
    };
    match array.shape() == shape {
        true => Ok(array.readonly().as_array().iter().copied().collect()),
        false => Err(wrong(format!("has the shape {:?}", array.shape()))),
    }
}
