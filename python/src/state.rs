//! The class `State`.

use crate::errors::StateError;
use crate::session::Clock;
use mujoco_grasp::grasp::GraspsState;
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};

/// What grasps remember; it can be compared, copied, pickled, and written as JSON.
#[pyclass(frozen, eq, module = "mujoco_grasp")]
#[derive(Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    pub grasps: GraspsState,
    pub clocks: Vec<Clock>,
}

#[pymethods]
impl State {
    /// Raises `StateError` for a text that is no state.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        let state: Self = serde_json::from_str(text)
            .map_err(|e| StateError::new_err(format!("the text is no saved state of grasps: {e}")))?;
        if state.clocks.len() == state.grasps.grasps().len() {
            return Ok(state);
        }
        Err(StateError::new_err("the saved state is damaged: it has a time for each of another number of grasps"))
    }

    /// The state as text, for `from_json`.
    fn to_json(&self) -> PyResult<String> {
        serde_json::to_string(self).map_err(|e| StateError::new_err(e.to_string()))
    }

    fn __len__(&self) -> usize {
        self.grasps.grasps().len()
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (String,))> {
        let from_json = slf.get_type().getattr("from_json")?.unbind();
        Ok((from_json, (slf.get().to_json()?,)))
    }

    fn __repr__(&self) -> String {
        format!("<mujoco_grasp.State of {} grasps>", self.__len__())
    }
}
