//! What is seen of a simulation: the engine's abstract scene (mjvScene), which needs no OpenGL.

use super::arrow::Arrow;
use super::camera::Camera;
use super::compat;
use super::compiled::CompiledModel;
use super::error::{Error, check_index, check_value};
use super::ffi;
use super::guard;
use super::ids::{BodyId, Id};
use super::perturb::Perturb;
use super::render::{Drawing, Tint};
use super::segment::Segment;
use super::simulation::Simulation;
use nalgebra::Vector3;

/// Geoms that decorations (contacts, forces, arrows) may add to the model's own.
const DECORATIONS: usize = 4000;

/// The geoms, lights and camera of one moment of a simulation, to be drawn by a renderer, and to find out what is at a
/// place of the picture.
pub struct Scene {
    raw: ffi::mjvScene,
    /// The model it was made for: the scene keeps sizes and addresses of its skins.
    model: CompiledModel,
}

/// What is at a place of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picked {
    /// The body that is seen there.
    pub body: BodyId,
    /// The point of its surface, world frame \[m\].
    pub point: Vector3<f64>,
}

impl Scene {
    /// An empty scene for simulations of this model.
    ///
    /// # Errors
    /// [`Error::Engine`] with the engine's own message.
    pub fn new(model: &CompiledModel) -> Result<Self, Error> {
        Self::owning(model.duplicate()?)
    }

    /// As [`new`](Self::new), of a copy of the model that is the scene's alone.
    pub(super) fn owning(model: CompiledModel) -> Result<Self, Error> {
        // SAFETY: a plain C structure of numbers and pointers, for which zeros are valid; the engine then sets its
        // defaults. The call cannot fault.
        let raw = unsafe {
            let mut raw = std::mem::zeroed();
            ffi::mjv_defaultScene(&mut raw);
            raw
        };
        // From here on `drop` frees what exists, also when the call fails.
        let mut scene = Self { raw, model };
        // Each site and geom may also get a frame or a label; tendons take one geom for each piece of their path.
        let model = &scene.model;
        let room = 3 * (model.ngeom() + model.nsite()) + 100 * model.ntendon() + DECORATIONS;
        let room = i32::try_from(room).unwrap_or(i32::MAX);
        let (m, raw) = (model.as_ptr(), &mut scene.raw);
        guard::call("mjv_makeScene", || {
            // SAFETY: the scene is in its default state, the model valid.
            unsafe { ffi::mjv_makeScene(m, raw, room) }
        })?;
        Ok(scene)
    }

    pub(super) fn model(&self) -> &CompiledModel {
        &self.model
    }

    pub(super) fn raw(&self) -> &ffi::mjvScene {
        &self.raw
    }

    pub(super) fn raw_mut(&mut self) -> &mut ffi::mjvScene {
        &mut self.raw
    }

    /// Collects what `camera` sees of `sim`, whose positions must be up to date.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a camera or body that does not exist, [`Error::Value`] for bad numbers,
    /// [`Error::OtherModel`] for a simulation of another model (also of the same file loaded again),
    /// [`Error::Rendering`] for more things than the scene has room for, [`Error::Engine`] with the engine's own message.
    pub fn update(&mut self, sim: &Simulation, camera: Camera, drawing: &Drawing) -> Result<(), Error> {
        camera.check(sim.model())?;
        drawing.arrows.iter().try_for_each(Arrow::check)?;
        drawing.segments.iter().try_for_each(Segment::check)?;
        self.check_simulation(sim)?;
        if let Some(body) = drawing.perturb.as_ref().and_then(Perturb::body) {
            check_index(BodyId::KIND, body.index(), self.model.nbody())?;
        }
        let options = drawing.options();
        let pull = drawing.perturb.as_ref().map_or(std::ptr::null(), Perturb::as_ptr);
        let (mut camera, raw) = (camera.engine(), &mut self.raw);
        sim.query("mjv_updateScene", |m, d| {
            let all = ffi::mjCAT_ALL as i32;
            // SAFETY: model and data belong together and the scene was made for a model of these sizes; the perturbation
            // is null or of a body of this model.
            unsafe { ffi::mjv_updateScene(m, d, &options, pull, &mut camera, all, raw) }
        })?;
        for effect in [ffi::mjRND_SHADOW, ffi::mjRND_REFLECTION] {
            self.raw.flags[effect as usize] = u8::from(!drawing.plain) as _;
        }
        self.check_room(0)?;
        drawing.tints.iter().try_for_each(|tint| self.tint(tint))?;
        self.check_room(drawing.arrows.len() + drawing.segments.len())?;
        for arrow in drawing.arrows.iter().filter(|a| a.is_drawn()) {
            self.add(|geom| arrow.write(geom))?;
        }
        drawing.segments.iter().try_for_each(|segment| self.add(|geom| segment.write(geom)))
    }

