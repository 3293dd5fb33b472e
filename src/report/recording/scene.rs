//! Bodies and geoms of a model as a tree of entities, their poses over time, and forces.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use re_log_types::EntityPath;
use re_sdk_types::archetypes::{
    Arrows3D, Boxes3D, Capsules3D, Cylinders3D, Ellipsoids3D, Mesh3D, Transform3D, ViewCoordinates,
};
use re_sdk_types::components::{Color, FillMode};
use re_sdk_types::datatypes::{Quaternion as Xyzw, Vec3D};

use super::super::ReportError;
use super::{Recording, failed};
use crate::mujoco::{BodyId, CompiledModel, GeomId, GeomKind, LAST_DRAWN_GROUP, Simulation};

/// A scene at one time.
#[derive(Debug, Clone)]
pub struct Frame<'a> {
    /// \[s\]
    pub time_s: f64,
    /// Position of every joint.
    pub qpos: &'a [f64],
    /// Point of attack \[m\] and force \[N\], in the world's axes.
    pub forces: Vec<(Vector3<f64>, Vector3<f64>)>,
}

/// Length of a force's arrow \[m/N\].
const ARROW: f64 = 0.01;
/// An endless floor reaches so far \[m\].
const ENDLESS: f64 = 5.0;
const FORCE: Color = Color(re_sdk_types::datatypes::Rgba32(0xE6_9F_00_FF));

