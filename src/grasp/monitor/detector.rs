//! Finding the contacts of the latched grasps.
//!
//! The engine's collision stage looks at every pair of bodies. While grasps are latched, the contacts between their hands
//! and targets are found directly by the engine's own narrow phase, with those of whatever else has come near, and its whole
//! collision stage is left out of a step for which nothing else can touch anything.
//!
//! When that is depends on how long ago distances were measured, so it is no part of a saved grasp. It may not be seen in
//! the result either: where the engine's stage could find other contacts of the grasps than the narrow phase alone (its
//! broad phase is rough), the stage is not left out.

use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::mujoco::{self, Clearance, Contact, GeomId, GeomSets, PairCollider, Simulation};

/// Where the engine's stage might find other contacts, as where two geoms do no more than touch, the next steps are left to it
/// at once: one, then twice as many each time, up to this number.
const MAX_PAUSE: usize = 16;

/// Pairs of bodies, besides hands and their targets, whose contacts are found directly.
const MAX_NEAR: usize = 32;

/// Collision detection for the grasps that are latched together.
#[derive(Debug, Clone, Default)]
pub(in crate::grasp) struct Detector {
    /// Model and latched grasps (by their numbers) that `direct` was made for.
    origin: u64,
    latched: Vec<usize>,
    /// Geoms of hands and their targets, then of bodies that have come near each other.
    sets: Vec<GeomSets>,
    /// Number of the latter; none are added once their contacts are not found directly, or once they are too many.
    near: usize,
    /// Not in all versions of the engine, nor for all kinds of contacts.
    direct: Option<(PairCollider, Clearance)>,
    found: Vec<Contact>,
    /// The length of the last pause from trying to do without the engine's stage, and what is left of it.
    pause: usize,
    left: usize,
    /// In the last call nothing could touch but what is looked at.
    certified: bool,
}