    /// The body at a place of the picture, whose width over height is `aspect`: `x` from 0 at the left to 1, `y` from 0 at
    /// the bottom to 1. `None` for the world and what does not move. `sim` is as at the last [`update`](Self::update).
    ///
    /// # Errors
    /// [`Error::OtherModel`], [`Error::Value`] for numbers that are not finite, [`Error::Engine`], as before the first
    /// update.
    pub fn pick(&self, sim: &Simulation, aspect: f64, x: f64, y: f64) -> Result<Option<Picked>, Error> {
        self.check_simulation(sim)?;
        for value in [aspect, x, y] {
            check_value("a place in the picture", value, "finite", |_| true)?;
        }
        let options = Drawing::default().options();
        let mut point = [0.0; 3];
        let (raw, place) = (&self.raw, &mut point);
        let body = sim.query("mjv_select", |m, d| {
            // SAFETY: model and data belong together, and the scene was made for a model of these sizes.
            unsafe { compat::select((m, d), &options, [aspect, x, y], raw, place) }
        })?;
        let body = usize::try_from(body).ok().filter(|b| (1..sim.model().nbody()).contains(b));
        Ok(body.map(|body| Picked { body: BodyId::from_index(body), point: point.into() }))
    }

    pub(super) fn check_simulation(&self, sim: &Simulation) -> Result<(), Error> {
        sim.model().check_origin(self.model.origin(), "a scene")
    }

    fn tint(&mut self, tint: &Tint) -> Result<(), Error> {
        check_index(BodyId::KIND, tint.body.index(), self.model.nbody())?;
        for value in tint.rgb.iter().chain([&tint.share, &tint.opacity]) {
            check_value("a colour of a tint", (*value).into(), "between 0 and 1", |v| (0.0..=1.0).contains(&v))?;
        }
        let owners = self.model.geom_bodyid();
        // SAFETY: the first `ngeom` geoms are the engine's, and `&mut self` makes the access exclusive.
        let geoms = unsafe { super::arrays::slice_mut(self.raw.geoms, self.raw.ngeom as usize) };
        for geom in geoms.iter_mut().filter(|g| g.objtype == ffi::mjOBJ_GEOM as i32) {
            let owner = usize::try_from(geom.objid).ok().and_then(|id| owners.get(id));
            if owner == Some(&(tint.body.index() as i32)) {
                for (own, other) in geom.rgba.iter_mut().zip(&tint.rgb) {
                    *own += tint.share * (other - *own);
                }
                geom.rgba[3] *= tint.opacity;
            }
        }
        Ok(())
    }

    /// Adds a decoration; there is room for it.
    fn add(&mut self, write: impl FnOnce(&mut ffi::mjvGeom)) -> Result<(), Error> {
        // SAFETY: `check_room` found a place after the `ngeom` geoms in use; zeros are valid numbers.
        let geom = unsafe {
            let place = self.raw.geoms.add(self.raw.ngeom as usize);
            place.write(std::mem::zeroed());
            &mut *place
        };
        guard::call("mjv_makeConnector", || write(geom))?;
        self.raw.ngeom += 1;
        Ok(())
    }

    /// A full scene drops geoms silently.
    fn check_room(&self, more: usize) -> Result<(), Error> {
        let (used, room) = (self.raw.ngeom as usize, self.raw.maxgeom as usize);
        if used + more < room {
            return Ok(());
        }
        Err(Error::Rendering(format!("the picture needs more than the {room} geoms that there is room for")))
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        let raw = &mut self.raw;
        // SAFETY: in its default state or filled by the engine, and freed once.
        let _ = guard::call("mjv_freeScene", || unsafe { ffi::mjv_freeScene(raw) });
    }
}
