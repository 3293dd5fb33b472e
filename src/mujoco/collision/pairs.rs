//! Which geom pairs collision detection tests, and in which order: mj_collision (engine_collision_driver.c) without its
//! broad phase.

use crate::mujoco::compat;
use crate::mujoco::ffi;
use crate::mujoco::simulation::Simulation;

/// Two geoms that collision detection tests against each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct TestedPair {
    /// In the engine's order: the smaller type number first.
    pub geoms: [usize; 2],
    /// Their bodies.
    pub bodies: [usize; 2],
    /// The `<pair>` element that it comes from, if any.
    pub predefined: Option<usize>,
}

/// All geom pairs that mj_collision tests if its broad phase lets everything through, in its order. Contacts being
/// switched off is not looked at: see [`detects`].
pub(super) fn tested_pairs(sim: &Simulation) -> Vec<TestedPair> {
    let predefined = (0..sim.model().npair()).filter_map(|pair| predefined_pair(sim, pair));
    match compat::collision_kinds(sim.model_fields()) {
        (true, false) => predefined.map(|(_, pair)| pair).collect(),
        (true, true) => merged(predefined.collect(), dynamic_pairs(sim)),
        (false, _) => dynamic_pairs(sim).map(|(_, pair)| pair).collect(),
    }
}

/// Whether the engine looks for contacts at all.
pub(super) fn detects(sim: &Simulation) -> bool {
    let model = sim.model();
    model.has_contacts() && compat::contact_capacity(sim.model_fields()) > 0 && model.nbody() > 1
}

/// A `<pair>` with its body pair signature; `None` if the engine has no collision function for it.
fn predefined_pair(sim: &Simulation, pair: usize) -> Option<(i32, TestedPair)> {
    let model = sim.model();
    let geoms = [model.pair_geom1()[pair], model.pair_geom2()[pair]].map(|geom| geom as usize);
    let tested = ordered(sim, geoms, Some(pair))?;
    Some((model.pair_signature()[pair], tested))
}

/// Pairs of geoms of all body pairs that are not excluded, as far as the engine's filters pass them.
fn dynamic_pairs(sim: &Simulation) -> impl Iterator<Item = (i32, TestedPair)> + '_ {
    let model = sim.model();
    let geoms_of = |body: usize| {
        let count = model.body_geomnum()[body].max(0) as usize;
        let first = model.body_geomadr()[body].max(0) as usize;
        first..first + count
    };
    let bodies = model.nbody();
    (0..bodies)
        .flat_map(move |body1| (body1 + 1..bodies).map(move |body2| (body1, body2)))
        .map(|(body1, body2)| (compat::signature(body1, body2), body1, body2))
        .filter(|(signature, ..)| !model.exclude_signature().contains(signature))
        .flat_map(move |(signature, body1, body2)| {
            let geoms = geoms_of(body1).flat_map(|geom1| geoms_of(body2).map(move |geom2| [geom1, geom2]));
            let tested = geoms.filter_map(|geoms| ordered(sim, geoms, None)).filter(|pair| passes_filter(sim, pair));
            let mut tested: Vec<TestedPair> = tested.collect();
            if compat::sorts_pairs(sim.model_fields(), [body1, body2]) {
                tested.sort_unstable_by_key(|pair| pair.geoms);
            }
            tested.into_iter().map(move |pair| (signature, pair))
        })
}

/// Predefined pairs come before the dynamic ones of their body pair and replace them, geom pair by geom pair.
fn merged(predefined: Vec<(i32, TestedPair)>, dynamic: impl Iterator<Item = (i32, TestedPair)>) -> Vec<TestedPair> {
    let mut all = Vec::new();
    let mut waiting = predefined.iter().peekable();
    for (signature, pair) in dynamic {
        while let Some((_, first)) = waiting.next_if(|(earlier, _)| *earlier <= signature) {
            all.push(*first);
        }
        let repeats = |(of, known): &(i32, TestedPair)| {
            let [geom1, geom2] = known.geoms;
            *of == signature && (pair.geoms == [geom1, geom2] || pair.geoms == [geom2, geom1])
        };
        if !predefined.iter().any(repeats) {
            all.push(pair);
        }
    }
    all.extend(waiting.map(|(_, pair)| *pair));
    all
}

/// The pair in the engine's order; `None` if the engine has no collision function for it.
fn ordered(sim: &Simulation, geoms: [usize; 2], predefined: Option<usize>) -> Option<TestedPair> {
    let kinds = sim.model().geom_type();
    let [geom1, geom2] = geoms;
    let geoms = if kinds[geom1] > kinds[geom2] { [geom2, geom1] } else { [geom1, geom2] };
    compat::narrow_phase(geoms.map(|geom| kinds[geom]))?;
    Some(TestedPair { geoms, bodies: geoms.map(|geom| sim.model().geom_bodyid()[geom] as usize), predefined })
}

/// mj_contactFilter: contype and conaffinity agree, and the bodies are neither welded together nor parent and child.
fn passes_filter(sim: &Simulation, pair: &TestedPair) -> bool {
    let model = sim.model();
    let [types1, types2] = pair.geoms.map(|geom| model.geom_contype()[geom]);
    let [affine1, affine2] = pair.geoms.map(|geom| model.geom_conaffinity()[geom]);
    let [weld1, weld2] = pair.bodies.map(|body| model.body_weldid()[body]);
    let parent = |weld: i32| model.body_weldid()[model.body_parentid()[weld as usize] as usize];
    let filters_parents = model.disable_flags() & ffi::mjDSBL_FILTERPARENT == 0 && weld1 != 0 && weld2 != 0;
    (types1 & affine2 != 0 || types2 & affine1 != 0)
        && weld1 != weld2
        && compat::may_meet(sim.model_fields(), [weld1, weld2])
        && !(filters_parents && (weld1 == parent(weld2) || weld2 == parent(weld1)))
}
