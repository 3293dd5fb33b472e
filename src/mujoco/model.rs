//! Loading models.

use super::arrays::slice;
use super::compat;
use super::compiled::CompiledModel;
use super::error::Error;
use super::ffi;
use super::foreign;
use super::guard;
use super::isolation;
use super::scan::{Findings, Sources, scan};
use super::vfs::Vfs;
use std::ffi::{CStr, CString, c_char, c_void};
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
        let findings = scan_file(path)?;
        if findings.length_ranges {
            return Self::from_scanned_file(path, WITHOUT_THREADS, path.display().to_string());
        }
        load(path_text(path)?, None, path.display().to_string())
    }

    /// Loads a user's MJCF file together with `extra_xml`, the elements of a second `<mujoco>` root without the root
    /// (for example `<equality>...</equality>`), without touching the file.
    ///
    /// Relative paths in the file keep their meaning. Names in `extra_xml` must be new; a body with joints added this
    /// way makes the file's keyframes too short, which the engine refuses.
    pub fn from_xml_file_with(path: impl AsRef<Path>, extra_xml: &str) -> Result<Self, Error> {
        let path = path.as_ref();
        let mut findings = scan_file(path)?;
        let sources = Sources { folder: path.parent().unwrap_or(Path::new("")), memory: &[] };
        findings.length_ranges |= scan("the added elements", extra_xml.as_bytes(), &sources)?.length_ranges;
        let threads = if findings.length_ranges { WITHOUT_THREADS } else { "" };
        Self::from_scanned_file(
            path,
            &format!("{extra_xml}{threads}"),
            format!("{} with added elements", path.display()),
        )
    }

    /// The file and `extra_xml`, both looked at.
    fn from_scanned_file(path: &Path, extra_xml: &str, what: String) -> Result<Self, Error> {
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
        load(name, Some(&vfs), what)
    }

    /// Loads an MJCF or URDF text. Files that it names are looked up from the working directory.
    pub fn from_xml_string(xml: &str) -> Result<Self, Error> {
        Self::from_xml_with_assets(xml, &[])
    }

    /// Loads an MJCF or URDF text with files from memory (meshes, textures, includes), found by their bare names.
    pub fn from_xml_with_assets(xml: &str, assets: &[(&str, &[u8])]) -> Result<Self, Error> {
        const NAME: &str = "mujoco-grasp-model.xml";
        const WHAT: &str = "the model text";
        let sources = Sources { folder: Path::new(""), memory: assets };
        let findings = scan(WHAT, xml.as_bytes(), &sources)?;
        let mut vfs = Vfs::new();
        match xml.rsplit_once("</mujoco>").filter(|_| findings.length_ranges) {
            Some((inside, after)) => vfs.add(NAME, format!("{inside}{WITHOUT_THREADS}</mujoco>{after}").as_bytes())?,
            None => vfs.add(NAME, xml.as_bytes())?,
        }
        for (name, content) in assets {
            vfs.add(name, content)?;
        }
        load(NAME, Some(&vfs), WHAT.into())
    }

    /// What MuJoCo's compiler warned of.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// MuJoCo's binary model.
    pub(super) fn to_binary(&self) -> Result<Vec<u8>, Error> {
        let m = self.compiled.as_ptr();
        // SAFETY: the model is valid.
        let size = guard::call("mj_sizeModel", || unsafe { ffi::mj_sizeModel(m) })?;
        let mut bytes = vec![0_u8; usize::try_from(size).unwrap_or(0)];
        guard::call("mj_saveModel", || {
            // SAFETY: the buffer has the size that the engine asked for.
            unsafe { ffi::mj_saveModel(m, std::ptr::null(), bytes.as_mut_ptr().cast(), size) }
        })?;
        Ok(bytes)
    }

    /// From what [`to_binary`](Self::to_binary) gave, with the warnings of before.
    pub(super) fn from_binary(what: &str, warnings: &str, bytes: &[u8]) -> Result<Self, Error> {
        let mut vfs = Vfs::new();
        vfs.add("mujoco-grasp-model.mjb", bytes)?;
        let ptr = guard::call("mj_loadModel", || {
            // SAFETY: the name and the file system live over the call.
            unsafe { ffi::mj_loadModel(c"mujoco-grasp-model.mjb".as_ptr(), vfs.as_ptr()) }
        })?;
        let warnings = warnings.split('\0').filter(|text| !text.is_empty()).map(str::to_owned).collect();
        match NonNull::new(ptr) {
            Some(ptr) => adopt(ptr, what.into(), warnings),
            None => Err(Error::Load { what: what.into(), message: guard::take_texts().join("; ") }),
        }
    }

    pub(super) fn compiled(&self) -> &CompiledModel {
        &self.compiled
    }
}

/// The compiler's threads for length ranges hand no fault to the guard: one of them would end the process.
const WITHOUT_THREADS: &str = "<compiler usethread=\"false\"/>";

