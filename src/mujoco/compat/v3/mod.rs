//! MuJoCo 3 and 4: 3.17.0, 4.0.1, and older ones as far as the identifiers of their headers tell what they have.
//!
//! What is different for this crate, besides names:
//! - Islands and sleeping are the model's own affair; a step in stages has neither (their stages are not published).
//! - Models with flexes, with actuators of several controls or forces, and with delays or stateful plugins are refused.
//! - Contacts and rows live in the arena, without sizes of their own.
//! - Before 3.9 the engine's collision stage always runs: its narrow phase is not called alone.
//!
//! The flags `mj_*` say what a version has; `build.rs` sets them from the names that the headers declare.

mod collision;
mod contacts;
mod inertia;
mod messages;

pub(in crate::mujoco) use collision::*;
pub(in crate::mujoco) use contacts::*;
pub use inertia::MassRows;
pub(in crate::mujoco) use inertia::{actuator_moment, full_mass_matrix};
pub(in crate::mujoco) use messages::*;

use crate::mujoco::ffi;
use std::ffi::{c_char, c_int};

pub(in crate::mujoco) use ffi::mj_implicit;

/// Constants of later headers.
pub(in crate::mujoco) mod later {}

/// The disable flag of constraint islands.
pub(in crate::mujoco) const ISLAND: Option<u32> = Some(ffi::mjDSBL_ISLAND);

/// The enable flag of sleeping; none where nothing sleeps.
#[cfg(mj_sleep)]
pub(in crate::mujoco) const SLEEP: Option<u32> = Some(ffi::mjENBL_SLEEP);
#[cfg(not(mj_sleep))]
pub(in crate::mujoco) const SLEEP: Option<u32> = None;

/// The disable flag of Euler's implicit damping.
pub(in crate::mujoco) const EULER_DAMPING: Option<u32> = Some(ffi::mjDSBL_EULERDAMP);

/// Whether the engine has an integrator, of those that the crate knows.
pub(in crate::mujoco) fn has_integrator(_number: i32) -> bool {
    true
}

// ---------------------------------------------------------------------------------------------------- model

/// Checks a model that was just loaded.
///
/// # Safety
/// `m` is valid and nobody else's.
pub(in crate::mujoco) unsafe fn adopt(m: *const ffi::mjModel) -> Result<(), String> {
    // SAFETY: as the caller promises.
    let m = unsafe { &*m };
    let refused = [
        (m.nflex > 0, "flexible bodies (flex)"),
        #[cfg(mj_actuator_outputs)]
        (m.nactuator != m.nu || m.nout != m.nu, "actuators with several controls or forces"),
        #[cfg(mj_delays)]
        (m.nhistory > 0, "delays of actuators or sensors"),
        (m.npluginstate > 0, "plugins with a state"),
    ];
    if let Some((_, what)) = refused.iter().find(|(has, _)| *has) {
        return Err(format!("it has {what}, with which mujoco-grasp does not work"));
    }
    Ok(())
}

/// What to add to a message of the loader about something that a newer version knows.
pub(in crate::mujoco) fn newer_advice(_message: &str) -> &'static str {
    ""
}

/// Files in memory for the loader.
pub(in crate::mujoco) mod vfs {
    use super::*;

    /// # Safety
    /// `vfs` is the engine's, zeroed.
    pub(in crate::mujoco) unsafe fn init(vfs: *mut ffi::mjVFS) {
        // SAFETY: as the caller promises.
        unsafe { ffi::mj_defaultVFS(vfs) }
    }

    /// Adds a copy of a file; 0 on success, 1 if there is no more room, 2 if the name is in use.
    ///
    /// # Safety
    /// The file system is valid, the name NUL-terminated, and the content not empty and smaller than 2 GB.
    pub(in crate::mujoco) unsafe fn add(vfs: *mut ffi::mjVFS, name: *const c_char, content: &[u8]) -> c_int {
        // SAFETY: as the caller promises.
        unsafe { ffi::mj_addBufferVFS(vfs, name, content.as_ptr().cast(), content.len() as c_int) }
    }
}

/// Where the switch of each equality constraint is: in the data.
pub(in crate::mujoco) fn eq_active(_m: *mut ffi::mjModel, d: *mut ffi::mjData) -> *mut u8 {
    // SAFETY: the caller's data is alive for as long as the simulation that owns it.
    unsafe { (*d).eq_active.cast() }
}

/// The body that an object of an equality constraint is or lies on, of a connect or weld: the object may be a site.
///
/// # Safety
/// `equality` is one of the model's, and `object` one of its two objects.
pub(in crate::mujoco) unsafe fn equality_body(m: &ffi::mjModel, equality: usize, object: i32) -> i32 {
    // SAFETY: as the caller promises; a site's number is below nsite, the length of its array.
    unsafe {
        match *m.eq_objtype.add(equality) == ffi::mjOBJ_SITE as i32 {
            true => *m.site_bodyid.add(object.max(0) as usize),
            false => object,
        }
    }
}

