//! Steps in which collision detection would find nothing, known from how little has moved since distances were measured.

// A distance that is not a number must count as too near: `!(a > b)` says that, `a <= b` does not.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::distances::{Proximity, is_fixed};
use super::narrow_phase::PairCollider;
use super::pairs::{TestedPair, detects};
use super::travel::{Ledger, NotANumber};
use crate::mujoco::error::Error;
use crate::mujoco::ids::GeomId;
use crate::mujoco::simulation::Simulation;

/// Calls for which the answer stays "no" after something was found near.
const BACK_OFF: u32 = 20;

/// Certifies that no contact exists but those of a [`PairCollider`], so that [`Simulation::collision`] can be left out.
///
/// Every pair of bodies has a slack: a lower bound of the distance that is left between their geoms, from separating
/// planes. It shrinks by no more than both bodies move. A pair is looked at again when its slack is used up: first for
/// the motion of one body seen from the other, then for the distance. Pairs with much slack are not even counted one by
/// one until the two fastest bodies could have used up the least of theirs. Motions inside the hand (all below the last
/// common ancestor of the collider's bodies, and what it holds) are counted in the hand's own frame, so that a hand
/// which is carried around costs little more than one that rests.
///
/// "Yes" is certain (the engine's own tolerances are allowed for); "no" means that something may touch, or was near
/// less than 20 calls ago.
#[derive(Debug, Clone)]
pub struct Clearance {
    proximity: Proximity,
    ledger: Ledger,
    /// The group that did not pass in the last call that looked.
    blocked: Option<usize>,
    /// Calls to answer with "no".
    rest: u32,
    /// Of the model.
    origin: u64,
}

/// The geoms of two bodies.
pub type GeomSets = [Vec<GeomId>; 2];

impl Clearance {
    /// For all geom pairs that collision detection tests, but those of `collider`.
    ///
    /// Fails for a collider of another model.
    pub fn new(sim: &Simulation, collider: &PairCollider) -> Result<Self, Error> {
        collider.check_model(sim)?;
        let proximity = Proximity::new(sim, &collider.pairs);
        let hand = hand(sim, &collider.pairs).filter(|&hand| !is_fixed(sim, hand));
        let held = |body: usize| {
            let known = || collider.pairs.iter().any(|pair| pair.bodies.contains(&body));
            hand.is_some_and(|hand| is_below(sim, body, hand)) || known()
        };
        let hand = hand.map(|hand| (hand, (0..sim.model().nbody()).map(held).collect()));
        let origin = sim.model().origin();
        Ok(Self { ledger: Ledger::new(&proximity, hand), proximity, blocked: None, rest: 0, origin })
    }

    /// Whether [`Simulation::collision`] would find no contact but the collider's, at the present poses (see
    /// [`Simulation::kinematics`]), in any state. Allocates nothing.
    ///
    /// Fails for a simulation of another model.
    pub fn certifies(&mut self, sim: &Simulation) -> Result<bool, Error> {
        sim.model().check_origin(self.origin, "a clearance")?;
        if !detects(sim) {
            return Ok(true);
        }
        if self.rest > 0 {
            self.rest -= 1;
            return Ok(false);
        }
        // What blocked is the likeliest to do so again.
        let again = |group: &usize| !(self.proximity.look(sim, *group) > 0.0);
        self.blocked = match self.blocked.filter(again) {
            Some(group) => Some(group),
            None => match self.ledger.first_blocked(sim, &mut self.proximity) {
                Ok(blocked) => blocked,
                Err(NotANumber) => return Ok(false),
            },
        };
        if self.blocked.is_some() {
            self.rest = BACK_OFF;
        }
        Ok(self.blocked.is_none())
    }

    /// From the next call on distances are measured again once less than `slack` may be left of them \[m\], so that
    /// [`outlasts`](Self::outlasts) says "no" only where it must.
    pub fn want(&mut self, slack: f64) {
        self.ledger.want(slack);
    }

    /// After a "yes": whether it would be "yes" after any point of any body has come by `way` at the most, and two bodies
    /// (their indices) nearer to each other by `approach` of them at the most \[m\]. The latter is only asked of bodies for
    /// which twice `way` is too much.
    pub fn outlasts(&self, way: f64, approach: impl Fn([usize; 2]) -> f64) -> bool {
        self.ledger.outlasts(way, |parts| approach(parts.map(|part| self.proximity.parts[part].body)))
    }

    /// The geoms of the two bodies that may touch, if that is why the last call said "no": a collider that covers them too
    /// lets the next say "yes".
    pub fn near(&self) -> Option<GeomSets> {
        self.blocked.map(|group| self.proximity.geoms(group))
    }
}

/// The body that carries the hand: the last common ancestor of the bodies of one kinematic tree, the one with the most
/// bodies that the collider looks at.
fn hand(sim: &Simulation, pairs: &[TestedPair]) -> Option<usize> {
    let model = sim.model();
    let mut bodies: Vec<usize> = pairs.iter().flat_map(|pair| pair.bodies).collect();
    bodies.sort_unstable();
    bodies.dedup();
    let root = |body: usize| model.body_rootid()[body];
    let count = |of: i32| bodies.iter().filter(|&&body| root(body) == of).count();
    let largest = bodies.iter().map(|&body| root(body)).max_by_key(|&of| count(of))?;
    let members = bodies.iter().copied().filter(|&body| root(body) == largest);
    members.reduce(|mut a, mut b| {
        // Parents come before their children.
        while a != b {
            let deeper = if a > b { &mut a } else { &mut b };
            *deeper = model.body_parentid()[*deeper] as usize;
        }
        a
    })
}

fn is_below(sim: &Simulation, mut body: usize, ancestor: usize) -> bool {
    while body > ancestor {
        body = sim.model().body_parentid()[body] as usize;
    }
    body == ancestor
}

impl Simulation {
    /// The collision stage for a step without contacts: the previous contacts and constraint rows are dropped. To be
    /// called in the place of [`collision`](Self::collision) when a [`Clearance`] certifies that it would find nothing,
    /// or nothing but the contacts that a [`PairCollider`] finds.
    pub fn skip_collision(&mut self) {
        self.forget_contacts();
    }
}
