//! Pictures of a simulation, drawn offscreen by MuJoCo's own renderer.

use image::RgbImage;
use image::imageops::flip_vertical_in_place;

use super::arrow::Arrow;
use super::camera::Camera;
use super::compiled::CompiledModel;
use super::egl::Context;
use super::error::Error;
use super::ffi;
use super::guard;
use super::simulation::Simulation;

/// What a picture shows besides the visible geoms.
#[derive(Debug, Clone, Default)]
pub struct Drawing {
    /// Contacts that the engine knows, as discs.
    pub contact_points: bool,
    /// Forces of the contacts in the engine's solve, as arrows (scaled by the model's `visual/map/force`).
    pub contact_forces: bool,
    /// Moving bodies drawn translucent (to `visual/map/alpha`), to see the contacts between them.
    pub transparent: bool,
    /// Leave out the model's sites.
    pub hide_sites: bool,
    /// Drawn in addition.
    pub arrows: Vec<Arrow>,
}

/// Draws simulations of one model into images, without a window, a display server or a GPU.
///
/// OpenGL contexts belong to a thread, so a renderer stays on the one that made it; others make their own. Pictures
/// have shadows and fourfold antialiasing. A scene without lights is dark: that is the model's business.
///
/// ```
/// use mujoco_grasp::mujoco::{Camera, Model, Renderer, Simulation};
/// let model = Model::from_xml_string(
///     r#"<mujoco><worldbody><geom type="sphere" size="0.1" rgba="1 0 0 1"/></worldbody></mujoco>"#,
/// )?;
/// let mut sim = Simulation::new(&model)?;
/// sim.forward()?;
/// let mut renderer = Renderer::new(sim.model(), 64, 48)?;
/// let picture = renderer.render(&sim, Camera::around([0.0; 3].into(), 0.5, 90.0, -20.0))?;
/// let [red, green, blue] = picture.get_pixel(32, 24).0;
/// assert!(red > 2 * green && red > 2 * blue);
/// # Ok::<(), mujoco_grasp::mujoco::Error>(())
/// ```
pub struct Renderer {
    // Freed in `drop`, while `context` still lives.
    engine: ffi::mjrContext,
    scene: ffi::mjvScene,
    context: Context,
    width: u32,
    height: u32,
    /// The model it was made for: scene and context keep sizes and addresses of its skins, meshes and textures.
    model: CompiledModel,
}

/// Largest width and height of a picture: 4x antialiasing of this takes about 1 GB.
const LARGEST: u32 = 4096;
/// Samples for each pixel.
const SAMPLES: i32 = 4;
/// Geoms that decorations (contacts, forces, arrows) may add to the model's own.
const DECORATIONS: usize = 4000;

impl Renderer {
    /// A renderer for simulations of this model, of pictures with this many pixels.
    ///
    /// # Errors
    /// [`Error::Value`] for a size of zero or above 4096, [`Error::Rendering`] when OpenGL cannot be used without a
    /// display (it names the Debian packages to install), [`Error::Engine`] with the engine's own message.
    pub fn new(model: &CompiledModel, width: u32, height: u32) -> Result<Self, Error> {
        for (what, size) in [("the picture's width", width), ("the picture's height", height)] {
            let rule = "between 1 and 4096 pixels";
            super::error::check_value(what, size.into(), rule, |_| (1..=LARGEST).contains(&size))?;
        }
        // The engine takes the size of its buffer from the model, and the simulation's own must not change.
        let mut model = model.duplicate()?;
        prepare(&mut model, width, height);
        let context = Context::new()?;
        context.make_current()?;
        let (engine, scene) = empty();
        // From here on `drop` frees what exists, also when one of these calls fails.
        let mut renderer = Self { engine, scene, context, width, height, model };
        renderer.fill()?;
        Ok(renderer)
    }

    /// Width and height of the pictures.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The model's visible geoms as `camera` sees them. The simulation's positions must be up to date (after
    /// [`forward`](Simulation::forward) or a step; a step leaves the positions of its start).
    ///
    /// # Errors
    /// As [`draw`](Self::draw).
    pub fn render(&mut self, sim: &Simulation, camera: Camera) -> Result<RgbImage, Error> {
        self.draw(sim, camera, &Drawing::default())
    }

