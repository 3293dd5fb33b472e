//! Where a picture is taken from.

use nalgebra::Vector3;

use super::compiled::CompiledModel;
use super::error::{Error, check_index, check_value};
use super::ids::{BodyId, CameraId, Id};
use super::perturb::Drag;
use super::scene::Scene;
use super::simulation::Simulation;
use super::{compat, ffi, guard};

/// Where a picture is taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Camera {
    /// A camera of the model.
    Fixed(CameraId),
    /// A camera that looks at a point from a distance, upright (world z up in the picture).
    Free {
        /// The point in the middle of the picture, world frame \[m\].
        lookat: Vector3<f64>,
        /// From the camera to that point \[m\].
        distance: f64,
        /// Heading of the line of sight about world z \[degrees\]: 0 looks along +x, 90 along +y.
        azimuth_deg: f64,
        /// Rise of the line of sight \[degrees\]: -90 looks straight down, 0 horizontally.
        elevation_deg: f64,
    },
}

/// Largest group of geoms that is drawn (the engine's default: groups 0, 1, 2).
pub(crate) const LAST_DRAWN_GROUP: i32 = 2;

impl Camera {
    /// The model's camera of this name.
    ///
    /// # Errors
    /// [`Error::UnknownName`], which lists close names.
    pub fn named(model: &CompiledModel, name: &str) -> Result<Self, Error> {
        model.camera(name).map(Self::Fixed)
    }

    /// The model's own camera named `grasp`; without one as [`on_grasp`](Self::on_grasp).
    ///
    /// # Errors
    /// As [`on_grasp`](Self::on_grasp).
    pub fn for_grasp(sim: &Simulation, palm: BodyId, target: BodyId) -> Result<Self, Error> {
        Self::named(sim.model(), "grasp").or_else(|_| Self::on_grasp(sim, palm, target))
    }

    /// Looks at a point (world frame, m) from `distance` \[m\]; for the angles see [`Camera::Free`].
    pub fn around(point: Vector3<f64>, distance: f64, azimuth_deg: f64, elevation_deg: f64) -> Self {
        Self::Free { lookat: point, distance, azimuth_deg, elevation_deg }
    }

    /// A camera for scenes that have none suited to a grasp: it shows the whole hand (`palm` and all below it) and the
    /// target, from the open side of the hand, a little from above. It stays where it is; take it once the hand is
    /// closed. Needs the current positions (after [`forward`](Simulation::forward) or a step).
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a body that does not exist, [`Error::Rendering`] when neither has a visible geom.
    pub fn on_grasp(sim: &Simulation, palm: BodyId, target: BodyId) -> Result<Self, Error> {
        let model = sim.model();
        check_index(BodyId::KIND, target.index(), model.nbody())?;
        let hand = geoms_of(sim, &model.subtree(palm)?);
        let object = geoms_of(sim, &model.subtree(target)?);
        let middle =
            |geoms: &[(Vector3<f64>, f64)]| geoms.iter().map(|g| g.0).sum::<Vector3<f64>>() / geoms.len().max(1) as f64;
        let all = [hand.as_slice(), object.as_slice()].concat();
        if all.is_empty() {
            let (palm, target) = (model.label(palm), model.label(target));
            return Err(Error::Rendering(format!("neither {palm} nor {target} has a geom to look at")));
        }
        let from_palm = middle(&object) - middle(&hand);
        let forward = line_of_sight(from_palm, middle(&all) - robot_centre(sim, palm));
        let fovy = f64::from(sim.model_fields().vis.global.fovy);
        let (lookat, distance) = fit(&all, forward, fovy.to_radians().clamp(0.05, 3.0));
        Ok(Self::Free {
            lookat,
            distance,
            azimuth_deg: forward.y.atan2(forward.x).to_degrees(),
            elevation_deg: forward.z.clamp(-1.0, 1.0).asin().to_degrees(),
        })
    }

    /// A free camera that sees what a camera of the model sees, upright, with the point (world frame, m) at the same size in
    /// the picture; one that is free already stays as it is. Needs the current positions.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a camera that does not exist.
    pub fn freed(self, sim: &Simulation, point: Vector3<f64>) -> Result<Self, Error> {
        let Self::Fixed(id) = self else { return Ok(self) };
        check_index(CameraId::KIND, id.index(), sim.model().ncam())?;
        let position = Vector3::from_column_slice(&sim.cam_xpos()[3 * id.index()..3 * id.index() + 3]);
        let axes = &sim.cam_xmat()[9 * id.index()..9 * id.index() + 9];
        // A camera looks along its own -z.
        let forward = -Vector3::new(axes[2], axes[5], axes[8]);
        let depth = (point - position).dot(&forward).max(0.01);
        let half = |degrees: f64| (0.5 * degrees.clamp(1.0, 170.0)).to_radians().tan();
        let own = half(sim.model().cam_fovy()[id.index()]);
        let free = half(f64::from(sim.model_fields().vis.global.fovy));
        Ok(Self::Free {
            lookat: position + depth * forward,
            distance: depth * own / free,
            azimuth_deg: forward.y.atan2(forward.x).to_degrees(),
            elevation_deg: forward.z.clamp(-1.0, 1.0).asin().to_degrees(),
        })
    }

