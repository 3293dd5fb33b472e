//! Grasps, goals and pushes of a scenario file, every name looked up on its model.

use std::path::Path;

use nalgebra::Vector3;

use super::{Goal, Push};
use crate::grasp::{DEFAULT_LATCH_TIME, DEFAULT_RELEASE_TIME, GraspSpec, Limits, find_hand};
use crate::mujoco::{BodyId, CompiledModel, SiteId};
use crate::scenario::error::{Error, Field};
use crate::scenario::file::{GoalEntry, GraspEntry, PushEntry};

fn label(model: &CompiledModel, body: usize) -> String {
    match model.body_name(BodyId::from_index(body)) {
        Some(name) => format!("\"{name}\""),
        None => format!("body {body}"),
    }
}

/// Whether `ancestor` is `body` or above it.
fn is_above(model: &CompiledModel, ancestor: usize, mut body: usize) -> bool {
    while body > ancestor {
        body = model.body_parentid()[body] as usize;
    }
    body == ancestor
}

pub(super) fn grasp(model: &CompiledModel, path: &Path, index: usize, entry: &GraspEntry) -> Result<GraspSpec, Error> {
    let at = |field: &str| Field::new(path, &format!("grasp[{index}].{field}"));
    let body = |field: &str, name: &str| model.body(name).map_err(|e| at(field).unknown(e));
    let target = body("target", &entry.target)?;
    if target == BodyId::WORLD {
        return Err(at("target").wrong("is the world; give a body that can move"));
    }
    if !moves(model, target.index()) {
        return Err(at("target").wrong(format!(
            "\"{}\" cannot move: no joint lies between it and the world; give it a <freejoint/>",
            entry.target
        )));
    }
    let mut effectors = Vec::new();
    for (i, name) in entry.effectors.iter().enumerate() {
        let field = format!("effectors[{i}]");
        let effector = body(&field, name)?;
        if effector == BodyId::WORLD {
            return Err(at(&field).wrong("\"world\" is the world; effectors are links of the hand"));
        }
        if is_above(model, target.index(), effector.index()) {
            return Err(
                at(&field).wrong(format!("\"{name}\" is a part of the target; effectors are links of the hand"))
            );
        }
        effectors.push(effector);
    }
    let palm = match &entry.palm {
        Some(name) => body("palm", name)?,
        None if effectors.is_empty() => {
            let palm;
            (palm, effectors) = find_hand(model, target).map_err(|e| at("palm").wrong(format!("is missing: {e}")))?;
            palm
        }
        None => common_ancestor(model, &effectors),
    };
    for (i, effector) in effectors.iter().enumerate() {
        if !is_above(model, palm.index(), effector.index()) {
            return Err(at("palm").wrong(format!(
                "{} is not above the effector \"{}\" in the kinematic tree; give a common ancestor of the effectors, as {}",
                label(model, palm.index()),
                entry.effectors[i], // only named ones can be elsewhere
                label(model, common_ancestor(model, &effectors).index()),
            )));
        }
    }
    if palm != BodyId::WORLD && is_above(model, palm.index(), target.index()) {
        return Err(at("palm").wrong(format!(
            "{} carries the target \"{}\"; the target must not be a part of the hand",
            label(model, palm.index()),
            entry.target
        )));
    }
    if is_above(model, target.index(), palm.index()) {
        return Err(at("palm").wrong(format!("{} is a part of the target", label(model, palm.index()))));
    }
    Ok(GraspSpec {
        effectors,
        latch_quality: entry.latch_quality,
        release_quality: entry.release_quality,
        latch_time: entry.latch_time.unwrap_or(DEFAULT_LATCH_TIME),
        release_time: entry.release_time.unwrap_or(DEFAULT_RELEASE_TIME),
        limits: entry.limits.unwrap_or(Limits::Cones),
        relaxed: entry.relaxed(),
        axes: entry.axes(),
        solref: entry.solref,
        solimp: entry.solimp,
        relaxed_solref: entry.relaxed_solref,
        relaxed_solimp: entry.relaxed_solimp,
        ..GraspSpec::new(target, palm)
    })
}

/// Lowest body above all effectors that is none of them.
fn common_ancestor(model: &CompiledModel, effectors: &[BodyId]) -> BodyId {
    let mut ancestor = effectors.first().map_or(0, |e| e.index());
    while ancestor != 0 && !effectors.iter().all(|e| ancestor != e.index() && is_above(model, ancestor, e.index())) {
        ancestor = model.body_parentid()[ancestor] as usize;
    }
    BodyId::from_index(ancestor)
}

/// Whether any joint lies between the body and the world.
fn moves(model: &CompiledModel, mut body: usize) -> bool {
    while body != 0 {
        if model.body_dofnum()[body] > 0 {
            return true;
        }
        body = model.body_parentid()[body] as usize;
    }
    false
}

pub(super) fn goal(
    model: &CompiledModel,
    path: &Path,
    index: usize,
    entry: &GoalEntry,
    grasps: &[GraspSpec],
    ready: f64,
) -> Result<Goal, Error> {
    let at = |field: &str| Field::new(path, &format!("goal[{index}].{field}"));
    let tip = model.site(&entry.effector_site).map_err(|e| at("effector_site").unknown(e))?;
    let goal = model.site(&entry.target_site).map_err(|e| at("target_site").unknown(e))?;
    let body_of = |site: SiteId| model.site_bodyid()[site.index()] as usize;
    let on_target = |g: &GraspSpec| is_above(model, g.target.index(), body_of(goal));
    let on_hand = |g: &GraspSpec| {
        let palm = g.palm.unwrap_or(BodyId::WORLD).index();
        palm != body_of(tip) && is_above(model, palm, body_of(tip))
    };
    if !grasps.iter().any(on_target) {
        return Err(at("target_site").wrong(format!(
            "\"{}\" is on {}, which is no target of a grasp",
            entry.target_site,
            label(model, body_of(goal))
        )));
    }
    match grasps.iter().position(|g| on_target(g) && on_hand(g)) {
        Some(grasp) => Ok(Goal { grasp, tip, goal, start: entry.start.unwrap_or(ready) }),
        None => Err(at("effector_site").wrong(format!(
            "\"{}\" is on {}, which is not below the palm of the grasp; give a site on a finger",
            entry.effector_site,
            label(model, body_of(tip))
        ))),
    }
}

pub(super) fn push(
    model: &CompiledModel,
    path: &Path,
    index: usize,
    entry: &PushEntry,
    grasps: &[GraspSpec],
) -> Result<Push, Error> {
    let at = |field: &str| Field::new(path, &format!("push[{index}].{field}"));
    let grasp = match &entry.target {
        None => 0,
        Some(name) => {
            let body = model.body(name).map_err(|e| at("target").unknown(e))?;
            grasps.iter().position(|g| g.target == body).ok_or_else(|| {
                let known: Vec<String> = grasps.iter().map(|g| label(model, g.target.index())).collect();
                at("target").wrong(format!("\"{name}\" is no target of a grasp; give one of: {}", known.join(", ")))
            })?
        }
    };
    let body = grasps[grasp].target;
    Ok(Push {
        name: entry.name.clone(),
        grasp,
        body,
        start: entry.start,
        end: entry.end(),
        force: Vector3::from(entry.force),
        torque: Vector3::from(entry.torque),
    })
}