    /// As [`render`](Self::render), with decorations.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a camera that does not exist, [`Error::Value`] for a camera or arrow with bad numbers,
    /// [`Error::OtherModel`] for a simulation of another model (also of the same file loaded again),
    /// [`Error::Rendering`] for more things than the scene has room for, [`Error::Engine`] with the engine's own message.
    pub fn draw(&mut self, sim: &Simulation, camera: Camera, drawing: &Drawing) -> Result<RgbImage, Error> {
        camera.check(sim.model())?;
        drawing.arrows.iter().try_for_each(Arrow::check)?;
        sim.model().check_origin(self.model.origin(), "a renderer")?;
        self.context.make_current()?;
        self.update(sim, camera, drawing)?;
        self.add_arrows(&drawing.arrows)?;
        self.picture()
    }

    /// Allocates the scene, and uploads meshes and textures.
    fn fill(&mut self) -> Result<(), Error> {
        let model = &self.model;
        let m = model.as_ptr();
        // mjMAXTEXTURE is 1000, but the context of 2.2.2 has places for fewer, and the engine does not look.
        // SAFETY: the model is valid.
        let textures = unsafe { (*m).ntex };
        if textures as usize > self.engine.texture.len() {
            let room = self.engine.texture.len();
            return Err(Error::Rendering(format!("the model has {textures} textures; at most {room} can be drawn")));
        }
        // Each site and geom may also get a frame or a label; tendons take one geom for each piece of their path.
        let room = 3 * (model.ngeom() + model.nsite()) + 100 * model.ntendon() + DECORATIONS;
        let room = i32::try_from(room).unwrap_or(i32::MAX);
        let (scene, engine) = (&mut self.scene, &mut self.engine);
        guard::call("mjv_makeScene", || {
            // SAFETY: the scene is in its default state, the model valid.
            unsafe { ffi::mjv_makeScene(m, scene, room) }
        })?;
        guard::call("mjr_makeContext", || {
            // SAFETY: the context is in its default state, an OpenGL context is current, the model valid.
            unsafe {
                ffi::mjr_makeContext(m, engine, ffi::mjFONTSCALE_100 as i32);
                ffi::mjr_setBuffer(ffi::mjFB_OFFSCREEN as i32, engine);
            }
        })
    }

    /// Collects what is seen.
    fn update(&mut self, sim: &Simulation, camera: Camera, drawing: &Drawing) -> Result<(), Error> {
        let options = options(drawing);
        let mut camera = engine_camera(camera);
        let scene = &mut self.scene;
        sim.query("mjv_updateScene", |m, d| {
            let all = ffi::mjCAT_ALL as i32;
            // SAFETY: model and data belong together and the scene was made for a model of these sizes; no
            // perturbation is given.
            unsafe { ffi::mjv_updateScene(m, d, &options, std::ptr::null(), &mut camera, all, scene) }
        })?;
        self.check_room(0)
    }

    fn add_arrows(&mut self, arrows: &[Arrow]) -> Result<(), Error> {
        self.check_room(arrows.len())?;
        let scene = &mut self.scene;
        for arrow in arrows.iter().filter(|a| a.is_drawn()) {
            // SAFETY: `check_room` found a place for each arrow after the `ngeom` geoms in use; zeros are valid numbers.
            let geom = unsafe {
                let place = scene.geoms.add(scene.ngeom as usize);
                place.write(std::mem::zeroed());
                &mut *place
            };
            guard::call("mjv_makeConnector", || arrow.write(geom))?;
            scene.ngeom += 1;
        }
        Ok(())
    }

    /// A full scene drops geoms silently.
    fn check_room(&self, more: usize) -> Result<(), Error> {
        let (used, room) = (self.scene.ngeom as usize, self.scene.maxgeom as usize);
        if used + more < room {
            return Ok(());
        }
        Err(Error::Rendering(format!("the picture needs more than the {room} geoms that there is room for")))
    }

