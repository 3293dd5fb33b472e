//! Measurements at one instant of a scenario.

use nalgebra::{Vector3, Vector6};

use super::error::Error;
use super::plan::Plan;
use super::runner::{Mode, Runner};
use crate::grasp::metrics::quality::{self, QualityReport};
use crate::grasp::monitor::wrench::LoadedContact;
use crate::mujoco::BodyId;

/// Grasp quality of the first grasp at `measure_from`, from the full contact solve, without a push.
///
/// # Errors
/// A scenario that cannot be set up or run so far, and contacts whose forces are not numbers.
pub fn quality_at_measure(plan: &Plan) -> Result<QualityReport, Error> {
    let mut runner = Runner::new(plan, Mode::Full, None)?;
    let from = plan.timeline.measure_from();
    runner.advance_to(from)?;
    // The contacts and forces of a time are those of the step that starts there.
    runner.step()?;
    let grasp = runner.grasp();
    let contacts: Vec<LoadedContact> =
        grasp.contacts().iter().filter(|c| grasp.links().contains(&c.link_id)).map(|c| c.loaded()).collect();
    let (com, weight) = weight(&runner, grasp.target());
    quality::report(&contacts, &com, &weight).map_err(Error::Quality)
}

/// Centre of mass of a body and what hangs on it \[m\], and its gravity \[N; N m\], world axes.
fn weight(runner: &Runner, target: BodyId) -> (Vector3<f64>, Vector6<f64>) {
    let sim = runner.sim();
    let model = sim.model();
    let gravity = if model.has_gravity() { model.gravity() } else { Vector3::zeros() };
    let force = model.body_subtreemass()[target.index()] * gravity;
    (sim.subtree_com_of(target), Vector6::new(force.x, force.y, force.z, 0.0, 0.0, 0.0))
}
