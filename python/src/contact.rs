//! The class `Contact`.

use mujoco_grasp::grasp::GraspContact;
use mujoco_grasp::mujoco::{BodyId, CompiledModel};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

/// A contact of a link and the target. World frame; the normal points into the target, forces are those on it.
#[pyclass(frozen, module = "mujoco_grasp")]
pub struct Contact {
    contact: GraspContact,
    link: String,
}

impl Contact {
    pub fn of(model: &CompiledModel, contact: &GraspContact) -> Self {
        Self { contact: contact.clone(), link: body_name(model, contact.link_id) }
    }
}

/// A body's name, or what it is called that has none.
pub fn body_name(model: &CompiledModel, body: BodyId) -> String {
    model.body_name(body).map_or_else(|| model.label(body), str::to_owned)
}

type Vector<'py> = Bound<'py, PyArray1<f64>>;

fn vector<'py>(py: Python<'py>, xyz: impl Into<[f64; 3]>) -> Vector<'py> {
    PyArray1::from_slice(py, &xyz.into())
}

#[pymethods]
impl Contact {
    /// Body of the hand.
    #[getter]
    fn link(&self) -> &str {
        &self.link
    }

    /// Its number.
    #[getter]
    fn link_id(&self) -> usize {
        self.contact.link
    }

    /// Both geoms, in MuJoCo's order.
    #[getter]
    fn geoms(&self) -> (usize, usize) {
        self.contact.geoms
    }

    /// Midpoint between the two surfaces, m, shape (3,).
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.contact.position)
    }

    /// Unit normal into the target, shape (3,).
    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.contact.axes[0])
    }

    /// Normal and two tangents as rows, shape (3, 3).
    #[getter]
    fn axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows: Vec<Vec<f64>> = self.contact.axes.iter().map(|axis| axis.iter().copied().collect()).collect();
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// On the target, N, shape (3,).
    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.contact.force)
    }

    /// On the target, besides that of `force` at `position`, N m, shape (3,).
    #[getter]
    fn torque<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.contact.torque)
    }

    /// Along and about `axes`: normal, two tangents (N), spin, two rolling (N m), shape (6,).
    #[getter]
    fn force_rows<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.contact.force_rows)
    }

    /// N, never negative.
    #[getter]
    fn normal_force(&self) -> f64 {
        self.contact.normal_force()
    }

    /// Tangential velocity of the target relative to the link, m/s, shape (3,).
    #[getter]
    fn slip_velocity<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.contact.slip_velocity)
    }

    /// While latched: whether friction is at its limit.
    #[getter]
    fn is_sliding(&self) -> bool {
        self.contact.is_sliding()
    }

    /// Distance of the surfaces, negative when they overlap, m.
    #[getter]
    fn dist(&self) -> f64 {
        self.contact.parameters.dist
    }

    /// Dimensions of its friction, as of a geom: 1, 3, 4 or 6.
    #[getter]
    fn condim(&self) -> usize {
        self.contact.parameters.condim
    }

    /// Two tangential coefficients, spin (m), two rolling (m), shape (5,).
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.contact.parameters.friction)
    }

    fn __repr__(&self) -> String {
        let [x, y, z]: [f64; 3] = self.contact.position.into();
        format!(
            "<Contact of {:?} at [{x:.4}, {y:.4}, {z:.4}] m, normal force {:.4} N>",
            self.link,
            self.contact.normal_force()
        )
    }
}