    /// Draws the scene and reads the pixels back.
    fn picture(&mut self) -> Result<RgbImage, Error> {
        let mut picture = RgbImage::new(self.width, self.height);
        let viewport = ffi::mjrRect { left: 0, bottom: 0, width: self.width as i32, height: self.height as i32 };
        let (scene, engine) = (&mut self.scene, &self.engine);
        guard::call("mjr_render", || {
            // SAFETY: the OpenGL context of scene and engine context is current, its buffer is at least as large as
            // the viewport, and the picture has three bytes for each pixel of it (rows are packed without gaps).
            unsafe {
                ffi::mjr_render(viewport, scene, engine);
                ffi::mjr_readPixels(picture.as_mut_ptr(), std::ptr::null_mut(), viewport, engine);
            }
        })?;
        // OpenGL counts rows from the bottom.
        flip_vertical_in_place(&mut picture);
        Ok(picture)
    }
}

impl Drop for Renderer {
    fn drop(&mut self) {
        let (scene, engine) = (&mut self.scene, &mut self.engine);
        // SAFETY: both are in their default state or filled by the engine, and freed once.
        let _ = guard::call("mjv_freeScene", || unsafe { ffi::mjv_freeScene(scene) });
        // Without its OpenGL context current there is nothing of the engine's that could be freed.
        if self.context.make_current().is_ok() {
            // SAFETY: as above, and its OpenGL context is current.
            let _ = guard::call("mjr_freeContext", || unsafe { ffi::mjr_freeContext(engine) });
        }
    }
}

/// Sets the offscreen buffer's size and samples.
fn prepare(model: &mut CompiledModel, width: u32, height: u32) {
    // SAFETY: the model is this function's alone, and valid.
    let visual = unsafe { &mut (*model.as_mut_ptr()).vis };
    visual.global.offwidth = width as _;
    visual.global.offheight = height as _;
    visual.quality.offsamples = SAMPLES as _;
}

fn empty() -> (ffi::mjrContext, ffi::mjvScene) {
    // SAFETY: both are plain C structures of numbers and pointers, for which zeros are valid; the engine then sets its
    // defaults. Neither call can fault.
    unsafe {
        let (mut engine, mut scene) = (std::mem::zeroed(), std::mem::zeroed());
        ffi::mjr_defaultContext(&mut engine);
        ffi::mjv_defaultScene(&mut scene);
        (engine, scene)
    }
}

fn options(drawing: &Drawing) -> ffi::mjvOption {
    // SAFETY: a plain C structure of numbers; the call writes all of it and cannot fault.
    let mut options = unsafe {
        let mut options: ffi::mjvOption = std::mem::zeroed();
        ffi::mjv_defaultOption(&mut options);
        options
    };
    for (flag, on) in [
        (ffi::mjVIS_CONTACTPOINT, drawing.contact_points),
        (ffi::mjVIS_CONTACTFORCE, drawing.contact_forces),
        (ffi::mjVIS_TRANSPARENT, drawing.transparent),
        // 2.2.2 would take a contact that the grasp excluded for a distance constraint, and read past its arrays.
        (ffi::mjVIS_CONSTRAINT, false),
    ] {
        options.flags[flag as usize] = on.into();
    }
    if drawing.hide_sites {
        options.sitegroup.fill(0);
    }
    options
}

fn engine_camera(camera: Camera) -> ffi::mjvCamera {
    // SAFETY: a plain C structure of numbers; the call writes all of it and cannot fault.
    let mut engine = unsafe {
        let mut engine: ffi::mjvCamera = std::mem::zeroed();
        ffi::mjv_defaultCamera(&mut engine);
        engine
    };
    match camera {
        Camera::Fixed(id) => {
            engine.type_ = ffi::mjCAMERA_FIXED as i32;
            engine.fixedcamid = id.index() as i32;
        }
        Camera::Free { lookat, distance, azimuth_deg, elevation_deg } => {
            engine.type_ = ffi::mjCAMERA_FREE as i32;
            engine.lookat = lookat.into();
            engine.distance = distance;
            engine.azimuth = azimuth_deg;
            engine.elevation = elevation_deg;
        }
    }
    engine
}