// ---------------------------------------------------------------------------------------------------- stages

/// Begins a position stage that is run in parts: kinematics.
///
/// # Safety
/// Model and data are valid and belong together.
pub(in crate::mujoco) unsafe fn kinematics(m: *mut ffi::mjModel, d: *mut ffi::mjData) {
    // SAFETY: as the caller promises.
    unsafe {
        #[cfg(mj_lazy_flags)]
        {
            (*d).flg_energypos = false;
        }
        ffi::mj_kinematics(m, d);
        ffi::mj_comPos(m, d);
        ffi::mj_camlight(m, d);
        ffi::mj_flex(m, d);
        ffi::mj_tendon(m, d);
    }
}

/// The inertia matrix and its factor.
///
/// # Safety
/// As for [`kinematics`].
pub(in crate::mujoco) unsafe fn inertia(m: *mut ffi::mjModel, d: *mut ffi::mjData) {
    // SAFETY: as the caller promises.
    unsafe {
        ffi::mj_makeM(m, d);
        ffi::mj_factorM(m, d);
    }
}

/// Sensors that depend on accelerations.
///
/// # Safety
/// As for [`kinematics`].
pub(in crate::mujoco) unsafe fn sensor_acc(m: *mut ffi::mjModel, d: *mut ffi::mjData) {
    // SAFETY: as the caller promises.
    unsafe {
        #[cfg(mj_lazy_flags)]
        {
            (*d).flg_rnepost = false;
        }
        ffi::mj_sensorAcc(m, d);
    }
}

/// Empties the engine's stack after a fault has skipped the code that does.
pub(in crate::mujoco) fn empty_stack(d: &mut ffi::mjData) {
    (d.pstack, d.pbase) = (0, 0);
}

/// To be called before the solver: the dual solvers read a matrix that exists only once it was made for these rows.
///
/// # Safety
/// As for [`kinematics`].
pub(in crate::mujoco) unsafe fn before_solver(m: *mut ffi::mjModel, d: *mut ffi::mjData) {
    // SAFETY: as the caller promises; for the primal solvers the function does nothing.
    unsafe {
        if (*d).nefc > 0 && (*d).efc_AR.is_null() {
            ffi::mj_projectConstraint(m, d);
        }
    }
}

/// Iterations of the solver in the last solve, the most of all islands.
pub(in crate::mujoco) fn solver_iter(d: &ffi::mjData) -> i32 {
    let islands = (d.nisland.max(1) as usize).min(d.solver_niter.len());
    d.solver_niter[..islands].iter().copied().max().unwrap_or(0)
}

// ---------------------------------------------------------------------------------------------------- pictures

/// Makes a geom of the scene an arrow, line or the like from one point to another.
///
/// # Safety
/// The geom is initialised.
#[cfg(feature = "render")]
pub(in crate::mujoco) unsafe fn connect(
    geom: *mut ffi::mjvGeom,
    kind: i32,
    width: f64,
    from: nalgebra::Vector3<f64>,
    to: nalgebra::Vector3<f64>,
) {
    // SAFETY: as the caller promises; two points of three numbers.
    unsafe { ffi::mjv_connector(geom, kind, width, from.as_ptr(), to.as_ptr()) }
}

/// The engine's mjv_select: the body, -1 for none.
///
/// # Safety
/// Model and data belong together, the scene is one of the model's, and `point` has three places.
#[cfg(feature = "render")]
pub(in crate::mujoco) unsafe fn select(
    (m, d): (*const ffi::mjModel, *const ffi::mjData),
    options: &ffi::mjvOption,
    [aspect, x, y]: [f64; 3],
    scene: &ffi::mjvScene,
    point: &mut [f64; 3],
) -> i32 {
    let (mut geom, mut flex, mut skin) = (-1, -1, -1);
    let place = point.as_mut_ptr();
    // SAFETY: as the caller promises.
    unsafe { ffi::mjv_select(m, d, options, aspect, x, y, scene, place, &mut geom, &mut flex, &mut skin) }
}

/// The engine's mjv_moveCamera.
///
/// # Safety
/// The model is valid, and the scene is one of it.
#[cfg(feature = "render")]
pub(in crate::mujoco) unsafe fn move_camera(
    m: *const ffi::mjModel,
    action: i32,
    [x, y]: [f64; 2],
    _scene: &ffi::mjvScene,
    camera: &mut ffi::mjvCamera,
) {
    // SAFETY: as the caller promises.
    unsafe {
        #[cfg(not(mj_abstract_camera))]
        ffi::mjv_moveCamera(m, action, x, y, _scene, camera);
        #[cfg(mj_abstract_camera)]
        ffi::mjv_moveCamera(m, action, x, y, camera);
    }
}
