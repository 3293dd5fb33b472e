//! OpenGL in a window: glutin's context and surface.

use std::ffi::c_char;
use std::num::NonZeroU32;

use glutin::config::{Config, ConfigTemplateBuilder};
use glutin::context::{ContextApi, ContextAttributesBuilder, GlProfile, PossiblyCurrentContext};
use glutin::display::{Display, GetGlDisplay};
use glutin::prelude::*;
use glutin::surface::{Surface, WindowSurface};
use glutin_winit::{DisplayBuilder, GlWindow};
use winit::event_loop::ActiveEventLoop;
use winit::raw_window_handle::HasWindowHandle;
use winit::window::{Window, WindowAttributes};

use super::error::Error;
use super::guard;

/// A window with the OpenGL context that draws into it.
pub(super) struct WindowContext {
    // In the order in which they are dropped: the window is the last.
    surface: Surface<WindowSurface>,
    context: PossiblyCurrentContext,
    window: Window,
    software: bool,
}

/// Samples for each pixel that are good enough: more cost and are not seen.
const SAMPLES: u8 = 4;
/// GL_RENDERER.
const RENDERER: u32 = 0x1F01;

impl WindowContext {
    /// Opens a window, and makes its context current. It has [`SAMPLES`] samples for each pixel, and one where drawing is done
    /// in software, which takes three times as long with four.
    pub fn open(events: &ActiveEventLoop, window: WindowAttributes) -> Result<Self, Error> {
        let opened = Self::open_with(events, window.clone().with_visible(false), SAMPLES)?;
        if !opened.software {
            opened.window.set_visible(true);
            return Ok(opened);
        }
        drop(opened);
        Self::open_with(events, window, 0)
    }

    /// In the compatibility profile, which the engine's renderer needs.
    fn open_with(events: &ActiveEventLoop, window: WindowAttributes, samples: u8) -> Result<Self, Error> {
        let template = ConfigTemplateBuilder::new().with_depth_size(24).with_stencil_size(8);
        let builder = DisplayBuilder::new().with_window_attributes(Some(window));
        let built = builder.build(events, template, |configs| best(configs, samples));
        let (window, config) = built.map_err(|e| no_window(&format!("there is no window with OpenGL: {e}")))?;
        let window = window.ok_or_else(|| no_window("no window was opened"))?;
        let failed = |e: glutin::error::Error| no_window(&format!("no OpenGL context can be made: {e}"));
        let handle = window.window_handle().map_err(|e| no_window(&format!("the window has no handle: {e}")))?;
        let attributes = ContextAttributesBuilder::new()
            .with_context_api(ContextApi::OpenGl(None))
            .with_profile(GlProfile::Compatibility)
            .build(Some(handle.as_raw()));
        let display = config.display();
        // SAFETY: the window's handle is valid, as the window lives.
        let context = unsafe { display.create_context(&config, &attributes) }.map_err(failed)?;
        let size = window.inner_size();
        if size.width == 0 || size.height == 0 {
            return Err(no_window("the window has no pixels"));
        }
        let attributes = window
            .build_surface_attributes(Default::default())
            .map_err(|e| no_window(&format!("the window has no handle: {e}")))?;
        // SAFETY: the window's handle is valid, and the window outlives the surface, which is dropped before it.
        let surface = unsafe { display.create_window_surface(&config, &attributes) }.map_err(failed)?;
        let context = context.make_current(&surface).map_err(failed)?;
        let software = is_software(&display);
        Ok(Self { surface, context, window, software })
    }

    /// Whether the processor draws: Mesa's llvmpipe and the like.
    pub fn is_software(&self) -> bool {
        self.software
    }

    pub fn window(&self) -> &Window {
        &self.window
    }

    /// Directs OpenGL calls of this thread to this window.
    pub fn make_current(&self) -> Result<(), Error> {
        let made = self.context.make_current(&self.surface);
        made.map_err(|e| Error::Rendering(format!("the window's OpenGL context cannot be made current: {e}")))
    }

    /// The window's size has changed.
    pub fn resize(&self, width: NonZeroU32, height: NonZeroU32) {
        self.surface.resize(&self.context, width, height);
    }

    /// Shows what was drawn.
    pub fn swap(&self) -> Result<(), Error> {
        let swapped = self.surface.swap_buffers(&self.context);
        swapped.map_err(|e| Error::Rendering(format!("the window cannot be drawn: {e}")))
    }
}

/// The configuration with the most samples up to `most`; glutin never gives an empty list.
fn best(configs: Box<dyn Iterator<Item = Config> + '_>, most: u8) -> Config {
    let rank = |config: &Config| match config.num_samples() {
        samples if samples <= most => i32::from(samples),
        samples => -i32::from(samples),
    };
    configs.max_by_key(rank).expect("glutin gives a configuration or an error")
}

/// What the renderer of the current context calls itself tells; one that tells nothing is taken for hardware.
fn is_software(display: &Display) -> bool {
    type GetString = unsafe extern "system" fn(u32) -> *const c_char;
    let function = display.get_proc_address(c"glGetString");
    if function.is_null() {
        return false;
    }
    // SAFETY: this is the type of glGetString; its context is current, and what it gives is null or a constant string.
    let name = unsafe {
        let get_string: GetString = std::mem::transmute(function);
        guard::text_of(get_string(RENDERER))
    };
    ["llvmpipe", "softpipe", "swrast", "Software Rasterizer"].iter().any(|software| name.contains(software))
}

/// The error that says what a window needs.
pub(crate) fn no_window(why: &str) -> Error {
    Error::Window(format!(
        "{why}; it needs an X display with OpenGL: run under a desktop, or a virtual display such as Xvfb with Mesa's \
         software driver (apt install xvfb xauth libgl1 libgl1-mesa-dri libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0; \
         xvfb-run -a COMMAND)"
    ))
}
