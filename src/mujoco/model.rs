//! Loading models.

use super::compat;
use super::compiled::CompiledModel;
use super::error::Error;
use super::ffi;
use super::guard;
use super::vfs::Vfs;
use std::ffi::{CStr, CString, c_char};
use std::ops::Deref;
use std::path::Path;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A loaded model: immutable, cheap to clone, shared between threads. Everything readable is on [`CompiledModel`].
#[derive(Debug, Clone)]
pub struct Model {
    compiled: Arc<CompiledModel>,
    warnings: Arc<[String]>,
}

impl Deref for Model {
    type Target = CompiledModel;

    fn deref(&self) -> &CompiledModel {
        &self.compiled
    }
}

impl Model {
    /// Loads an MJCF or URDF file.
    pub fn from_xml_file(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        check_readable(path)?;
        load(path_text(path)?, None, path.display().to_string())
    }

    /// Loads a user's MJCF file together with `extra_xml`, the elements of a second `<mujoco>` root without the root
    /// (for example `<equality>...</equality>`), without touching the file.
    ///
    /// Relative paths in the file keep their meaning. Names in `extra_xml` must be new; a body with joints added this
    /// way makes the file's keyframes too short, which the engine refuses.
    pub fn from_xml_file_with(path: impl AsRef<Path>, extra_xml: &str) -> Result<Self, Error> {
        let path = path.as_ref();
        check_readable(path)?;
        let bare = path.file_name().and_then(|name| name.to_str()).map(escape).ok_or_else(|| not_text(path))?;
        // The wrapper pretends to lie beside the user's file, so that includes, meshes and textures are found from
        // there; the engine looks up memory files by their last part, so that part must be unique.
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let unique = COUNT.fetch_add(1, Ordering::Relaxed);
        let wrapper = path.with_file_name(format!("mujoco-grasp-{}-{unique}.xml", std::process::id()));
        let xml = format!("<mujoco>\n<include file=\"{bare}\"/>\n{extra_xml}\n</mujoco>\n");
        let name = path_text(&wrapper)?;
        let mut vfs = Vfs::new();
        vfs.add(name, xml.as_bytes())?;
        load(name, Some(&vfs), format!("{} with added elements", path.display()))
    }

    /// Loads an MJCF or URDF text. Files that it names are looked up from the working directory.
    pub fn from_xml_string(xml: &str) -> Result<Self, Error> {
        Self::from_xml_with_assets(xml, &[])
    }

    /// Loads an MJCF or URDF text with files from memory (meshes, textures, includes), found by their bare names.
    pub fn from_xml_with_assets(xml: &str, assets: &[(&str, &[u8])]) -> Result<Self, Error> {
        const NAME: &str = "mujoco-grasp-model.xml";
        let mut vfs = Vfs::new();
        vfs.add(NAME, xml.as_bytes())?;
        for (name, content) in assets {
            vfs.add(name, content)?;
        }
        load(NAME, Some(&vfs), "the model text".into())
    }

    /// What MuJoCo's compiler warned of.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    pub(super) fn compiled(&self) -> &CompiledModel {
        &self.compiled
    }
}

fn load(name: &str, vfs: Option<&Vfs>, what: String) -> Result<Model, Error> {
    compat::check_version()?;
    let c_name = CString::new(name)
        .map_err(|_| Error::Load { what: what.clone(), message: "the path contains a NUL byte".into() })?;
    let vfs = vfs.map_or(std::ptr::null(), Vfs::as_ptr);
    let mut text = [0 as c_char; 4096];
    let loaded = guard::call("mj_loadXML", || {
        // SAFETY: the name and the file system live over the call; the engine writes at most the given bytes.
        unsafe { ffi::mj_loadXML(c_name.as_ptr(), vfs, text.as_mut_ptr(), text.len() as i32) }
    });
    guard::install(); // The compiler swaps the handlers while it works.
    let mut warnings = guard::take_texts();
    // SAFETY: the engine NUL-terminates what it writes, and the buffer starts as zeros.
    let text = unsafe { CStr::from_ptr(text.as_ptr()) }.to_string_lossy().trim().to_string();
    match NonNull::new(loaded?) {
        Some(ptr) => {
            if !text.is_empty() {
                warnings.push(text);
            }
            // SAFETY: a fresh model that nobody else has.
            let (compiled, adopted) = unsafe { (CompiledModel::from_raw(ptr), compat::adopt(ptr.as_ptr())) };
            adopted.map_err(|message| Error::Load { what, message })?;
            let compiled = Arc::new(compiled);
            Ok(Model { compiled, warnings: warnings.into() })
        }
        None => {
            let message = if text.is_empty() { "MuJoCo gave no reason".into() } else { text };
            Err(Error::Load { what, message })
        }
    }
}

/// A missing or unreadable file gets the system's reason, which MuJoCo's own message leaves out.
fn check_readable(path: &Path) -> Result<(), Error> {
    let fail = |source| Error::File { path: path.to_path_buf(), source };
    let file = std::fs::File::open(path).map_err(fail)?;
    if file.metadata().map_err(fail)?.is_dir() {
        return Err(fail(std::io::Error::from(std::io::ErrorKind::IsADirectory)));
    }
    Ok(())
}

fn path_text(path: &Path) -> Result<&str, Error> {
    path.to_str().ok_or_else(|| not_text(path))
}

fn not_text(path: &Path) -> Error {
    Error::Load { what: path.display().to_string(), message: "the path must be a file's, in UTF-8".into() }
}

/// For use inside a double-quoted XML attribute.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
