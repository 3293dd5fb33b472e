//! A compiled model: what [`Model`](super::Model) shares and what each simulation owns a private copy of.
#![allow(non_snake_case)] // The engine's names are the field's.

use super::compat;
use super::error::{Error, check_index};
use super::ffi;
use super::guard;
use super::ids::*;
use std::ffi::{CStr, CString};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};

/// MuJoCo's compiled model: sizes, parameters (see the array methods) and names. Nothing here can change it.
pub struct CompiledModel {
    ptr: NonNull<ffi::mjModel>,
    /// The same for all copies of one loaded model, and no other's.
    origin: u64,
    /// False if the memory is another's; see [`lent`](Self::lent).
    owned: bool,
}

// SAFETY: the model is plain memory owned by this value, or lent to it; every method that takes `&self` only reads it.
unsafe impl Send for CompiledModel {}
// SAFETY: as above.
unsafe impl Sync for CompiledModel {}

impl Drop for CompiledModel {
    fn drop(&mut self) {
        if !self.owned {
            return;
        }
        // SAFETY: allocated by the engine, freed once. Freeing cannot fault; were it to, there is nobody to tell.
        let _ = guard::call("mj_deleteModel", || unsafe { ffi::mj_deleteModel(self.ptr.as_ptr()) });
    }
}

impl std::fmt::Debug for CompiledModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "CompiledModel {{ nq: {}, nv: {}, nu: {}, nbody: {} }}",
            self.nq(),
            self.nv(),
            self.nu(),
            self.nbody()
        )
    }
}

macro_rules! sizes {
    ($($name:ident, $doc:literal;)*) => { $(
        #[doc = concat!("Number of ", $doc, ".")]
        pub fn $name(&self) -> usize {
            // SAFETY: the pointer is valid for as long as `self`.
            unsafe { (*self.as_ptr()).$name as usize }
        }
    )* };
}

macro_rules! lookups {
    ($($one:ident, $name_of:ident, $all:ident: $id:ident, $count:ident;)*) => { $(
        #[doc = concat!("The ", stringify!($one), " with this name; an unknown name gives an error that lists close ones.")]
        pub fn $one(&self, name: &str) -> Result<$id, Error> {
            self.find(name, self.$count())
        }

        #[doc = concat!("The name of a ", stringify!($one), "; `None` if it has none or does not exist.")]
        pub fn $name_of(&self, id: $id) -> Option<&str> {
            self.name_of(id)
        }

        #[doc = concat!("All ", stringify!($all), ", in the engine's order.")]
        pub fn $all(&self) -> impl ExactSizeIterator<Item = $id> + use<> {
            (0..self.$count()).map($id::from_index)
        }
    )* };
}

impl CompiledModel {
    /// Takes over a model that the engine has allocated.
    ///
    /// # Safety
    /// `ptr` is a valid model that nobody else owns.
    pub(super) unsafe fn from_raw(ptr: NonNull<ffi::mjModel>) -> Self {
        Self { ptr, origin: new_origin(), owned: true }
    }

    /// A model that stays its owner's.
    ///
    /// # Safety
    /// `ptr` is a valid model for as long as the value lives, and nobody writes it while a method of the value runs.
    pub(super) unsafe fn lent(ptr: NonNull<ffi::mjModel>) -> Self {
        Self { ptr, origin: new_origin(), owned: false }
    }

    /// Whether the memory is this value's own.
    pub(super) fn is_owned(&self) -> bool {
        self.owned
    }

    /// The model has been edited by its owner: what was derived from it is no longer that of this model.
    pub(super) fn renew_origin(&mut self) {
        self.origin = new_origin();
    }

    /// A number that all copies of one loaded model have in common, and no other model of this process.
    pub(crate) fn origin(&self) -> u64 {
        self.origin
    }

    /// Whether both are copies of one loaded model: all sizes, names and addresses are the same. The same file loaded
    /// twice gives two models.
    pub fn is_copy_of(&self, other: &Self) -> bool {
        self.origin == other.origin
    }

    /// That `what`, which was made for the model with this [`origin`](Self::origin), is used with a copy of it.
    pub(super) fn check_origin(&self, origin: u64, what: &'static str) -> Result<(), Error> {
        if self.origin == origin { Ok(()) } else { Err(Error::OtherModel { what }) }
    }

    /// A private copy.
    pub(super) fn duplicate(&self) -> Result<Self, Error> {
        // SAFETY: a null destination makes the engine allocate a new model.
        let copy = guard::call("mj_copyModel", || unsafe { ffi::mj_copyModel(std::ptr::null_mut(), self.as_ptr()) })?;
        match NonNull::new(copy) {
            Some(ptr) => Ok(Self { ptr, origin: self.origin, owned: true }),
            None => Err(Error::Engine { call: "mj_copyModel", message: "no model was returned".into() }),
        }
    }

    /// The engine's structure, for reading.
    pub(crate) fn as_ptr(&self) -> *const ffi::mjModel {
        self.ptr.as_ptr()
    }

    /// The engine's structure, for the simulation that owns this copy.
    pub(super) fn as_mut_ptr(&mut self) -> *mut ffi::mjModel {
        self.ptr.as_ptr()
    }

    sizes! {
        nq, "generalized coordinates, dim(qpos)";
        nv, "degrees of freedom, dim(qvel)";
        nu, "actuators, dim(ctrl)";
        na, "activation states, dim(act)";
        nbody, "bodies, with the world";
        njnt, "joints";
        ngeom, "geoms";
        nsite, "sites";
        ncam, "cameras";
        nmesh, "meshes";
        neq, "equality constraints";
        ntendon, "tendons";
        nsensor, "sensors";
        nsensordata, "numbers in sensordata";
        nkey, "keyframes";
        nmocap, "mocap bodies";
        npair, "predefined geom pairs";
        nexclude, "excluded body pairs";
        nM, "non-zeros in the sparse inertia matrix";
    }