impl Detector {
    /// For all geoms of hands and targets.
    fn new<'a>(sim: &Simulation, grasps: impl Iterator<Item = (usize, &'a Topology)>) -> Result<Self, Error> {
        let (latched, grasps): (Vec<_>, Vec<_>) = grasps.unzip();
        let bodies = sim.model().geom_bodyid();
        let geoms = |belongs: &dyn Fn(usize) -> bool| -> Vec<GeomId> {
            (0..bodies.len()).filter(|&g| belongs(bodies[g] as usize)).map(GeomId::from_index).collect()
        };
        let sets: Vec<_> =
            grasps.iter().map(|of| [geoms(&|body| of.in_hand(body)), geoms(&|body| of.in_target(body))]).collect();
        let direct = Self::direct(sim, &sets)?;
        Ok(Detector {
            origin: sim.model().origin(),
            latched,
            sets,
            near: 0,
            direct,
            found: Vec::new(),
            pause: 0,
            left: 0,
            certified: false,
        })
    }

    fn direct(sim: &Simulation, sets: &[GeomSets]) -> Result<Option<(PairCollider, Clearance)>, Error> {
        let sets: Vec<_> = sets.iter().map(|[a, b]| [a.as_slice(), b.as_slice()]).collect();
        match PairCollider::of_sets(sim, &sets) {
            Ok(collider) => {
                let clearance = Clearance::new(sim, &collider)?;
                Ok(Some((collider, clearance)))
            }
            Err(mujoco::Error::Unsupported(_)) => Ok(None),
            Err(other) => Err(other.into()),
        }
    }

    /// For [`outlasts`](Self::outlasts), see [`Clearance::want`].
    pub(in crate::grasp) fn want(&mut self, slack: f64) {
        if let Some((_, clearance)) = &mut self.direct {
            clearance.want(slack);
        }
    }

    /// Takes the place of the engine's collision stage if nothing can touch but the hands and targets of `grasps`, each
    /// with its own, and what was near before; false, with nothing done, if something else might, or if the stage might find
    /// other contacts.
    pub(in crate::grasp) fn replaces_collision<'a>(
        &mut self,
        sim: &mut Simulation,
        grasps: impl Iterator<Item = (usize, &'a Topology)> + Clone,
    ) -> Result<bool, Error> {
        let latched = grasps.clone().map(|(id, _)| id);
        if self.origin != sim.model().origin() || !latched.eq(self.latched.iter().copied()) {
            *self = Self::new(sim, grasps.clone())?;
        }
        self.certified = false;
        let Some((collider, clearance)) = &mut self.direct else {
            return Ok(false);
        };
        if !clearance.certifies(sim)? {
            if let Some(near) = clearance.near().filter(|_| self.near < MAX_NEAR) {
                self.watch(sim, near)?;
            }
            return Ok(false);
        }
        self.certified = true;
        if self.left > 0 {
            self.left -= 1;
            return Ok(false);
        }
        collider.collide(sim, &mut self.found)?;
        let alike = collider.is_certain(sim, &self.found);
        self.pause = if alike { 0 } else { (2 * self.pause).clamp(1, MAX_PAUSE) };
        self.left = self.pause;
        if alike {
            sim.skip_collision();
            for contact in &self.found {
                if grasps.clone().any(|(_, grasp)| grasp.joins(contact.bodies)) {
                    sim.append_contact(contact)?;
                } else {
                    sim.append_engine_contact(contact)?;
                }
            }
        }
        Ok(alike)
    }

    /// Whether nothing that was not looked at in the last step can touch after what [`Clearance::outlasts`] is asked.
    pub(in crate::grasp) fn outlasts(&self, way: f64, approach: impl Fn([usize; 2]) -> f64) -> bool {
        let direct = self.direct.as_ref().filter(|_| self.certified);
        direct.is_some_and(|(_, clearance)| clearance.outlasts(way, approach))
    }

    /// Finds the contacts of two more bodies directly from the next step on, if that can be.
    fn watch(&mut self, sim: &Simulation, near: GeomSets) -> Result<(), Error> {
        self.sets.push(near);
        match Self::direct(sim, &self.sets)? {
            Some(direct) => {
                self.direct = Some(direct);
                self.near += 1;
            }
            None => {
                self.sets.pop();
                self.near = MAX_NEAR;
            }
        }
        Ok(())
    }

    /// The contacts that were found directly, in the engine's order.
    pub(in crate::grasp) fn found(&self) -> &[Contact] {
        &self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasp::hand::topology::Tree;
    use crate::mujoco::Model;

    /// Two fingers that touch a ball each, and a third ball elsewhere.
    fn scene() -> (Simulation, [Topology; 2]) {
        let hand = |name: &str, x: f64| {
            format!(
                r#"<body name="palm_{name}" pos="{x} 0 0"><joint type="slide"/><geom size=".02"/>
                <body name="tip_{name}" pos=".1 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".02 .03"/></body></body>
                <body name="ball_{name}" pos="{} 0 0"><freejoint/><geom size=".03"/></body>"#,
                x + 0.149
            )
        };
        let xml = format!(
            r#"<mujoco><worldbody>{}{}<body name="other" pos="0 3 0"><freejoint/><geom size=".03"/></body></worldbody></mujoco>"#,
            hand("a", 0.0),
            hand("b", 2.0)
        );
        let sim = Simulation::new(&Model::from_xml_string(&xml).unwrap()).unwrap();
        let model = sim.model();
        let tree = Tree {
            body_parent: model.body_parentid(),
            body_dofadr: model.body_dofadr(),
            body_dofnum: model.body_dofnum(),
            dof_parent: model.dof_parentid(),
            dof_body: model.dof_bodyid(),
        };
        let body = |part: &str, of: &str| model.body(&format!("{part}_{of}")).unwrap().index();
        let topologies =
            ["a", "b"].map(|of| Topology::new(&tree, body("palm", of), &[body("tip", of)], body("ball", of)));
        (sim, topologies)
    }

    /// Whether the stage is replaced within the calls for which the answer may stay "no"; if so, by what it finds.
    fn replaced(detector: &mut Detector, sim: &mut Simulation, grasps: &[Topology]) -> bool {
        sim.kinematics().unwrap();
        let replaced = (0..30).any(|_| detector.replaces_collision(sim, grasps.iter().enumerate()).unwrap());
        if replaced {
            let of_grasps = |contact: &Contact| grasps.iter().any(|grasp| grasp.joins(contact.bodies));
            let appended: Vec<Contact> = sim.contacts().collect();
            assert!(appended.iter().all(|contact| contact.excluded == of_grasps(contact)), "{appended:?}");
            let found: Vec<Contact> =
                appended.into_iter().map(|contact| Contact { excluded: false, ..contact }).collect();
            sim.collision().unwrap();
            assert_eq!(found, sim.contacts().collect::<Vec<_>>());
            assert_eq!(found, detector.found());
        }
        replaced
    }

    #[test]
    fn several_grasps_replace_the_stage_and_whatever_else_touches_is_found_with_them() {
        let (mut sim, both) = scene();
        let mut detector = Detector::default();
        let supported = PairCollider::supported();
        let count = |contacts: usize| if supported { contacts } else { 0 };
        assert_eq!(replaced(&mut detector, &mut sim, &both), supported);
        assert_eq!(detector.found().len(), count(2));
        // The contact of a hand that has not latched is the engine's to solve.
        assert_eq!(replaced(&mut detector, &mut sim, &both[..1]), supported);
        assert_eq!((detector.found().len(), detector.near), (count(2), count(1)));
        assert_eq!(replaced(&mut detector, &mut sim, &both), supported);
        // A body that is put somewhere else is noticed at once: the first step is the engine's.
        let other = sim.model().nq() - 7;
        sim.qpos_mut()[other..other + 3].copy_from_slice(&[2.149, 0.059, 0.0]);
        sim.kinematics().unwrap();
        assert!(!detector.replaces_collision(&mut sim, both.iter().enumerate()).unwrap());
        assert_eq!(replaced(&mut detector, &mut sim, &both), supported);
        assert_eq!((detector.found().len(), detector.near), (count(3), count(1)));
        sim.qpos_mut()[other + 1] = 1.0;
        assert_eq!(replaced(&mut detector, &mut sim, &both), supported);
        assert_eq!(detector.found().len(), count(2));
        // One hand in the other's way.
        let ball = sim.model().nq() - 14;
        sim.qpos_mut()[ball..ball + 3].copy_from_slice(&[0.1, 0.049, 0.0]);
        assert_eq!(replaced(&mut detector, &mut sim, &both), supported);
        assert_eq!(detector.near, count(2));
    }
}
