//! Lower bounds of the distances between bodies that may collide.

// A distance that is not a number must count as too near: `!(a > b)` says that, `a <= b` does not.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::gjk::clearance;
use super::motion::Placement;
use super::pairs::{TestedPair, tested_pairs};
use super::parameters::ContactParameters;
use super::shape::{Pose, Shape};
use crate::mujoco::compat;
use crate::mujoco::ffi;
use crate::mujoco::ids::GeomId;
use crate::mujoco::simulation::Simulation;
use nalgebra::{Matrix3, Vector3};
use std::collections::{BTreeMap, HashSet};
use std::ops::Range;

/// The part that stands for all bodies that cannot move.
pub(super) const WORLD: usize = 0;

/// Clearances are understated by this much of the two geoms' sizes, and by the tolerance of the engine's own search: more
/// than its narrow phase can err.
const TOLERANCE: f64 = 1e-6;

/// A radius that no rotation leaves unnoticed, for planes on moving bodies.
const UNBOUNDED: f64 = 1e30;

/// All geom pairs that may collide, by body.
#[derive(Debug, Clone)]
pub(super) struct Proximity {
    pub parts: Vec<Part>,
    pub groups: Vec<Group>,
    pairs: Vec<Pair>,
    /// By geom; none for those of no pair.
    shapes: Vec<Option<Shape>>,
    /// By group.
    measured: Vec<Measured>,
    /// Distances beyond this are not looked at closely, m.
    pub reach: f64,
}

/// A body, or all that cannot move.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub body: usize,
    /// About the centre of mass, of the geoms that take part, m.
    pub radius: f64,
}

/// All pairs between two parts, of which the first has the larger radius.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub parts: [usize; 2],
    pairs: Range<usize>,
    /// The largest of its pairs', m.
    margin: f64,
}

/// A clearance, m, and the pose of the second part in the frame of the first when it was measured.
#[derive(Debug, Clone, Copy)]
struct Measured {
    clearance: f64,
    relative: Placement,
}

#[derive(Debug, Clone)]
struct Pair {
    geoms: [usize; 2],
    /// The engine finds no contact beyond this distance, m.
    margin: f64,
}

impl Proximity {
    /// All pairs that collision detection tests, without those of `known`.
    pub fn new(sim: &Simulation, known: &[TestedPair]) -> Self {
        let known: HashSet<&TestedPair> = known.iter().collect();
        let mut others = tested_pairs(sim);
        others.retain(|pair| !known.contains(pair));
        let mut shapes = vec![None; sim.model().ngeom()];
        for geom in others.iter().flat_map(|pair| pair.geoms) {
            if shapes[geom].is_none() {
                shapes[geom] = Shape::new(sim, geom);
            }
        }
        let (parts, part_of) = parts(sim, &shapes);
        let mut by_parts = BTreeMap::<[usize; 2], Vec<Pair>>::new();
        for pair in &others {
            let mut between = pair.bodies.map(|body| part_of[body]);
            between.sort_by(|a, b| parts[*b].radius.total_cmp(&parts[*a].radius));
            by_parts.entry(between).or_default().push(Pair::new(sim, pair, &shapes));
        }
        let mut radii: Vec<f64> = parts.iter().map(|part| part.radius).collect();
        radii.sort_by(f64::total_cmp);
        let mut proximity = Self {
            reach: radii[radii.len() / 2].min(UNBOUNDED),
            parts,
            groups: Vec::new(),
            pairs: Vec::new(),
            shapes,
            measured: Vec::new(),
        };
        for (parts, pairs) in by_parts {
            let first = proximity.pairs.len();
            let margin = pairs.iter().map(|pair| pair.margin).fold(0.0, f64::max);
            proximity.pairs.extend(pairs);
            proximity.groups.push(Group { parts, pairs: first..proximity.pairs.len(), margin });
            proximity.measured.push(Measured { clearance: f64::NEG_INFINITY, relative: Placement::default() });
        }
        proximity
    }

    /// How much closer the two parts of a group can come before one of its pairs has a contact, m: a lower bound, which
    /// is good to a tenth if it is less than `reach`, and not positive if a pair may have a contact now.
    pub fn look(&mut self, sim: &Simulation, group: usize) -> f64 {
        let Group { parts, margin, .. } = &self.groups[group];
        let [a, b] = parts.map(|part| &self.parts[part]);
        let centre = |part: &Part| vector(sim.xipos(), part.body);
        let spheres = (centre(a) - centre(b)).norm() - a.radius - b.radius - margin;
        if spheres >= self.reach {
            return spheres;
        }
        let relative = Placement::relative(sim, a.body, b.body);
        let before = &self.measured[group];
        let left = before.clearance - relative.moved(&before.relative, b.radius);
        if left > 0.5 * before.clearance && before.clearance > 0.0 {
            return left;
        }
        let clearance = self.clearance(sim, group);
        self.measured[group] = Measured { clearance, relative };
        clearance
    }