fn load(name: &str, vfs: Option<&Vfs>, what: String) -> Result<Model, Error> {
    if let Some(library) = compat::other_library() {
        return Err(Error::Version { header: compat::header_version(), library });
    }
    let c_name = CString::new(name)
        .map_err(|_| Error::Load { what: what.clone(), message: "the path contains a NUL byte".into() })?;
    match isolation::limit() {
        Some(seconds) => {
            let compile = || {
                let model = compile(&c_name, vfs, what.clone())?;
                Ok((model.warnings().join("\0"), model.to_binary()?))
            };
            let (warnings, binary) = isolation::load(&what, seconds, compile)?;
            Model::from_binary(&what, &warnings, &binary)
        }
        None => compile(&c_name, vfs, what),
    }
}

/// The arguments of mj_loadXML, and what it returns.
struct Loading {
    name: *const c_char,
    vfs: *const ffi::mjVFS,
    text: [c_char; 4096],
    model: *mut ffi::mjModel,
}

unsafe extern "C-unwind" fn load_xml(loading: *mut c_void) {
    // SAFETY: `compile` passes a valid structure; the engine writes at most the given bytes.
    unsafe {
        let loading = loading.cast::<Loading>();
        let (text, size) = ((&raw mut (*loading).text).cast(), (*loading).text.len() as i32);
        (*loading).model = ffi::mj_loadXML((*loading).name, (*loading).vfs, text, size);
    }
}

fn compile(name: &CStr, vfs: Option<&Vfs>, what: String) -> Result<Model, Error> {
    let vfs = vfs.map_or(std::ptr::null(), Vfs::as_ptr);
    let mut loading = Loading { name: name.as_ptr(), vfs, text: [0; 4096], model: std::ptr::null_mut() };
    let loaded = guard::call("mj_loadXML", || {
        // SAFETY: the name and the file system live over the call; an exception skips the engine's own frames alone.
        unsafe { foreign::catch(load_xml, (&raw mut loading).cast()) }
    });
    guard::install(); // The compiler swaps the handlers while it works.
    let mut warnings = guard::take_texts();
    // SAFETY: the engine NUL-terminates what it writes, and the buffer starts as zeros.
    let text = unsafe { CStr::from_ptr(loading.text.as_ptr()) }.to_string_lossy();
    let text = one_line(&text);
    let text = text.trim();
    if let Err(message) = loaded? {
        return Err(Error::Load { what, message });
    }
    match NonNull::new(loading.model) {
        Some(ptr) => {
            if !text.is_empty() {
                warnings.push(text.into());
            }
            adopt(ptr, what, warnings)
        }
        None if text.is_empty() => Err(Error::Load { what, message: "MuJoCo gave no reason".into() }),
        None => Err(Error::Load { message: format!("{text}{}", compat::newer_advice(text)), what }),
    }
}

/// Takes over a fresh model that nobody else has.
fn adopt(ptr: NonNull<ffi::mjModel>, what: String, warnings: Vec<String>) -> Result<Model, Error> {
    // SAFETY: as above.
    let compiled = unsafe { CompiledModel::from_raw(ptr) };
    check(&compiled).map_err(|message| Error::Load { what, message })?;
    Ok(Model { compiled: Arc::new(compiled), warnings: warnings.into() })
}

/// That a model has nothing with which this crate does not work, and no address that leads outside of it.
pub(super) fn check(model: &CompiledModel) -> Result<(), String> {
    // SAFETY: the model is valid.
    unsafe { compat::adopt(model.as_ptr()) }?;
    check_faces(model)
}

/// The engine's message without its line breaks.
fn one_line(text: &str) -> String {
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(", ")
}

/// The compiler takes the corners of faces as they are in a file, and drawing takes them as addresses.
fn check_faces(model: &CompiledModel) -> Result<(), String> {
    // SAFETY: the engine's own shapes; skins come with an address and a count for each.
    unsafe {
        let m = &*model.as_ptr();
        let parts = [
            (m.nmesh, m.mesh_faceadr, m.mesh_facenum, m.mesh_vertnum, m.mesh_face, "mesh"),
            (m.nskin, m.skin_faceadr, m.skin_facenum, m.skin_vertnum, m.skin_face, "skin"),
        ];
        for (count, address, faces, vertices, corners, kind) in parts {
            for i in 0..count as usize {
                let (first, faces) = (*address.add(i) as usize, *faces.add(i) as usize);
                let corners = slice(corners.add(3 * first), 3 * faces);
                let vertices = *vertices.add(i);
                if let Some(corner) = corners.iter().find(|corner| !(0..vertices).contains(*corner)) {
                    return Err(format!(
                        "a face of {kind} {i} has the corner {corner}, which is no vertex: it has {vertices}"
                    ));
                }
            }
        }
    }
    Ok(())
}

/// Looks at a file before MuJoCo does. A missing or unreadable one gets the system's reason, which MuJoCo's own message
/// leaves out.
fn scan_file(path: &Path) -> Result<Findings, Error> {
    let text = std::fs::read(path).map_err(|source| Error::File { path: path.to_path_buf(), source })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    scan(&path.display().to_string(), &text, &Sources { folder, memory: &[] })
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
