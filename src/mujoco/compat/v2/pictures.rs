//! What is drawn, and the mouse in it.

use crate::mujoco::ffi;

/// Makes a geom of the scene an arrow, line or the like from one point to another.
///
/// # Safety
/// The geom is initialised.
pub(in crate::mujoco) unsafe fn connect(
    geom: *mut ffi::mjvGeom,
    kind: i32,
    width: f64,
    from: nalgebra::Vector3<f64>,
    to: nalgebra::Vector3<f64>,
) {
    // SAFETY: as the caller promises.
    unsafe { ffi::mjv_makeConnector(geom, kind, width, from.x, from.y, from.z, to.x, to.y, to.z) }
}

/// The engine's mjv_select: the body, -1 for none.
///
/// # Safety
/// Model and data belong together, the scene is one of the model's, and `point` has three places.
pub(in crate::mujoco) unsafe fn select(
    (m, d): (*const ffi::mjModel, *const ffi::mjData),
    options: &ffi::mjvOption,
    [aspect, x, y]: [f64; 3],
    scene: &ffi::mjvScene,
    point: &mut [f64; 3],
) -> i32 {
    let (mut geom, mut skin) = (-1, -1);
    // SAFETY: as the caller promises.
    unsafe { ffi::mjv_select(m, d, options, aspect, x, y, scene, point.as_mut_ptr(), &mut geom, &mut skin) }
}

/// The engine's mjv_moveCamera.
///
/// # Safety
/// The model is valid, and the scene is one of it.
pub(in crate::mujoco) unsafe fn move_camera(
    m: *const ffi::mjModel,
    action: i32,
    [x, y]: [f64; 2],
    scene: &ffi::mjvScene,
    camera: &mut ffi::mjvCamera,
) {
    // SAFETY: as the caller promises.
    unsafe { ffi::mjv_moveCamera(m, action, x, y, scene, camera) }
}