    /// Number of constraint rows that fit (njmax); in MuJoCo 3, where memory limits them: a very large number.
    pub fn njmax(&self) -> usize {
        // SAFETY: the pointer is valid for as long as `self`.
        compat::row_capacity(unsafe { &*self.as_ptr() })
    }

    /// Number of contacts that fit (nconmax); in MuJoCo 3, where memory limits them: a very large number.
    pub fn nconmax(&self) -> usize {
        // SAFETY: as above.
        compat::contact_capacity(unsafe { &*self.as_ptr() })
    }

    lookups! {
        body, body_name, bodies: BodyId, nbody;
        joint, joint_name, joints: JointId, njnt;
        geom, geom_name, geoms: GeomId, ngeom;
        site, site_name, sites: SiteId, nsite;
        camera, camera_name, cameras: CameraId, ncam;
        mesh, mesh_name, meshes: MeshId, nmesh;
        equality, equality_name, equalities: EqualityId, neq;
        tendon, tendon_name, tendons: TendonId, ntendon;
        actuator, actuator_name, actuators: ActuatorId, nu;
        sensor, sensor_name, sensors: SensorId, nsensor;
        keyframe, keyframe_name, keyframes: KeyframeId, nkey;
    }

    /// The body's name, or "body3" for one without: for columns and paths.
    pub fn body_column(&self, id: BodyId) -> String {
        self.body_name(id).map_or_else(|| format!("body{}", id.index()), str::to_owned)
    }

    /// "body palm", or "body 3" for one without a name: for messages.
    pub fn label<I: Id>(&self, id: I) -> String {
        match self.name_of(id) {
            Some(name) => format!("{} {name:?}", I::KIND),
            None => format!("{} {}", I::KIND, id.index()),
        }
    }

    /// The bodies of a tree: `root` and everything below it, in the engine's order.
    pub fn subtree(&self, root: BodyId) -> Result<Vec<BodyId>, Error> {
        check_index(BodyId::KIND, root.index(), self.nbody())?;
        let parents = self.body_parentid();
        let mut inside = vec![false; self.nbody()];
        inside[root.index()] = true;
        // A parent always comes before its children.
        for body in root.index() + 1..inside.len() {
            inside[body] = inside[parents[body] as usize];
        }
        Ok(self.bodies().filter(|body| inside[body.index()]).collect())
    }

    /// The free joint with which a body floats, if it has one.
    pub fn free_joint_of(&self, body: BodyId) -> Option<JointId> {
        let first = usize::try_from(*self.body_jntadr().get(body.index())?).ok()?;
        (self.jnt_type()[first] == ffi::mjJNT_FREE as i32).then(|| JointId::from_index(first))
    }

    fn name_of<I: Id>(&self, id: I) -> Option<&str> {
        let index = i32::try_from(id.index()).ok()?;
        // SAFETY: the engine checks the index and returns null or a string inside the model.
        let name = unsafe { ffi::mj_id2name(self.as_ptr(), I::OBJECT as i32, index) };
        if name.is_null() {
            return None;
        }
        // SAFETY: a NUL-terminated string that lives and stays unchanged as long as the model.
        let name = unsafe { CStr::from_ptr(name) }.to_str().ok()?;
        (!name.is_empty()).then_some(name)
    }

    fn find<I: Id>(&self, name: &str, count: usize) -> Result<I, Error> {
        let index = CString::new(name).ok().and_then(|c_name| {
            // SAFETY: the name is NUL-terminated; the engine only reads.
            let index = unsafe { ffi::mj_name2id(self.as_ptr(), I::OBJECT as i32, c_name.as_ptr()) };
            usize::try_from(index).ok()
        });
        // The empty name is how MuJoCo marks an element without one.
        match index {
            Some(index) if !name.is_empty() => Ok(I::from_index(index)),
            _ => Err(self.unknown_name::<I>(name, count)),
        }
    }

    fn unknown_name<I: Id>(&self, name: &str, count: usize) -> Error {
        let names: Vec<&str> = (0..count).filter_map(|i| self.name_of(I::from_index(i))).collect();
        Error::UnknownName { kind: I::KIND, name: name.into(), hint: hint(name, &names) }
    }
}

/// See [`CompiledModel::origin`].
fn new_origin() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// "; did you mean ...? It has ...", from the names that exist.
fn hint(name: &str, names: &[&str]) -> String {
    const CLOSE: usize = 3;
    const LISTED: usize = 12;
    if names.is_empty() {
        return " (none of them has a name)".into();
    }
    let mut close: Vec<(f64, &str)> = names
        .iter()
        .map(|known| (strsim::jaro_winkler(&name.to_lowercase(), &known.to_lowercase()), *known))
        .filter(|(similarity, _)| *similarity > 0.75)
        .collect();
    close.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut text = String::new();
    if !close.is_empty() {
        let close: Vec<String> = close.iter().take(CLOSE).map(|(_, known)| format!("{known:?}")).collect();
        text.push_str(&format!("; did you mean {}?", close.join(" or ")));
    }
    let listed: Vec<String> = names.iter().take(LISTED).map(|known| format!("{known:?}")).collect();
    let more = if names.len() > LISTED { format!(" and {} more", names.len() - LISTED) } else { String::new() };
    text.push_str(&format!(" (there are {}{more})", listed.join(", ")));
    text
}
