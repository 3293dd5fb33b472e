//! Finding the hand when the user names neither palm nor effectors.
//!
//! Decided from the model alone, so that it is known before the first step and never changes. What can be a hand is
//! *driven*: an actuator, a mocap body or a weld to something driven acts on its kinematic tree. A *palm* is a body with
//! two or more fingers that can touch the target, no finger of which is a hand itself: on a humanoid the hands, not the
//! trunk with its arms. Bodies without a joint are one rigid part with what they hang from. Only where there is no such
//! body, two or more driven trees are the fingers and the world is the palm: two arms, fingertips on mocap bodies.

use crate::grasp::error::Error;
use crate::grasp::hand::topology::lowest_common_ancestor;
use crate::mujoco::{BodyId, CompiledModel, TransmissionKind, WrapKind};

/// The only hand that could hold `target`: base of its fingers, and links. No links: every link below the palm; where the
/// palm is the world, they are the links of the driven trees.
///
/// # Errors
/// No hand, or several: then the message names their palms.
pub fn find_hand(model: &CompiledModel, target: BodyId) -> Result<(BodyId, Vec<BodyId>), Error> {
    let touching = touching(model, target);
    let driven = driven(model);
    let root = |body: usize| model.body_rootid()[body] as usize;
    let can_hold = |body: usize| root(body) != root(target.index()) && driven[root(body)];
    // children come after their parents
    let mut reaches = touching.clone();
    for body in (1..reaches.len()).rev() {
        reaches[model.body_parentid()[body] as usize] |= reaches[body];
    }
    let is_finger = |body: &usize| can_hold(*body) && reaches[*body] && moves_by_itself(model, *body);
    let mut fingers: Vec<Vec<usize>> = vec![Vec::new(); reaches.len()];
    for finger in (1..reaches.len()).filter(is_finger) {
        fingers[rigid_base(model, finger)].push(finger);
    }
    let mut has_hand = vec![false; reaches.len()];
    let mut palms = Vec::new();
    for body in (1..reaches.len()).rev() {
        if fingers[body].len() > 1 && !has_hand[body] {
            palms.push(BodyId::from_index(lowest_common_ancestor(model.body_parentid(), &fingers[body])));
            has_hand[body] = true;
        }
        has_hand[model.body_parentid()[body] as usize] |= has_hand[body];
    }
    palms.sort();
    let trees = (1..reaches.len()).filter(|&b| root(b) == b && can_hold(b) && reaches[b]).count();
    match palms[..] {
        [palm] => Ok((palm, Vec::new())),
        [] if trees > 1 => {
            let is_link = |b: &BodyId| can_hold(b.index()) && model.body_geomnum()[b.index()] > 0;
            Ok((BodyId::WORLD, model.bodies().filter(is_link).collect()))
        }
        [] => Err(Error::NoHand),
        _ => Err(Error::SeveralHands(palms.iter().map(|&palm| model.label(palm)).collect())),
    }
}

/// Whether a joint lies between the body and its parent, or it is moved as a mocap body.
fn moves_by_itself(model: &CompiledModel, body: usize) -> bool {
    model.body_jntnum()[body] > 0 || model.body_mocapid()[body] >= 0
}

/// The body that carries the rigid part on which `finger` stands: the next one above it that has a joint, or is the root
/// of its tree.
fn rigid_base(model: &CompiledModel, finger: usize) -> usize {
    let mut base = model.body_parentid()[finger] as usize;
    while base != 0 && !moves_by_itself(model, base) && model.body_parentid()[base] != 0 {
        base = model.body_parentid()[base] as usize;
    }
    base
}

/// Bodies with a geom that can touch one of the target.
fn touching(model: &CompiledModel, target: BodyId) -> Vec<bool> {
    let weld = model.body_weldid();
    let body_of = |geom: usize| model.geom_bodyid()[geom] as usize;
    let in_target = |geom: usize| weld[body_of(geom)] == weld[target.index()];
    let (types, affinities) = (model.geom_contype(), model.geom_conaffinity());
    let targets: Vec<usize> = (0..model.ngeom()).filter(|&g| in_target(g)).collect();
    let mut touching = vec![false; model.nbody()];
    for geom in (0..model.ngeom()).filter(|&g| !in_target(g)) {
        let meets = |&t: &usize| types[geom] & affinities[t] != 0 || types[t] & affinities[geom] != 0;
        touching[body_of(geom)] |= targets.iter().any(meets);
    }
    for (&a, &b) in model.pair_geom1().iter().zip(model.pair_geom2()) {
        let (a, b) = (a as usize, b as usize);
        touching[body_of(a)] |= in_target(b) && !in_target(a);
        touching[body_of(b)] |= in_target(a) && !in_target(b);
    }
    touching
}

/// Roots of the kinematic trees that something drives.
fn driven(model: &CompiledModel) -> Vec<bool> {
    let mut driven: Vec<bool> = model.body_mocapid().iter().map(|&mocap| mocap >= 0).collect();
    for body in actuated(model) {
        driven[model.body_rootid()[body] as usize] = true;
    }
    let welds: Vec<[usize; 2]> = model
        .equalities()
        .filter_map(|id| model.equality_bodies(id))
        .map(|bodies| bodies.map(|body| model.body_rootid()[body.index()] as usize))
        .filter(|roots| !roots.contains(&0))
        .collect();
    // a chain of welds passes it on
    for _ in 0..welds.len() {
        for &[a, b] in &welds {
            let either = driven[a] || driven[b];
            (driven[a], driven[b]) = (either, either);
        }
    }
    driven
}

/// Bodies that actuators act on.
fn actuated(model: &CompiledModel) -> Vec<usize> {
    let site = |site: i32| model.site_bodyid()[site as usize] as usize;
    let joint = |joint: i32| model.jnt_bodyid()[joint as usize] as usize;
    let tendon = |tendon: i32| {
        let (first, count) = (model.tendon_adr()[tendon as usize], model.tendon_num()[tendon as usize]);
        let path = first as usize..(first + count) as usize;
        path.filter_map(|wrap| match (WrapKind::from_raw(model.wrap_type()[wrap]), model.wrap_objid()[wrap]) {
            (WrapKind::Joint, id) => Some(joint(id)),
            (WrapKind::Site, id) => Some(site(id)),
            (WrapKind::Sphere | WrapKind::Cylinder, id) => Some(model.geom_bodyid()[id as usize] as usize),
            _ => None,
        })
    };
    let mut bodies = Vec::new();
    for (ids, &kind) in model.actuator_trnid().chunks_exact(2).zip(model.actuator_trntype()) {
        match TransmissionKind::from_raw(kind) {
            TransmissionKind::Joint | TransmissionKind::JointInParent => bodies.push(joint(ids[0])),
            TransmissionKind::SliderCrank | TransmissionKind::Site => bodies.push(site(ids[0])),
            TransmissionKind::Tendon => bodies.extend(tendon(ids[0])),
            TransmissionKind::Body => bodies.push(ids[0] as usize),
            TransmissionKind::Other(_) => {}
        }
    }
    bodies
}
