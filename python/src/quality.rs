//! The class `QualityReport`.

use mujoco_grasp::grasp::metrics::quality::QualityReport as Report;
use pyo3::prelude::*;

/// Quality of a grasp in all measures.
#[pyclass(frozen, get_all, module = "mujoco_grasp")]
pub struct QualityReport {
    /// Smallest singular value of the grasp matrix, N.
    min_singular_value_n: f64,
    /// Ferrari and Canny's epsilon, N.
    ferrari_canny_n: f64,
    /// Volume of the wrench hull, N^6.
    hull_volume: f64,
    /// Smallest over largest singular value.
    isotropy: f64,
    /// Whether any wrench can be resisted if pressed hard enough.
    force_closure: bool,
    /// Whether the target's weight is held with no contact pressed harder than now.
    holds_own_weight: bool,
    /// Contacts that carry force.
    contacts: usize,
}

impl From<Report> for QualityReport {
    fn from(report: Report) -> Self {
        let Report {
            min_singular_value_n,
            ferrari_canny_n,
            hull_volume,
            isotropy,
            force_closure,
            holds_own_weight,
            contacts,
        } = report;
        Self { min_singular_value_n, ferrari_canny_n, hull_volume, isotropy, force_closure, holds_own_weight, contacts }
    }
}

#[pymethods]
impl QualityReport {
    fn __repr__(&self) -> String {
        format!(
            "QualityReport(min_singular_value_n={:?}, ferrari_canny_n={:?}, hull_volume={:?}, isotropy={:?}, \
             force_closure={}, holds_own_weight={}, contacts={})",
            self.min_singular_value_n,
            self.ferrari_canny_n,
            self.hull_volume,
            self.isotropy,
            python(self.force_closure),
            python(self.holds_own_weight),
            self.contacts
        )
    }
}

fn python(truth: bool) -> &'static str {
    if truth { "True" } else { "False" }
}
