//! Geoms as convex shapes: support functions, in double precision, of what the engine collides.

use crate::mujoco::arrays::slice;
use crate::mujoco::ffi;
use crate::mujoco::simulation::Simulation;
use nalgebra::{Matrix3, Vector3};

/// Position and rotation (shape axes to world axes) of a shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub position: Vector3<f64>,
    pub rotation: Matrix3<f64>,
}

/// A geom: a core, and all points within `rounding` of it. Height fields are taken for the box that holds them.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    core: Core,
    /// m.
    pub rounding: f64,
    /// No point is farther than this from the geom's centre, m; infinite for planes.
    pub extent: f64,
}

#[derive(Debug, Clone)]
enum Core {
    Point,
    /// Half its length, along z.
    Segment(f64),
    Ellipsoid(Vector3<f64>),
    /// Radius, and half its length along z.
    Cylinder(f64, f64),
    /// Centre and half sizes.
    Box(Vector3<f64>, Vector3<f64>),
    Hull(Vec<Vector3<f64>>),
    /// All points with z <= 0.
    HalfSpace,
}

impl Shape {
    /// A geom's shape; `None` for a type that the engine does not collide.
    pub fn new(sim: &Simulation, geom: usize) -> Option<Self> {
        let model = sim.model();
        let size = Vector3::from_column_slice(&model.geom_size()[3 * geom..3 * geom + 3]);
        let (core, rounding) = match model.geom_type()[geom] as u32 {
            ffi::mjGEOM_SPHERE => (Core::Point, size.x),
            ffi::mjGEOM_CAPSULE => (Core::Segment(size.y), size.x),
            ffi::mjGEOM_ELLIPSOID => (Core::Ellipsoid(size), 0.0),
            ffi::mjGEOM_CYLINDER => (Core::Cylinder(size.x, size.y), 0.0),
            ffi::mjGEOM_BOX => (Core::Box(Vector3::zeros(), size), 0.0),
            ffi::mjGEOM_MESH => (Core::Hull(hull(sim, geom)?), 0.0),
            ffi::mjGEOM_HFIELD => (height_field(sim, geom)?, 0.0),
            ffi::mjGEOM_PLANE => (Core::HalfSpace, 0.0),
            _ => return None,
        };
        let extent = core.extent() + rounding;
        Some(Self { core, rounding, extent })
    }

    /// The outward normal of a half-space in world axes; `None` for a bounded shape.
    pub fn half_space_normal(&self, pose: &Pose) -> Option<Vector3<f64>> {
        matches!(self.core, Core::HalfSpace).then(|| pose.rotation.column(2).into())
    }

    /// The core's farthest point along `direction` (any length), both in world axes. A half-space has none: its origin
    /// is given.
    #[inline]
    pub fn support(&self, pose: &Pose, direction: &Vector3<f64>) -> Vector3<f64> {
        let local = match &self.core {
            Core::Point | Core::HalfSpace => return pose.position,
            // The only axis that matters.
            Core::Segment(half) => {
                let axis = pose.rotation.column(2);
                return pose.position + axis * half.copysign(axis.dot(direction));
            }
            core => core.support(&pose.rotation.tr_mul(direction)),
        };
        pose.position + pose.rotation * local
    }
}

impl Core {
    fn support(&self, d: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Core::Point | Core::HalfSpace => Vector3::zeros(),
            Core::Segment(half) => Vector3::z() * half.copysign(d.z),
            Core::Ellipsoid(size) => {
                let scaled = d.component_mul(size);
                let norm = scaled.norm();
                if norm > 0.0 { scaled.component_mul(size) / norm } else { Vector3::zeros() }
            }
            Core::Cylinder(radius, half) => {
                let norm = d.x.hypot(d.y);
                let scale = if norm > 0.0 { radius / norm } else { 0.0 };
                Vector3::new(d.x * scale, d.y * scale, half.copysign(d.z))
            }
            Core::Box(centre, half) => centre + half.zip_map(d, f64::copysign),
            Core::Hull(points) => {
                let mut best = (f64::NEG_INFINITY, Vector3::zeros());
                for point in points {
                    let along = point.dot(d);
                    if along > best.0 {
                        best = (along, *point);
                    }
                }
                best.1
            }
        }
    }

    fn extent(&self) -> f64 {
        match self {
            Core::Point => 0.0,
            Core::Segment(half) => *half,
            Core::Ellipsoid(size) => size.max(),
            Core::Cylinder(radius, half) => radius.hypot(*half),
            Core::Box(centre, half) => (centre.abs() + half).norm(),
            Core::Hull(points) => points.iter().map(|p| p.norm()).fold(0.0, f64::max),
            Core::HalfSpace => f64::INFINITY,
        }
    }
}

/// The points that the engine's support function of a mesh chooses from: the vertices of the hull, or all vertices if
/// no hull was made. `None` if the geom has no mesh.
fn hull(sim: &Simulation, geom: usize) -> Option<Vec<Vector3<f64>>> {
    let model = sim.model();
    let mesh = usize::try_from(model.geom_dataid()[geom]).ok()?;
    let first = *model.mesh_vertadr().get(mesh)? as usize;
    let count = model.mesh_vertnum()[mesh] as usize;
    let vertices = &model.mesh_vert()[3 * first..3 * (first + count)];
    let vertex = |i: usize| Vector3::from_column_slice(&vertices[3 * i..3 * i + 3]).cast();
    let fields = sim.model_fields();
    // SAFETY: there are `nmesh` addresses, -1 for a mesh without hull; a hull's record starts with its number of
    // vertices and of faces, then as many addresses of edges, then as many vertex ids.
    let ids = unsafe {
        let address = *fields.mesh_graphadr.add(mesh);
        match usize::try_from(address) {
            Ok(address) => {
                let record = fields.mesh_graph.add(address);
                let vertices = *record as usize;
                Some(slice(record.add(2 + vertices), vertices))
            }
            Err(_) => None,
        }
    };
    Some(match ids {
        Some(ids) => ids.iter().map(|&id| vertex(id as usize)).collect(),
        None => (0..count).map(vertex).collect(),
    })
}

/// The box around a height field. `None` if the geom has no height field.
fn height_field(sim: &Simulation, geom: usize) -> Option<Core> {
    let model = sim.model();
    let field = usize::try_from(model.geom_dataid()[geom]).ok()?;
    let size = model.hfield_size().get(4 * field..4 * field + 4)?;
    // Elevations are stored from 0 to 1.
    let (top, bottom) = (size[2], -size[3]);
    let centre = Vector3::z() * (0.5 * (top + bottom));
    let half = Vector3::new(size[0], size[1], 0.5 * (top - bottom));
    Some(Core::Box(centre, half))
}