    /// The geoms of a group's pairs, those of either side.
    pub fn geoms(&self, group: usize) -> [Vec<GeomId>; 2] {
        let pairs = &self.pairs[self.groups[group].pairs.clone()];
        [0, 1].map(|side| {
            let mut geoms: Vec<usize> = pairs.iter().map(|pair| pair.geoms[side]).collect();
            geoms.sort_unstable();
            geoms.dedup();
            geoms.into_iter().map(GeomId::from_index).collect()
        })
    }

    /// The least of all pairs'.
    fn clearance(&self, sim: &Simulation, group: usize) -> f64 {
        let mut least = f64::INFINITY;
        for pair in &self.pairs[self.groups[group].pairs.clone()] {
            let clearance = self.pair_clearance(sim, pair);
            // Written so that a number that is none stays.
            if !(clearance >= least) {
                least = clearance;
            }
        }
        least
    }

    fn pair_clearance(&self, sim: &Simulation, pair: &Pair) -> f64 {
        let [Some(a), Some(b)] = pair.geoms.map(|geom| self.shapes[geom].as_ref()) else {
            // A geom that is not understood.
            return f64::NEG_INFINITY;
        };
        let [x, y] = pair.geoms.map(|geom| vector(sim.geom_xpos(), geom));
        let spheres = (x - y).norm() - a.extent - b.extent - pair.margin;
        if spheres >= self.reach {
            return spheres;
        }
        let pose = |position: Vector3<f64>, geom: usize| Pose {
            position,
            rotation: Matrix3::from_row_slice(&sim.geom_xmat()[9 * geom..9 * geom + 9]),
        };
        let [pose_a, pose_b] = [pose(x, pair.geoms[0]), pose(y, pair.geoms[1])];
        clearance((a, &pose_a), (b, &pose_b), pair.margin)
    }
}

impl Pair {
    /// The engine's contacts appear at the margin, except between boxes, which its separating axes tell apart only by a
    /// fraction of 1/sqrt(3) of their distance at least (corner to corner), and on height fields, which it raises by
    /// the margin and then inflates the other geom by half of it.
    fn new(sim: &Simulation, pair: &TestedPair, shapes: &[Option<Shape>]) -> Self {
        let kinds = pair.geoms.map(|geom| sim.model().geom_type()[geom] as u32);
        let factor = match kinds {
            [ffi::mjGEOM_BOX, ffi::mjGEOM_BOX] | [ffi::mjGEOM_HFIELD, _] => 2.0,
            _ => 1.0,
        };
        let margin = ContactParameters::new(sim.model(), pair).reach.max(0.0);
        let extents = pair.geoms.iter().flat_map(|&geom| &shapes[geom]);
        let size: f64 = extents.map(|shape| shape.extent).filter(|extent| extent.is_finite()).sum();
        // Planes need no search.
        let search = match kinds {
            [ffi::mjGEOM_PLANE, _] => 0.0,
            _ => compat::distance_tolerance(sim.model_fields()),
        };
        Self { geoms: pair.geoms, margin: factor * margin + TOLERANCE * size + search }
    }
}

/// The parts, and the part of each body. The first part is the world, with everything that cannot move.
fn parts(sim: &Simulation, shapes: &[Option<Shape>]) -> (Vec<Part>, Vec<usize>) {
    let model = sim.model();
    let mut parts = vec![Part { body: 0, radius: f64::INFINITY }];
    let mut part_of = vec![WORLD; model.nbody()];
    for (geom, shape) in shapes.iter().enumerate() {
        let (Some(shape), body) = (shape, model.geom_bodyid()[geom] as usize) else {
            continue;
        };
        if is_fixed(sim, body) {
            continue;
        }
        if part_of[body] == WORLD {
            part_of[body] = parts.len();
            parts.push(Part { body, radius: 0.0 });
        }
        let offset = vector(model.geom_pos(), geom) - vector(model.body_ipos(), body);
        let part = &mut parts[part_of[body]];
        part.radius = part.radius.max(offset.norm() + shape.extent).min(UNBOUNDED);
    }
    (parts, part_of)
}

/// Whether a body never moves: welded to the world, and not through a mocap body.
pub(super) fn is_fixed(sim: &Simulation, body: usize) -> bool {
    let model = sim.model();
    let root = model.body_rootid()[body] as usize;
    model.body_weldid()[body] == 0 && model.body_mocapid()[root] < 0
}

fn vector(array: &[f64], index: usize) -> Vector3<f64> {
    Vector3::from_column_slice(&array[3 * index..3 * index + 3])
}
