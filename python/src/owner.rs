//! The caller's `MjModel` and `MjData`, and where their memory is.

use crate::errors::{ModelError, of_engine};
use mujoco_grasp::mujoco::Borrowed;
use pyo3::intern;
use pyo3::prelude::*;
use std::ffi::c_void;
use std::ptr::NonNull;

/// References that keep both alive, and their addresses.
pub struct Owner {
    pub model: Py<PyAny>,
    pub data: Py<PyAny>,
    model_address: usize,
    data_address: usize,
}

impl Owner {
    /// Checks what was given, and borrows it.
    ///
    /// # Errors
    /// What is not a model and its data of the package `mujoco`, or what the library does not serve.
    pub fn borrow(model: &Bound<'_, PyAny>, data: &Bound<'_, PyAny>) -> PyResult<(Self, Borrowed)> {
        let mujoco = model.py().import("mujoco")?;
        for (object, class) in [(model, "MjModel"), (data, "MjData")] {
            if !object.is_instance(&mujoco.getattr(class)?)? {
                let given = object.get_type().fully_qualified_name()?.to_string();
                return Err(ModelError::new_err(format!(
                    "a mujoco.{class} is needed, and this is a {given}: give model and data of the package mujoco"
                )));
            }
        }
        if !data.getattr("model")?.is(model) {
            return Err(ModelError::new_err(
                "the data is that of another MjModel: give the model that it was made from (data.model); a copy of a model \
                 has data of its own",
            ));
        }
        let owner = Self {
            model_address: address(model)?,
            data_address: address(data)?,
            model: model.clone().unbind(),
            data: data.clone().unbind(),
        };
        let pointer = |address: usize| NonNull::new(address as *mut c_void);
        let (Some(model), Some(data)) = (pointer(owner.model_address), pointer(owner.data_address)) else {
            return Err(ModelError::new_err("the model or its data has no memory"));
        };
        // SAFETY: both are what they say, by their types; the data was made from the model; the package has chosen this core
        // by the version of their library, which is the one in the process, and the library checks it again. They live as
        // long as the references in `Owner`, which the borrower keeps. That nobody else uses them during a step is what
        // the package asks of its users, as `mj_step` does.
        #[allow(unsafe_code)]
        let borrowed = unsafe { Borrowed::new(model, data) }.map_err(of_engine)?;
        Ok((owner, borrowed))
    }

    /// That both are where they were.
    ///
    /// # Errors
    /// If they are not.
    pub fn check(&self, py: Python<'_>) -> PyResult<()> {
        if address(self.model.bind(py))? == self.model_address && address(self.data.bind(py))? == self.data_address {
            return Ok(());
        }
        Err(ModelError::new_err("the memory of the model or its data has moved: make grasps anew"))
    }

    /// Of the data: tells it from all others of the process.
    pub fn data_address(&self) -> usize {
        self.data_address
    }
}

fn address(object: &Bound<'_, PyAny>) -> PyResult<usize> {
    object.getattr(intern!(object.py(), "_address"))?.extract()
}
