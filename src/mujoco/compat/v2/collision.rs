//! Collision detection.

use super::contact_capacity;
use crate::mujoco::compiled::CompiledModel;
use crate::mujoco::ffi;

/// Whether [`narrow_phase`] gives the engine's functions, and the pairs that this crate tests are the engine's.
pub(in crate::mujoco) const NARROW_PHASE: bool = true;

/// One contact as the engine's narrow phase gives it.
pub(in crate::mujoco) type Raw = ffi::mjContact;

/// The engine's narrow phase: `[type of geom 1][type of geom 2]`, with the smaller type first.
pub(in crate::mujoco) fn narrow_phase(kinds: [i32; 2]) -> ffi::mjfCollision {
    const KINDS: usize = ffi::mjNGEOMTYPES as usize;
    // SAFETY: a table of pointers that the library defines and nothing in this process writes.
    unsafe extern "C" {
        safe static mjCOLLISIONFUNC: [[ffi::mjfCollision; KINDS]; KINDS];
    }
    let [first, second] = kinds.map(|kind| usize::try_from(kind).unwrap_or(KINDS));
    *mjCOLLISIONFUNC.get(first)?.get(second)?
}

/// The first two axes of a contact's frame: the normal, and a hint for the first tangent.
pub(in crate::mujoco) fn axes(raw: &Raw) -> [f64; 6] {
    std::array::from_fn(|i| raw.frame[i])
}

/// Two boxes may give a point several times, which the engine then sorts out.
pub(in crate::mujoco) const REPEATS_POINTS: bool = true;
/// Static bodies with a plane or height field may be tested twice.
pub(in crate::mujoco) const REPEATS_PLANES: bool = true;

/// Whether a [`Contact`](crate::mujoco::Contact) says all about contacts of a pair.
pub(in crate::mujoco) fn is_plain(_m: &ffi::mjModel, _geoms: [usize; 2], _predefined: Option<usize>) -> bool {
    true
}

/// Number by which pairs of bodies are sorted, and excluded.
pub(in crate::mujoco) fn signature(body1: usize, body2: usize) -> i32 {
    ((body1 + 1) << 16) as i32 + body2 as i32 + 1
}

/// Whether the contacts of two bodies are sorted by geom: no.
pub(in crate::mujoco) fn sorts_pairs(_m: &ffi::mjModel, _bodies: [usize; 2]) -> bool {
    false
}

/// Whether two bodies may touch each other, given what they are welded to: also two without degrees of freedom.
pub(in crate::mujoco) fn may_meet(_m: &ffi::mjModel, _welds: [i32; 2]) -> bool {
    true
}

/// The margin (or gap) of two geoms.
pub(in crate::mujoco) fn mix_margins([first, second]: [f64; 2]) -> f64 {
    first.max(second)
}

/// The distance at which a contact is found, and that at which it is made into rows.
pub(in crate::mujoco) fn reach(margin: f64, gap: f64) -> (f64, f64) {
    (margin, margin - gap)
}

/// The friction that all contacts have instead of their own.
pub(in crate::mujoco) fn friction_override(_model: &CompiledModel) -> Option<[f64; 5]> {
    None
}

/// To which the engine's search for the distance of convex shapes goes, m.
pub(in crate::mujoco) fn distance_tolerance(m: &ffi::mjModel) -> f64 {
    m.opt.mpr_tolerance
}

/// Contacts that certainly fit.
pub(in crate::mujoco) fn contact_room(m: &ffi::mjModel, _d: &ffi::mjData) -> usize {
    contact_capacity(m)
}

/// Which pairs are tested: those of `<pair>`, and those that contype and conaffinity allow.
pub(in crate::mujoco) fn collision_kinds(m: &ffi::mjModel) -> (bool, bool) {
    match m.opt.collision as u32 {
        ffi::mjCOL_PAIR => (true, false),
        ffi::mjCOL_ALL => (true, true),
        _ => (false, true),
    }
}