impl Recording {
    /// The model's bodies as a tree under the path `at`, which is the world, their geoms that pictures show, the poses in
    /// each frame, and the frames' forces (1 cm for 1 N) under `at/contact_forces`. `sim` is left in the last frame's pose.
    ///
    /// # Errors
    /// [`ReportError::Recording`], also for what the engine reports.
    pub fn scene(&mut self, at: &str, sim: &mut Simulation, frames: &[Frame<'_>]) -> Result<(), ReportError> {
        let world = EntityPath::from(at);
        self.log_static(world.clone(), &ViewCoordinates::RIGHT_HAND_Z_UP())?;
        let paths = body_paths(sim.model(), &world);
        for geom in sim.model().geoms() {
            self.geom(sim.model(), geom, &paths)?;
        }
        let moving: Vec<bool> = sim.model().bodies().map(|body| moves(sim.model(), body)).collect();
        let mut poses: Vec<Vec<Isometry3<f64>>> = vec![Vec::new(); paths.len()];
        for frame in frames {
            sim.qpos_mut().copy_from_slice(frame.qpos);
            sim.kinematics().map_err(failed)?;
            for body in sim.model().bodies().skip(1) {
                // Of a body that stays where it is on its parent, one pose is all.
                if moving[body.index()] || poses[body.index()].is_empty() {
                    let parent = BodyId::from_index(sim.model().body_parentid()[body.index()] as usize);
                    poses[body.index()].push(sim.body_pose(parent).inv_mul(&sim.body_pose(body)));
                }
            }
        }
        for ((path, poses), moving) in paths.into_iter().zip(&poses).zip(moving) {
            let translations = poses.iter().map(|p| vector(&p.translation.vector));
            let quaternions = poses.iter().map(|p| quaternion(&p.rotation));
            let transforms = Transform3D::new().with_many_translation(translations).with_many_quaternion(quaternions);
            match poses.len() {
                0 => {}
                _ if moving => {
                    let times = frames.iter().map(|f| f.time_s);
                    self.columns(path, times, transforms.columns_of_unit_batches())?;
                }
                _ => self.log_static(path, &transforms)?,
            }
        }
        self.forces(child(&world, "contact_forces"), frames)
    }

    fn forces(&mut self, path: EntityPath, frames: &[Frame<'_>]) -> Result<(), ReportError> {
        let all = || frames.iter().flat_map(|f| &f.forces);
        self.log_static(path.clone(), &Arrows3D::update_fields().with_colors([FORCE]).with_radii([0.0015]))?;
        let arrows = Arrows3D::from_vectors(all().map(|(_, force)| vector(&(ARROW * force))));
        let arrows = arrows.with_origins(all().map(|(point, _)| vector(point)));
        self.columns(path, frames.iter().map(|f| f.time_s), arrows.columns(frames.iter().map(|f| f.forces.len())))
    }

    /// A geom in its place on its body.
    fn geom(&mut self, model: &CompiledModel, geom: GeomId, paths: &[EntityPath]) -> Result<(), ReportError> {
        let g = geom.index();
        if model.geom_group()[g] > LAST_DRAWN_GROUP {
            return Ok(());
        }
        let name = model.geom_name(geom).map_or_else(|| g.to_string(), str::to_owned);
        let path = child(&child(&paths[model.geom_bodyid()[g] as usize], "geoms"), &name);
        let size: [f32; 3] = std::array::from_fn(|i| model.geom_size()[3 * g + i] as f32);
        let [x, y, _] = size;
        let (color, solid) = ([color(model, g)], FillMode::Solid);
        let place = Transform3D::from_translation(vec3(&model.geom_pos()[3 * g..3 * g + 3]));
        self.log_static(path.clone(), &place.with_quaternion(wxyz(&model.geom_quat()[4 * g..4 * g + 4])))?;
        match GeomKind::from_raw(model.geom_type()[g]) {
            GeomKind::Plane => {
                let [x, y] = [x, y].map(|half| if half > 0.0 { half } else { ENDLESS as f32 });
                let flat = Boxes3D::from_half_sizes([(x, y, 0.0)]);
                // Without its texture a white floor would outshine what stands on it.
                let [r, g, b, a] = color[0].to_array();
                let color = [Color::from_unmultiplied_rgba(r / 2, g / 2, b / 2, a)];
                self.log_static(path, &flat.with_colors(color).with_fill_mode(solid))
            }
            GeomKind::Box => {
                let cuboid = Boxes3D::from_half_sizes([size]);
                self.log_static(path, &cuboid.with_colors(color).with_fill_mode(solid))
            }
            GeomKind::Sphere => {
                let ball = Ellipsoids3D::from_half_sizes([[x; 3]]);
                self.log_static(path, &ball.with_colors(color).with_fill_mode(solid))
            }
            GeomKind::Ellipsoid => {
                let ellipsoid = Ellipsoids3D::from_half_sizes([size]);
                self.log_static(path, &ellipsoid.with_colors(color).with_fill_mode(solid))
            }
            GeomKind::Capsule => {
                // The viewer's begins at its origin.
                let capsule = Capsules3D::from_lengths_and_radii([2.0 * y], [x]).with_translations([(0.0, 0.0, -y)]);
                self.log_static(path, &capsule.with_colors(color).with_fill_mode(solid))
            }
            GeomKind::Cylinder => {
                let cylinder = Cylinders3D::from_lengths_and_radii([2.0 * y], [x]);
                self.log_static(path, &cylinder.with_colors(color).with_fill_mode(solid))
            }
            GeomKind::Mesh => self.log_static(path, &mesh(model, model.geom_dataid()[g] as usize, color[0])),
            GeomKind::HeightField => {
                self.log_static(path, &height_field(model, model.geom_dataid()[g] as usize, color[0]))
            }
            // What later engines have besides: its place is there, without a shape.
            GeomKind::Other(_) => Ok(()),
        }
    }
}

/// The path of each body: its name under its parent's path.
fn body_paths(model: &CompiledModel, world: &EntityPath) -> Vec<EntityPath> {
    let mut paths = vec![world.clone()];
    for body in model.bodies().skip(1) {
        let parent = &paths[model.body_parentid()[body.index()] as usize];
        paths.push(child(parent, &model.body_column(body)));
    }
    paths
}

fn child(parent: &EntityPath, name: &str) -> EntityPath {
    parent.join(&EntityPath::from_single_string(name))
}

fn moves(model: &CompiledModel, body: BodyId) -> bool {
    model.body_jntnum()[body.index()] > 0
}

fn vector(v: &Vector3<f64>) -> Vec3D {
    [v.x, v.y, v.z].into()
}

fn vec3(v: &[f64]) -> Vec3D {
    [v[0], v[1], v[2]].into()
}

fn quaternion(q: &UnitQuaternion<f64>) -> Xyzw {
    Xyzw::from_xyzw([q.i, q.j, q.k, q.w].map(|v| v as f32))
}

fn wxyz(q: &[f64]) -> Xyzw {
    quaternion(&UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3])))
}

