//! A simulation and its grasps in one saved state.

use super::controller::Grasp;
use super::error::Error;
use super::state::GraspState;
use crate::mujoco::{Simulation, State};
use serde::{Deserialize, Serialize};

/// Everything that the next steps depend on, apart from parameters of model and grasps: a replay from it is the same bit for
/// bit, in this process or another one on the same kind of machine, whatever the phases are.
///
/// ```
/// # use mujoco_grasp::grasp::{Grasp, Snapshot, step};
/// # use mujoco_grasp::mujoco::{Model, Simulation};
/// # let model = Model::from_xml_string("<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>")?;
/// # let mut sim = Simulation::new(&model)?;
/// # let mut grasps: [Grasp; 0] = [];
/// let snapshot = Snapshot::take(&sim, &grasps);
/// let text = serde_json::to_string(&snapshot)?; // serde_json with the feature "float_roundtrip"
/// step(&mut sim, &mut grasps)?;
///
/// let snapshot: Snapshot = serde_json::from_str(&text)?;
/// snapshot.restore(&mut sim, &mut grasps)?;
/// assert_eq!(sim.time(), 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Snapshot {
    /// The engine's part.
    pub sim: State,
    /// One for each grasp, in the order in which they are stepped.
    pub grasps: Vec<GraspState>,
}

impl Snapshot {
    /// The present state, between two steps.
    #[must_use]
    pub fn take(sim: &Simulation, grasps: &[Grasp]) -> Self {
        Snapshot { sim: sim.save(), grasps: grasps.iter().map(Grasp::save).collect() }
    }

    /// Brings a simulation of the same model and grasps of the same specs to this state.
    ///
    /// # Errors
    /// Another number of grasps; a state of another model or another spec; numbers that are not finite. Nothing is changed
    /// then.
    pub fn restore(&self, sim: &mut Simulation, grasps: &mut [Grasp]) -> Result<(), Error> {
        if grasps.len() != self.grasps.len() {
            let (saved, here) = (self.grasps.len().to_string(), grasps.len().to_string());
            return Err(Error::OtherState { what: "number of grasps", saved, here });
        }
        for (grasp, state) in grasps.iter().zip(&self.grasps) {
            grasp.check_state(state)?;
        }
        sim.restore(&self.sim)?;
        for (grasp, state) in grasps.iter_mut().zip(&self.grasps) {
            grasp.restore(state)?;
        }
        Ok(())
    }
}
