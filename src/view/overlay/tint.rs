//! What a latched grasp has made one: the links that press, and the target, in the grasp's colour.

use super::colour;
use crate::grasp::{Grasp, Phase};
use crate::mujoco::{BodyId, Drawing, Tint};

/// Share of the colour.
const SHARE: f32 = 0.55;

/// Adds the bodies of a grasp, by its place among the grasps, if it is latched.
pub fn add(index: usize, grasp: &Grasp, drawing: &mut Drawing) {
    if grasp.phase() != Phase::Grasped {
        return;
    }
    let mut bodies: Vec<BodyId> =
        grasp.contacts().iter().filter(|c| c.normal_force() > 0.0).map(|c| c.link_id).collect();
    bodies.push(grasp.target());
    bodies.sort_unstable();
    bodies.dedup();
    let tint = |body| Tint { body, rgb: colour(index), share: SHARE, opacity: 1.0 };
    drawing.tints.extend(bodies.into_iter().map(tint));
}