/// The material's, unless the geom has one of its own: as the engine draws it.
fn color(model: &CompiledModel, geom: usize) -> Color {
    let own = &model.geom_rgba()[4 * geom..4 * geom + 4];
    let material = model.geom_matid()[geom];
    let rgba = match usize::try_from(material) {
        Ok(material) if own == [0.5, 0.5, 0.5, 1.0] => &model.mat_rgba()[4 * material..4 * material + 4],
        _ => own,
    };
    let [r, g, b, a] = std::array::from_fn(|i| (rgba[i].clamp(0.0, 1.0) * 255.0).round() as u8);
    Color::from_unmultiplied_rgba(r, g, b, a)
}

fn mesh(model: &CompiledModel, mesh: usize, color: Color) -> Mesh3D {
    let part = |start: i32, count: i32| 3 * start as usize..3 * (start + count) as usize;
    let vertices = &model.mesh_vert()[part(model.mesh_vertadr()[mesh], model.mesh_vertnum()[mesh])];
    let faces = &model.mesh_face()[part(model.mesh_faceadr()[mesh], model.mesh_facenum()[mesh])];
    let vertices = vertices.chunks_exact(3).map(|v| Vector3::new(v[0], v[1], v[2])).collect();
    shaded(vertices, faces.chunks_exact(3).map(|f| [f[0], f[1], f[2]].map(|i| i as u32)).collect(), color)
}

/// The surface of a height field; its base and sides are not seen.
fn height_field(model: &CompiledModel, field: usize, color: Color) -> Mesh3D {
    let [start, rows, columns] =
        [model.hfield_adr(), model.hfield_nrow(), model.hfield_ncol()].map(|array| array[field] as usize);
    let size: [f32; 4] = std::array::from_fn(|i| model.hfield_size()[4 * field + i] as f32);
    let along = |i: usize, n: usize, half: f32| half * (2.0 * i as f32 / (n.max(2) - 1) as f32 - 1.0);
    let vertex = |i: usize| {
        let (row, column) = (i / columns, i % columns);
        let height = size[2] * model.hfield_data()[start + i];
        Vector3::new(along(column, columns, size[0]), along(row, rows, size[1]), height)
    };
    let mut faces = Vec::new();
    for row in 1..rows {
        for column in 1..columns {
            let [a, b] = [(row - 1) * columns + column, row * columns + column].map(|i| i as u32);
            faces.extend([[a - 1, a, b], [a - 1, b, b - 1]]);
        }
    }
    shaded((0..rows * columns).map(vertex).collect(), faces, color)
}

/// With the normals without which the viewer does not shade: of each vertex the mean of its faces', by area.
fn shaded(vertices: Vec<Vector3<f32>>, faces: Vec<[u32; 3]>, color: Color) -> Mesh3D {
    let mut normals = vec![Vector3::zeros(); vertices.len()];
    for face in &faces {
        let [a, b, c] = face.map(|i| vertices[i as usize]);
        let area = (b - a).cross(&(c - a));
        face.iter().for_each(|&i| normals[i as usize] += area);
    }
    let array = |v: &Vector3<f32>| [v.x, v.y, v.z];
    let normals: Vec<_> = normals.iter().map(|n| array(&n.try_normalize(0.0).unwrap_or_else(Vector3::z))).collect();
    Mesh3D::new(vertices.iter().map(array))
        .with_triangle_indices(faces)
        .with_vertex_normals(normals)
        .with_albedo_factor(color.0)
}
