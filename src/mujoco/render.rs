//! Pictures of a simulation, drawn offscreen by MuJoCo's own renderer.

use image::RgbImage;

use super::arrow::Arrow;
use super::camera::Camera;
use super::compiled::CompiledModel;
use super::egl::Context;
use super::error::Error;
use super::ffi;
use super::ids::BodyId;
use super::painter::{Buffer, Painter};
use super::perturb::Perturb;
use super::scene::Scene;
use super::segment::Segment;
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
    /// Leave out shadows and reflections, which take half of the time where drawing is done in software.
    pub plain: bool,
    /// Drawn in addition.
    pub arrows: Vec<Arrow>,
    /// Drawn in addition.
    pub segments: Vec<Segment>,
    /// Bodies in other colours than their own.
    pub tints: Vec<Tint>,
    /// The selected body if there is one, and all applied wrenches, as the engine shows them.
    pub perturb: Option<Perturb>,
}

/// A body in another colour than its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tint {
    /// Whose geoms.
    pub body: BodyId,
    /// Red, green and blue, each from 0 to 1.
    pub rgb: [f32; 3],
    /// Share of that colour in the mixture with the body's own, from 0 to 1.
    pub share: f32,
    /// What the geoms' opacity is multiplied by, from 0 to 1.
    pub opacity: f32,
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
    painter: Painter,
    scene: Scene,
    context: Context,
    width: u32,
    height: u32,
}

/// Largest width and height of a picture: 4x antialiasing of this takes about 1 GB.
const LARGEST: u32 = 4096;
/// Samples for each pixel.
const SAMPLES: i32 = 4;

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
        // From here on `drop` frees what exists, also when `fill` fails.
        let scene = Scene::owning(model)?;
        let mut renderer = Self { painter: Painter::empty(), scene, context, width, height };
        renderer.painter.fill(renderer.scene.model(), Buffer::Offscreen)?;
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
    /// As [`Scene::update`].
    pub fn render(&mut self, sim: &Simulation, camera: Camera) -> Result<RgbImage, Error> {
        self.draw(sim, camera, &Drawing::default())
    }

    /// As [`render`](Self::render), with decorations.
    ///
    /// # Errors
    /// As [`Scene::update`].
    pub fn draw(&mut self, sim: &Simulation, camera: Camera, drawing: &Drawing) -> Result<RgbImage, Error> {
        self.scene.update(sim, camera, drawing)?;
        self.context.make_current()?;
        let size = self.size();
        self.painter.draw(&mut self.scene, size)?;
        self.painter.picture(size)
    }
}

impl Drop for Renderer {
    fn drop(&mut self) {
        // Without its OpenGL context current there is nothing of the engine's that could be freed.
        if self.context.make_current().is_ok() {
            self.painter.free();
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

impl Drawing {
    pub(super) fn options(&self) -> ffi::mjvOption {
        // SAFETY: a plain C structure of numbers; the call writes all of it and cannot fault.
        let mut options = unsafe {
            let mut options: ffi::mjvOption = std::mem::zeroed();
            ffi::mjv_defaultOption(&mut options);
            options
        };
        for (flag, on) in [
            (ffi::mjVIS_CONTACTPOINT, self.contact_points),
            (ffi::mjVIS_CONTACTFORCE, self.contact_forces),
            (ffi::mjVIS_TRANSPARENT, self.transparent),
            (ffi::mjVIS_PERTFORCE, self.perturb.is_some()),
            // 2.2.2 would take a contact that the grasp excluded for a distance constraint, and read past its arrays.
            (ffi::mjVIS_CONSTRAINT, false),
        ] {
            options.flags[flag as usize] = on.into();
        }
        if self.hide_sites {
            options.sitegroup.fill(0);
        }
        options
    }
}
