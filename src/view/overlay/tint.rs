//! Bodies in other colours: what a latched grasp has made one (the links that press, and the target) in the grasp's colour,
//! and a target that one can see the forces in.

use super::{Shown, colour};
use crate::grasp::{Grasp, Phase};
use crate::mujoco::{BodyId, Drawing, Tint};

/// Share of the grasp's colour.
const SHARE: f32 = 0.55;
/// Of a target with forces in it.
const OPACITY: f32 = 0.45;

/// Adds the bodies of a grasp, by its place among the grasps.
pub fn add(index: usize, grasp: &Grasp, shown: Shown, drawing: &mut Drawing) {
    let mut bodies: Vec<BodyId> = Vec::new();
    let share = if shown.tint && grasp.phase() == Phase::Grasped {
        bodies.extend(grasp.contacts().iter().filter(|c| c.normal_force() > 0.0).map(|c| c.link_id));
        bodies.sort_unstable();
        bodies.dedup();
        SHARE
    } else {
        0.0
    };
    let tint = |body, opacity| Tint { body, rgb: colour(index), share, opacity };
    drawing.tints.extend(bodies.into_iter().map(|body| tint(body, 1.0)));
    let within = !grasp.contacts().is_empty() && (shown.contacts || shown.forces);
    drawing.tints.push(tint(grasp.target(), if within { OPACITY } else { 1.0 }));
}
