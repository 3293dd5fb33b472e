//! Finding the contacts of a latched grasp.
//!
//! The engine's collision stage looks at every pair of bodies. While a grasp is latched, the contacts between hand and
//! target are found directly by the engine's own narrow phase, and its whole collision stage is left out of a step for
//! which nothing else can touch anything.
//!
//! When that is depends on how long ago distances were measured, so it is no part of a saved grasp. It may not be seen in
//! the result either: where the engine's stage could find other contacts of the grasp than the narrow phase alone (its
//! broad phase is rough), the stage is not left out.

use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::mujoco::{Clearance, Contact, GeomId, PairCollider, Simulation};

/// Collision detection for one grasp.
#[derive(Debug, Clone)]
pub(in crate::grasp) struct Detector {
    /// Not in all versions of the engine.
    direct: Option<(PairCollider, Clearance)>,
    found: Vec<Contact>,
}

impl Detector {
    /// For all geoms of hand and target.
    pub(in crate::grasp) fn new(sim: &Simulation, topology: &Topology) -> Result<Self, Error> {
        if !PairCollider::supported() {
            return Ok(Detector { direct: None, found: Vec::new() });
        }
        let geoms = |belongs: &dyn Fn(usize) -> bool| -> Vec<GeomId> {
            let bodies = sim.model().geom_bodyid();
            (0..bodies.len()).filter(|&g| belongs(bodies[g] as usize)).map(GeomId::from_index).collect()
        };
        let hand = geoms(&|body| topology.in_hand(body));
        let target = geoms(&|body| topology.in_target(body));
        let collider = PairCollider::new(sim, &hand, &target)?;
        let clearance = Clearance::new(sim, &collider);
        Ok(Detector { direct: Some((collider, clearance)), found: Vec::new() })
    }

    /// Takes the place of the engine's collision stage if nothing but hand and target can touch; false, with nothing
    /// done, if something else might, or if the stage might find other contacts.
    pub(in crate::grasp) fn replaces_collision(&mut self, sim: &mut Simulation) -> Result<bool, Error> {
        let Some((collider, clearance)) = &mut self.direct else {
            return Ok(false);
        };
        if !clearance.certifies(sim)? {
            return Ok(false);
        }
        collider.collide(sim, &mut self.found)?;
        let alike = collider.is_certain(sim, &self.found);
        if alike {
            sim.skip_collision();
        }
        Ok(alike)
    }

    /// The contacts between hand and target, in the engine's order.
    pub(in crate::grasp) fn found(&self) -> &[Contact] {
        &self.found
    }
}
