//! A simulation and its grasps in one saved state.

use super::error::Error;
use super::grasps::Grasps;
use super::state::GraspsState;
use crate::mujoco::{Simulation, State};
use serde::{Deserialize, Serialize};

/// Everything that the next steps depend on, apart from parameters of model and grasps: a replay from it is the same bit for
/// bit, in this process or another one on the same kind of machine, whatever the phases are.
///
/// ```
/// # use mujoco_grasp::grasp::{Grasps, Snapshot};
/// # use mujoco_grasp::mujoco::{Model, Simulation};
/// # let model = Model::from_xml_string("<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>")?;
/// # let mut sim = Simulation::new(&model)?;
/// # let mut grasps = Grasps::new();
/// let snapshot = Snapshot::take(&sim, &grasps);
/// let text = serde_json::to_string(&snapshot)?; // serde_json with the feature "float_roundtrip"
/// grasps.step(&mut sim)?;
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
    /// That of the grasps.
    pub grasps: GraspsState,
}

impl Snapshot {
    /// The present state, between two steps.
    #[must_use]
    pub fn take(sim: &Simulation, grasps: &Grasps) -> Self {
        Snapshot { sim: sim.save(), grasps: grasps.save() }
    }

    /// Brings a simulation of the same model and grasps of the same specs to this state.
    ///
    /// # Errors
    /// Another number of grasps; a state of another model or another spec; numbers that are not finite. Nothing is changed
    /// then.
    pub fn restore(&self, sim: &mut Simulation, grasps: &mut Grasps) -> Result<(), Error> {
        grasps.check_state(&self.grasps)?;
        sim.restore(&self.sim)?;
        grasps.restore(&self.grasps)
    }
}