    /// The camera after a movement of the mouse, by parts of the picture's height, `y` downward, as in MuJoCo's `simulate`;
    /// a camera of the model stays where it is. `scene` has been [updated](Scene::update) with this camera.
    ///
    /// # Errors
    /// As [`Scene::update`] for bad numbers; [`Error::Engine`].
    pub fn moved(self, drag: Drag, x: f64, y: f64, scene: &Scene) -> Result<Self, Error> {
        let Self::Free { .. } = self else { return Ok(self) };
        self.check(scene.model())?;
        for value in [x, y] {
            check_value("a movement of the mouse", value, "finite", |_| true)?;
        }
        let mut camera = self.engine();
        let m = scene.model().as_ptr();
        guard::call("mjv_moveCamera", || {
            // SAFETY: the model is valid, and the scene is one of it.
            unsafe { compat::move_camera(m, drag.action(), [x, y], scene.raw(), &mut camera) }
        })?;
        let lookat = camera.lookat.into();
        let (distance, azimuth_deg, elevation_deg) = (camera.distance, camera.azimuth, camera.elevation);
        Ok(Self::Free { lookat, distance, azimuth_deg, elevation_deg })
    }

    pub(super) fn engine(self) -> ffi::mjvCamera {
        // SAFETY: a plain C structure of numbers; the call writes all of it and cannot fault.
        let mut engine = unsafe {
            let mut engine: ffi::mjvCamera = std::mem::zeroed();
            ffi::mjv_defaultCamera(&mut engine);
            engine
        };
        match self {
            Self::Fixed(id) => {
                engine.type_ = ffi::mjCAMERA_FIXED as i32;
                engine.fixedcamid = id.index() as i32;
            }
            Self::Free { lookat, distance, azimuth_deg, elevation_deg } => {
                engine.type_ = ffi::mjCAMERA_FREE as i32;
                engine.lookat = lookat.into();
                engine.distance = distance;
                engine.azimuth = azimuth_deg;
                engine.elevation = elevation_deg;
            }
        }
        engine
    }

    /// Checks numbers that the engine would take as they are.
    pub(super) fn check(&self, model: &CompiledModel) -> Result<(), Error> {
        match *self {
            Self::Fixed(id) => check_index(CameraId::KIND, id.index(), model.ncam()),
            Self::Free { lookat, distance, azimuth_deg, elevation_deg } => {
                for coordinate in lookat.iter() {
                    check_value("a coordinate of the camera's lookat point", *coordinate, "finite", |_| true)?;
                }
                check_value("the camera's distance", distance, "positive", |d| d > 0.0)?;
                check_value("the camera's azimuth_deg", azimuth_deg, "finite", |_| true)?;
                check_value("the camera's elevation_deg", elevation_deg, "finite", |_| true)
            }
        }
    }
}

/// Unit line of sight: across the hand's axis (from palm to object), turned so that it also looks into the open hand,
/// 25 degrees downward, and from outside the robot rather than through it.
fn line_of_sight(hand_axis: Vector3<f64>, outward: Vector3<f64>) -> Vector3<f64> {
    let horizontal = |v: Vector3<f64>| Vector3::new(v.x, v.y, 0.0).try_normalize(1e-9);
    let open = horizontal(hand_axis).or_else(|| horizontal(outward)).unwrap_or_else(Vector3::x);
    let side = Vector3::z().cross(&open);
    // Of both sides, the one away from the rest of the robot.
    let side = if side.dot(&outward) < 0.0 { -side } else { side };
    let away = horizontal(0.8 * side + 0.6 * open).unwrap_or(side);
    let (sin, cos) = 25f64.to_radians().sin_cos();
    -(cos * away + sin * Vector3::z())
}

/// The point to look at and the least distance from it from which all spheres are within the angle `fovy` \[rad\], up and
/// down and to both sides.
fn fit(spheres: &[(Vector3<f64>, f64)], forward: Vector3<f64>, fovy: f64) -> (Vector3<f64>, f64) {
    let right = forward.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::y);
    let up = right.cross(&forward);
    let middle = |axis: &Vector3<f64>| {
        let low = spheres.iter().map(|(p, r)| p.dot(axis) - r).fold(f64::INFINITY, f64::min);
        let high = spheres.iter().map(|(p, r)| p.dot(axis) + r).fold(f64::NEG_INFINITY, f64::max);
        0.5 * (low + high) * axis
    };
    let lookat = middle(&right) + middle(&up) + middle(&forward);
    let (sin, cos) = (0.5 * fovy).sin_cos();
    // A sphere touches the picture's edge when its centre is r off the plane of that edge through the camera.
    let least = |(p, r): &(Vector3<f64>, f64)| {
        let offset = p - lookat;
        let across = offset.dot(&right).abs().max(offset.dot(&up).abs());
        (across * cos + r) / sin - offset.dot(&forward)
    };
    let distance = spheres.iter().map(least).fold(0.0, f64::max);
    // A little is left free around them.
    (lookat, 1.03 * distance)
}

/// Positions and bounding radii of the visible geoms of some bodies.
fn geoms_of(sim: &Simulation, bodies: &[BodyId]) -> Vec<(Vector3<f64>, f64)> {
    let model = sim.model();
    let (owners, groups, radii) = (model.geom_bodyid(), model.geom_group(), model.geom_rbound());
    let drawn = |g: &usize| groups[*g] <= LAST_DRAWN_GROUP && bodies.iter().any(|b| b.index() as i32 == owners[*g]);
    let position = |g: usize| Vector3::from_column_slice(&sim.geom_xpos()[3 * g..3 * g + 3]);
    (0..model.ngeom()).filter(drawn).map(|g| (position(g), radii[g])).collect()
}

/// Centre of mass of the tree that the palm belongs to.
fn robot_centre(sim: &Simulation, palm: BodyId) -> Vector3<f64> {
    let root = sim.model().body_rootid()[palm.index()] as usize;
    Vector3::from_column_slice(&sim.subtree_com()[3 * root..3 * root + 3])
}
