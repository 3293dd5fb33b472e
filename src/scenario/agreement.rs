//! What `agree` reports: random pushes in both modes, counted.

use serde::Serialize;

use super::agree::{Ground, Onset, Trial};
use super::tally::Tally;
use crate::mujoco::mujoco_version;

/// The JSON object of `agree`.
#[derive(Debug, Serialize)]
pub struct Agreement<'a> {
    /// The scenario's name.
    pub scenario: &'a str,
    /// MuJoCo's version.
    pub engine: String,
    /// What the pushes were drawn with.
    pub seed: u64,
    /// Every push starts then.
    pub push_start_s: f64,
    /// Every run ends then.
    pub end_s: f64,
    /// The grasp is latched when the push starts.
    pub latched: bool,
    /// Noslip iterations of full mode.
    pub noslip_iterations: usize,
    /// The trials, counted.
    #[serde(flatten)]
    pub tally: Tally,
    /// Only when it was interrupted, or a table could not be written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl<'a> Agreement<'a> {
    /// Of the onsets and trials of one ground, drawn with `seed`.
    pub fn of(ground: &'a Ground, seed: u64, onsets: &[Onset], trials: &[Trial], error: Option<String>) -> Self {
        let (push_start_s, end_s) = ground.times();
        let noslip_iterations = ground.noslip();
        Agreement {
            scenario: ground.scenario(),
            engine: mujoco_version(),
            seed,
            push_start_s,
            end_s,
            latched: ground.is_latched(),
            noslip_iterations,
            tally: Tally::new(onsets, trials, noslip_iterations),
            error,
        }
    }
}
