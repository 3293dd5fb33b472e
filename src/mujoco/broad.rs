//! When a [`PairCollider`] and the engine's collision stage cannot differ.
//!
//! The engine's broad phase (engine_collision_driver.c of 2.2.2) puts boxes around bodies, along axes of its own choice and
//! in single precision, and tests static bodies with a plane or height field twice. A shallow contact may be lost in it,
//! one with such a body may be found twice, and what does not fit into the list is dropped.

use super::collider::PairCollider;
use super::contact::Contact;
use super::ffi;
use super::pairs::TestedPair;
use super::simulation::Simulation;
use nalgebra::Vector3;

/// More than what single precision takes from the overlap of two boxes, relative to the coordinates of their faces: 2^-24
/// for each of two faces, and some for the axes.
const PRECISION: f64 = 1.0 / (1 << 22) as f64;

impl PairCollider {
    /// Whether it is certain that the engine's collision stage would put exactly these contacts of this collider into its
    /// list: `found` at the present poses, and nothing else being near. Allocates nothing.
    pub fn is_certain(&self, sim: &Simulation, found: &[Contact]) -> bool {
        !self.twice
            && found.len() <= sim.model().nconmax()
            && found.chunk_by(|a, b| a.geoms == b.geoms).all(|of_one_pair| broad_phase_keeps(sim, &of_one_pair[0]))
    }
}

/// Whether the boxes around both bodies overlap along any axis, by more than rounding.
fn broad_phase_keeps(sim: &Simulation, contact: &Contact) -> bool {
    if contact.bodies.iter().any(|body| body.index() == 0) {
        return true;
    }
    let model = sim.model();
    let [a, b] = contact.geoms.map(|geom| geom.index());
    let position = |geom: usize| Vector3::from_column_slice(&sim.geom_xpos()[3 * geom..3 * geom + 3]);
    let half = |geom: usize| model.geom_rbound()[geom] + model.geom_margin()[geom];
    let (x, y) = (position(a), position(b));
    let size = half(a) + half(b);
    size - (x - y).norm() > PRECISION * (x.norm() + y.norm() + size)
}

/// Whether the engine may test a pair twice: one of its bodies is static, not the world, and has a plane or height field.
pub(super) fn any_twice(sim: &Simulation, pairs: &[TestedPair]) -> bool {
    let model = sim.model();
    let open = |geom: usize| matches!(model.geom_type()[geom] as u32, ffi::mjGEOM_PLANE | ffi::mjGEOM_HFIELD);
    let twice = |body: usize| {
        let geoms = 0..model.ngeom();
        body != 0
            && model.body_weldid()[body] == 0
            && geoms.filter(|&geom| model.geom_bodyid()[geom] as usize == body).any(open)
    };
    pairs.iter().flat_map(|pair| pair.bodies).any(twice)
}
