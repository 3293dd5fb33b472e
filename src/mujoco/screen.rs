//! A window that shows a simulation, drawn by MuJoCo's own renderer.

use std::num::NonZeroU32;

use image::RgbImage;
use winit::event_loop::ActiveEventLoop;
use winit::window::{Window, WindowAttributes};

use super::camera::Camera;
use super::compiled::CompiledModel;
use super::error::Error;
use super::ffi;
use super::figure::Figure;
use super::painter::{Buffer, Painter};
use super::rect::Rect;
use super::render::Drawing;
use super::scene::Scene;
use super::simulation::Simulation;
use super::window_context::WindowContext;

/// A window and what it shows. One frame is [`draw`](Self::draw), then texts, plots and rectangles on top, then
/// [`present`](Self::present).
pub struct Screen {
    // Freed in `drop`, while `context` still lives.
    painter: Painter,
    scene: Scene,
    context: WindowContext,
}

/// Of the window, for text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Corner {
    /// At the left, above.
    TopLeft,
    /// At the right, above.
    TopRight,
    /// At the left, below.
    BottomLeft,
    /// At the right, below.
    BottomRight,
}

impl Screen {
    /// Opens a window for simulations of this model.
    ///
    /// # Errors
    /// [`Error::Rendering`] where there is no display or no OpenGL, [`Error::Engine`] with the engine's own message.
    pub fn open(model: &CompiledModel, events: &ActiveEventLoop, window: WindowAttributes) -> Result<Self, Error> {
        let scene = Scene::new(model)?;
        let context = WindowContext::open(events, window)?;
        // From here on `drop` frees what exists, also when `fill` fails.
        let mut screen = Self { painter: Painter::empty(), scene, context };
        screen.painter.fill(screen.scene.model(), Buffer::Window)?;
        Ok(screen)
    }

    /// The window.
    pub fn window(&self) -> &Window {
        self.context.window()
    }

    /// Whether drawing is done in software, and slow.
    pub fn is_software(&self) -> bool {
        self.context.is_software()
    }

    /// What was drawn last.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Width and height of what is drawn on \[px\], at least 1.
    pub fn size(&self) -> (u32, u32) {
        let size = self.window().inner_size();
        (size.width.max(1), size.height.max(1))
    }

    /// To be called when the window's size has changed.
    pub fn resize(&self) {
        let (width, height) = self.size();
        if let (Some(width), Some(height)) = (NonZeroU32::new(width), NonZeroU32::new(height)) {
            self.context.resize(width, height);
        }
    }

    /// Draws the simulation, whose positions must be up to date.
    ///
    /// # Errors
    /// As [`Scene::update`], and [`Error::Rendering`] for a context that is lost.
    pub fn draw(&mut self, sim: &Simulation, camera: Camera, drawing: &Drawing) -> Result<(), Error> {
        self.context.make_current()?;
        self.scene.update(sim, camera, drawing)?;
        let size = self.size();
        self.painter.draw(&mut self.scene, size)
    }

    /// Two columns of text, line by line, in a corner; cut after 500 characters each. Other characters than those of ASCII
    /// are question marks.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn text(&self, corner: Corner, left: &str, right: &str) -> Result<(), Error> {
        let corner = match corner {
            Corner::TopLeft => ffi::mjGRID_TOPLEFT,
            Corner::TopRight => ffi::mjGRID_TOPRIGHT,
            Corner::BottomLeft => ffi::mjGRID_BOTTOMLEFT,
            Corner::BottomRight => ffi::mjGRID_BOTTOMRIGHT,
        };
        self.painter.overlay(corner, self.size(), [left, right])
    }

    /// A plot.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn figure(&self, area: Rect, figure: &mut Figure) -> Result<(), Error> {
        self.painter.figure(area, figure.raw_mut())
    }

    /// A filled rectangle: red, green, blue and opacity, each from 0 to 1.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn rectangle(&self, area: Rect, rgba: [f32; 4]) -> Result<(), Error> {
        self.painter.rectangle(area, rgba)
    }

    /// A filled rectangle with white text in its middle.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn label(&self, area: Rect, rgba: [f32; 4], text: &str) -> Result<(), Error> {
        self.painter.label(area, rgba, text)
    }

    /// What is drawn so far.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn picture(&self) -> Result<RgbImage, Error> {
        self.painter.picture(self.size())
    }

    /// Shows what is drawn.
    ///
    /// # Errors
    /// [`Error::Rendering`] for a context that is lost.
    pub fn present(&self) -> Result<(), Error> {
        self.context.swap()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Without its OpenGL context current there is nothing of the engine's that could be freed.
        if self.context.make_current().is_ok() {
            self.painter.free();
        }
    }
}
