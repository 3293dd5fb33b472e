//! Measurements at one instant of a scenario.

use super::error::Error;
use super::plan::Plan;
use super::runner::{Mode, Runner};
use crate::grasp::metrics::quality::{self, QualityReport};

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
    quality::of_grasp(runner.sim(), runner.grasp()).map_err(Error::Quality)
}
