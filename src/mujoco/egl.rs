//! OpenGL without a window, a display server or a GPU: EGL's surfaceless platform.

use std::marker::PhantomData;
use std::sync::OnceLock;

use khronos_egl as egl;

use super::error::Error;

/// Mesa's platform for contexts that belong to no window system (EGL_PLATFORM_SURFACELESS_MESA).
const PLATFORM_SURFACELESS_MESA: egl::Enum = 0x31DD;
const CLIENT_EXTENSION: &str = "EGL_MESA_platform_surfaceless";
const DISPLAY_EXTENSION: &str = "EGL_KHR_surfaceless_context";

type Instance = egl::DynamicInstance<egl::EGL1_5>;

/// The library and its display, opened once for the whole process and never closed: `eglTerminate` would end the
/// contexts of other threads, and the engine keeps pointers into the library.
struct Platform {
    egl: Instance,
    display: egl::Display,
    config: egl::Config,
}

// SAFETY: EGL's functions may be called from any thread (EGL 1.5, section 2.2); display and config are handles that
// are never changed or closed.
unsafe impl Send for Platform {}
// SAFETY: as above.
unsafe impl Sync for Platform {}

/// An OpenGL context of the thread that made it.
pub(super) struct Context {
    platform: &'static Platform,
    context: egl::Context,
    /// A context is current on one thread at a time: neither `Send` nor `Sync`.
    thread: PhantomData<*mut ()>,
}

impl Context {
    /// Makes a context in the compatibility profile, which the engine's renderer needs.
    pub fn new() -> Result<Self, Error> {
        let platform = platform()?;
        let Platform { egl, display, config } = platform;
        // The API is chosen for each thread.
        egl.bind_api(egl::OPENGL_API).map_err(|e| unavailable(format!("EGL does not offer OpenGL: {e}")))?;
        let context = egl
            .create_context(*display, *config, None, &[egl::NONE])
            .map_err(|e| unavailable(format!("EGL makes no OpenGL context: {e}")))?;
        Ok(Self { platform, context, thread: PhantomData })
    }

    /// Directs OpenGL calls of this thread to this context.
    pub fn make_current(&self) -> Result<(), Error> {
        let Platform { egl, display, .. } = self.platform;
        egl.make_current(*display, None, None, Some(self.context))
            .map_err(|e| unavailable(format!("the OpenGL context cannot be made current: {e}")))
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        let Platform { egl, display, .. } = self.platform;
        // What fails here leaves a context behind that nobody can use: there is nothing to do about it.
        if egl.get_current_context() == Some(self.context) {
            let _ = egl.make_current(*display, None, None, None);
        }
        let _ = egl.destroy_context(*display, self.context);
    }
}

fn platform() -> Result<&'static Platform, Error> {
    static PLATFORM: OnceLock<Result<Platform, String>> = OnceLock::new();
    PLATFORM.get_or_init(open).as_ref().map_err(|why| unavailable(why.clone()))
}

fn open() -> Result<Platform, String> {
    // SAFETY: libEGL's initialisation has no conditions on the caller.
    let egl = unsafe { Instance::load_required() }.map_err(|e| format!("libEGL.so.1 (EGL 1.5) does not load: {e}"))?;
    let offers = |display: Option<egl::Display>, extension: &str| {
        let list = egl.query_string(display, egl::EXTENSIONS).map(|list| list.to_string_lossy().into_owned());
        let found = list.is_ok_and(|list| list.split(' ').any(|e| e == extension));
        if found { Ok(()) } else { Err(format!("EGL lacks {extension}")) }
    };
    offers(None, CLIENT_EXTENSION)?;
    // SAFETY: the platform takes no native display; EGL_DEFAULT_DISPLAY is what its specification asks for.
    let display =
        unsafe { egl.get_platform_display(PLATFORM_SURFACELESS_MESA, egl::DEFAULT_DISPLAY, &[egl::ATTRIB_NONE]) }
            .map_err(|e| format!("EGL opens no display without a window system: {e}"))?;
    egl.initialize(display).map_err(|e| format!("EGL finds no driver: {e}"))?;
    offers(Some(display), DISPLAY_EXTENSION)?;
    // The default asks for window surfaces, which this platform does not have.
    let wanted = [egl::SURFACE_TYPE, egl::PBUFFER_BIT, egl::RENDERABLE_TYPE, egl::OPENGL_BIT, egl::NONE];
    let config = egl.choose_first_config(display, &wanted).map_err(|e| format!("EGL lists no configurations: {e}"))?;
    let config = config.ok_or("EGL has no configuration that can draw with OpenGL")?;
    Ok(Platform { egl, display, config })
}

fn unavailable(why: String) -> Error {
    Error::Rendering(format!(
        "{why}; Mesa's software driver is enough: install Debian's packages libegl1 and libgl1-mesa-dri \
         (apt install libegl1 libgl1-mesa-dri)"
    ))
}
