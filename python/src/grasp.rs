//! The class `Grasp`: a handle of one of the `Grasps`.

use crate::contact::{Contact, body_name};
use crate::errors::{DivergedError, ModelError};
use crate::grasps::{Grasps, phase_name};
use crate::quality::QualityReport;
use crate::session::{Clock, Session};
use mujoco_grasp::grasp::metrics::quality;
use mujoco_grasp::grasp::{Grasp as Controller, Phase};
use mujoco_grasp::mujoco::BodyId;
use numpy::PyArray1;
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use std::hash::{DefaultHasher, Hash, Hasher};

/// One of the `Grasps`; all numbers are those of the last step.
#[pyclass(frozen, module = "mujoco_grasp")]
pub struct Grasp {
    grasps: Py<Grasps>,
    index: usize,
}

impl Grasp {
    pub fn new(grasps: Py<Grasps>, index: usize) -> Self {
        Self { grasps, index }
    }

    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Session, usize) -> Option<T> + Send) -> PyResult<T> {
        let index = self.index;
        let found = self.grasps.get().with(py, |session| work(session, index));
        found.ok_or_else(|| PyIndexError::new_err(format!("grasp {index} does not exist")))
    }

    fn read<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&Controller) -> T + Send) -> PyResult<T> {
        self.with(py, |session, index| session.grasp(index).map(work))
    }

    fn name<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&Controller, &dyn Fn(BodyId) -> String) -> T + Send,
    ) -> PyResult<T> {
        self.with(py, |session, index| {
            let model = session.borrowed.sim().model();
            session.grasp(index).map(|grasp| work(grasp, &|body| body_name(model, body)))
        })
    }

    fn clock(&self, py: Python<'_>) -> PyResult<Clock> {
        self.with(py, |session, index| session.clocks.get(index).copied())
    }
}

#[pymethods]
impl Grasp {
    /// Its place in the order in which grasps were added, from 0.
    #[getter]
    fn index(&self) -> usize {
        self.index
    }

    /// What it is one of.
    #[getter]
    fn grasps(&self, py: Python<'_>) -> Py<Grasps> {
        self.grasps.clone_ref(py)
    }

    /// Name of the body that is grasped.
    #[getter]
    fn target(&self, py: Python<'_>) -> PyResult<String> {
        self.name(py, |grasp, name| name(grasp.target()))
    }

    /// The target's body number.
    #[getter]
    fn target_id(&self, py: Python<'_>) -> PyResult<usize> {
        self.read(py, |grasp| grasp.target().index())
    }

    /// Name of the body at the base of the fingers.
    #[getter]
    fn palm(&self, py: Python<'_>) -> PyResult<String> {
        self.name(py, |grasp, name| name(grasp.palm()))
    }

    /// Links that may hold the target.
    #[getter]
    fn effectors(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.name(py, |grasp, name| grasp.links().iter().map(|&link| name(link)).collect())
    }

    /// What stands for its contacts: "cones", "box" or "rigid".
    #[getter]
    fn limits(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.read(py, |grasp| grasp.limits().name())
    }

    /// "ungrasped", or "grasped" while it is latched.
    #[getter]
    fn phase(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.read(py, |grasp| phase_name(grasp.phase()))
    }

    /// Whether it is latched.
    #[getter]
    fn is_grasped(&self, py: Python<'_>) -> PyResult<bool> {
        self.read(py, |grasp| grasp.phase() == Phase::Grasped)
    }

    /// Grasped, or the quality has been good for long enough.
    #[getter]
    fn would_latch(&self, py: Python<'_>) -> PyResult<bool> {
        self.read(py, Controller::would_latch)
    }

    /// Smallest singular value of the grasp matrix, scaled by the live normal forces, N.
    #[getter]
    fn quality(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, Controller::quality)
    }

    /// Quality at which it latches, N.
    #[getter]
    fn latch_quality(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, Controller::latch_quality)
    }

    /// What it must keep, once latched, not to be given up, N.
    #[getter]
    fn release_quality(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, Controller::release_quality)
    }

    /// Data time at the end of the step in which it last latched, s; None if it never has.
    #[getter]
    fn latched_at(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        Ok(self.clock(py)?.latched_at)
    }

    /// Simulated time of all steps so far that it began latched, s.
    #[getter]
    fn latched_time(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.clock(py)?.latched)
    }

    /// Of these, with its contacts merged into a weld (limits "box" and "rigid"), s.
    #[getter]
    fn merged_time(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.clock(py)?.merged)
    }

    /// Largest force (N) and torque (N m) in the next step for each axis, "box" while grasped.
    #[getter]
    fn bounds(&self, py: Python<'_>) -> PyResult<Option<(f64, f64)>> {
        self.read(py, |grasp| grasp.bounds().map(|bounds| (bounds.force, bounds.torque)))
    }

    /// Wrench of the weld on the target about its centre of mass, in the grasp's axes, `[force; torque]`, N and N m.
    #[getter]
    fn merged_wrench<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let wrench = self.read(py, Controller::merged_wrench)?;
        Ok(wrench.map(|wrench| PyArray1::from_slice(py, wrench.as_slice())))
    }

    /// Contacts between hand and target, with their live forces, latched or not.
    fn contacts(&self, py: Python<'_>) -> PyResult<Vec<Contact>> {
        self.with(py, |session, index| {
            let id = session.grasps.ids().nth(index)?;
            let Session { borrowed, grasps, .. } = session;
            let grasp = grasps.get_mut(id)?;
            grasp.read_slip(borrowed.sim());
            let model = borrowed.sim().model();
            Some(grasp.contacts().iter().map(|contact| Contact::of(model, contact)).collect())
        })
    }

    /// The field's quality measures of the effectors' contacts; costs milliseconds.
    ///
    /// Raises:
    ///     DivergedError: Contacts or forces that are not numbers.
    fn measures(&self, py: Python<'_>) -> PyResult<QualityReport> {
        let report = self.with(py, |session, index| {
            let grasp = session.grasp(index)?;
            Some(quality::of_grasp(session.borrowed.sim(), grasp))
        })?;
        report.map(Into::into).map_err(|e| DivergedError::new_err(e.to_string()))
    }

    /// Gives the contacts back to MuJoCo.
    fn release(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |session, index| session.grasp_mut(index).map(Controller::release))
    }

    /// Forbids or allows latching; a latched grasp stays so.
    fn allow_latch(&self, py: Python<'_>, allowed: bool) -> PyResult<()> {
        self.with(py, |session, index| session.grasp_mut(index).map(|grasp| grasp.allow_latch(allowed)))
    }

    /// Handles are the same that are of the same grasp.
    fn __eq__(&self, other: &Self) -> bool {
        self.grasps.is(&other.grasps) && self.index == other.index
    }

    fn __hash__(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        (self.grasps.as_ptr().addr(), self.index).hash(&mut hasher);
        hasher.finish()
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(ModelError::new_err(
            "a grasp is one of the Grasps of this process, so it is neither pickled nor copied: pickle or copy \
             grasps.save(), and restore() it in grasps that are made with the same options",
        ))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        self.name(py, |grasp, name| {
            let (target, palm, phase) = (name(grasp.target()), name(grasp.palm()), phase_name(grasp.phase()));
            format!("<Grasp of {target:?} by {palm:?}: {phase}, quality {:.4} N>", grasp.quality())
        })
    }
}
