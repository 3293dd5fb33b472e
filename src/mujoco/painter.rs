//! The engine's OpenGL renderer (mjrContext), in whichever OpenGL context is current.

use std::ffi::CString;

use image::RgbImage;
use image::imageops::flip_vertical_in_place;

use super::compiled::CompiledModel;
use super::error::Error;
use super::ffi;
use super::guard;
use super::scene::Scene;

/// What is drawn on.
#[derive(Clone, Copy)]
pub(super) enum Buffer {
    Offscreen,
    #[cfg(feature = "view")]
    Window,
}

/// Draws scenes. Every call needs the OpenGL context that was current when it was made, also [`free`](Self::free), without
/// which the engine's buffers stay.
pub(super) struct Painter {
    engine: ffi::mjrContext,
    filled: bool,
}

impl Painter {
    /// With nothing in it: [`fill`](Self::fill) it.
    pub fn empty() -> Self {
        // SAFETY: a plain C structure of numbers and pointers, for which zeros are valid; the engine then sets its defaults.
        // The call cannot fault.
        let engine = unsafe {
            let mut engine = std::mem::zeroed();
            ffi::mjr_defaultContext(&mut engine);
            engine
        };
        Self { engine, filled: false }
    }

    /// Uploads meshes and textures of the model.
    pub fn fill(&mut self, model: &CompiledModel, buffer: Buffer) -> Result<(), Error> {
        let m = model.as_ptr();
        // mjMAXTEXTURE is 1000, but the context of 2.2.2 has places for fewer, and the engine does not look.
        // SAFETY: the model is valid.
        let textures = unsafe { (*m).ntex };
        if textures as usize > self.engine.texture.len() {
            let room = self.engine.texture.len();
            return Err(Error::Rendering(format!("the model has {textures} textures; at most {room} can be drawn")));
        }
        let buffer = match buffer {
            Buffer::Offscreen => ffi::mjFB_OFFSCREEN,
            #[cfg(feature = "view")]
            Buffer::Window => ffi::mjFB_WINDOW,
        };
        self.filled = true;
        let engine = &mut self.engine;
        guard::call("mjr_makeContext", || {
            // SAFETY: the context is in its default state, an OpenGL context is current, the model valid.
            unsafe {
                ffi::mjr_makeContext(m, engine, ffi::mjFONTSCALE_100 as i32);
                ffi::mjr_setBuffer(buffer as i32, engine);
            }
        })
    }

    /// Frees what the engine has in the OpenGL context.
    pub fn free(&mut self) {
        if std::mem::take(&mut self.filled) {
            let engine = &mut self.engine;
            // SAFETY: filled by the engine, as far as it came, and freed once; its OpenGL context is current.
            let _ = guard::call("mjr_freeContext", || unsafe { ffi::mjr_freeContext(engine) });
        }
    }

    /// Draws the scene.
    pub fn draw(&self, scene: &mut Scene, (width, height): (u32, u32)) -> Result<(), Error> {
        let engine = &self.engine;
        guard::call("mjr_render", || {
            // SAFETY: the OpenGL context of the engine's is current, and scene and context are of one model.
            unsafe { ffi::mjr_render(viewport(width, height), scene.raw_mut(), engine) }
        })
    }

    /// Reads back what is drawn.
    pub fn picture(&self, (width, height): (u32, u32)) -> Result<RgbImage, Error> {
        let mut picture = RgbImage::new(width, height);
        let engine = &self.engine;
        guard::call("mjr_readPixels", || {
            // SAFETY: the OpenGL context is current, its buffer is at least as large as the viewport, and the picture has
            // three bytes for each pixel of it (rows are packed without gaps).
            unsafe {
                ffi::mjr_readPixels(picture.as_mut_ptr(), std::ptr::null_mut(), viewport(width, height), engine);
            }
        })?;
        // OpenGL counts rows from the bottom.
        flip_vertical_in_place(&mut picture);
        Ok(picture)
    }

    /// Two columns of text in a corner of the viewport (mjr_overlay).
    #[cfg(feature = "view")]
    pub fn overlay(&self, corner: u32, size: (u32, u32), [left, right]: [&str; 2]) -> Result<(), Error> {
        let [left, right] = [c_text(left, OVERLAY_ROOM), c_text(right, OVERLAY_ROOM)];
        let (font, corner, area) = (ffi::mjFONT_NORMAL as i32, corner as i32, viewport(size.0, size.1));
        guard::call("mjr_overlay", || {
            // SAFETY: the OpenGL context is current; both texts end in a zero and fit the engine's buffer.
            unsafe { ffi::mjr_overlay(font, corner, area, left.as_ptr(), right.as_ptr(), &self.engine) }
        })
    }

    /// A plot (mjr_figure).
    #[cfg(feature = "view")]
    pub fn figure(&self, area: super::Rect, figure: &mut ffi::mjvFigure) -> Result<(), Error> {
        guard::call("mjr_figure", || {
            // SAFETY: the OpenGL context is current; counts and texts of the figure are within its arrays (`Figure`).
            unsafe { ffi::mjr_figure(area.raw(), figure, &self.engine) }
        })
    }

    /// A rectangle (mjr_rectangle).
    #[cfg(feature = "view")]
    pub fn rectangle(&self, area: super::Rect, [r, g, b, a]: [f32; 4]) -> Result<(), Error> {
        // SAFETY: the OpenGL context is current.
        guard::call("mjr_rectangle", || unsafe { ffi::mjr_rectangle(area.raw(), r, g, b, a) })
    }

    /// A rectangle with text in its middle (mjr_label).
    #[cfg(feature = "view")]
    pub fn label(&self, area: super::Rect, [r, g, b, a]: [f32; 4], text: &str) -> Result<(), Error> {
        let text = c_text(text, OVERLAY_ROOM);
        let font = ffi::mjFONT_NORMAL as i32;
        guard::call("mjr_label", || {
            // SAFETY: the OpenGL context is current, and the text ends in a zero.
            unsafe { ffi::mjr_label(area.raw(), font, text.as_ptr(), r, g, b, a, 1.0, 1.0, 1.0, &self.engine) }
        })
    }
}

/// Bytes of a text that the engine copies into a buffer of its own (mjMAXOVERLAY), its zero among them.
#[cfg(feature = "view")]
const OVERLAY_ROOM: usize = ffi::mjMAXOVERLAY as usize;

/// The text as the engine's fonts have it (ASCII), cut to fit.
#[cfg(feature = "view")]
pub(super) fn c_text(text: &str, room: usize) -> CString {
    let plain = |c: char| if c == '\n' || (' '..='~').contains(&c) { c as u8 } else { b'?' };
    let bytes: Vec<u8> = text.chars().map(plain).take(room.saturating_sub(1)).collect();
    // there is no zero among these characters
    CString::new(bytes).unwrap_or_default()
}

fn viewport(width: u32, height: u32) -> ffi::mjrRect {
    ffi::mjrRect { left: 0, bottom: 0, width: width as i32, height: height as i32 }
}
