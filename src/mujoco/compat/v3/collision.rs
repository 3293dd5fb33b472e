//! The collision driver's rules around the narrow phase, as of 3.9: before, it is not called alone.

use crate::mujoco::compiled::CompiledModel;
use crate::mujoco::ffi;
use std::ffi::c_int;

/// Whether [`narrow_phase`] gives the engine's functions to call alone.
pub(in crate::mujoco) const NARROW_PHASE: bool = cfg!(mj_narrow_phase);

/// One contact as the engine's narrow phase gives it.
#[cfg(mj_narrow_phase)]
pub(in crate::mujoco) type Raw = ffi::mjPreContact;
/// One contact as the engine's narrow phase gives it.
#[cfg(not(mj_narrow_phase))]
pub(in crate::mujoco) type Raw = ffi::mjContact;

type NarrowPhase =
    unsafe extern "C-unwind" fn(*const ffi::mjModel, *mut ffi::mjData, *mut Raw, c_int, c_int, f64) -> c_int;

/// The engine's narrow phase: `[type of geom 1][type of geom 2]`, with the smaller type first.
pub(in crate::mujoco) fn narrow_phase(kinds: [i32; 2]) -> Option<NarrowPhase> {
    const KINDS: usize = ffi::mjNGEOMTYPES as usize;
    // SAFETY: a table of pointers that the library defines and nothing in this process writes. They are called only where
    // `NARROW_PHASE` holds, and then have this signature.
    unsafe extern "C" {
        safe static mjCOLLISIONFUNC: [[Option<NarrowPhase>; KINDS]; KINDS];
    }
    let [first, second] = kinds.map(|kind| usize::try_from(kind).unwrap_or(KINDS));
    *mjCOLLISIONFUNC.get(first)?.get(second)?
}

/// The first two axes of a contact's frame: the normal, and a hint for the first tangent.
pub(in crate::mujoco) fn axes(raw: &Raw) -> [f64; 6] {
    #[cfg(mj_narrow_phase)]
    {
        let ([x, y, z], [u, v, w]) = (raw.normal, raw.tangent);
        [x, y, z, u, v, w]
    }
    #[cfg(not(mj_narrow_phase))]
    std::array::from_fn(|i| raw.frame[i])
}

/// Points are given once.
pub(in crate::mujoco) const REPEATS_POINTS: bool = false;
/// Pairs are tested once.
pub(in crate::mujoco) const REPEATS_PLANES: bool = false;

/// Whether a [`Contact`](crate::mujoco::Contact) says all about contacts of a pair.
pub(in crate::mujoco) fn is_plain(m: &ffi::mjModel, geoms: [usize; 2], predefined: Option<usize>) -> bool {
    // SAFETY: geoms and pair are the model's own, whose arrays have that many entries.
    unsafe {
        let field = |geom: usize| *m.geom_type.add(geom) == ffi::mjGEOM_SDF as i32;
        let referenced = |pair: usize| {
            let first = ffi::mjNREF as usize * pair;
            (first..first + ffi::mjNREF as usize).any(|i| *m.pair_solreffriction.add(i) != 0.0)
        };
        #[cfg(mj_adhesion)]
        let adheres = geoms.iter().any(|&geom| *m.geom_adhesion.add(geom) != 0.0)
            || predefined.is_some_and(|pair| *m.pair_adhesion.add(pair) != 0.0);
        #[cfg(not(mj_adhesion))]
        let adheres = false;
        !adheres && !geoms.into_iter().any(field) && !predefined.is_some_and(referenced)
    }
}

/// Number by which pairs of bodies are sorted, and excluded.
pub(in crate::mujoco) fn signature(body1: usize, body2: usize) -> i32 {
    (body1 << 16) as i32 + body2 as i32
}

/// Whether the contacts of two bodies are sorted by geom: if both have a tree of boxes, and not one geom each.
pub(in crate::mujoco) fn sorts_pairs(m: &ffi::mjModel, bodies: [usize; 2]) -> bool {
    // SAFETY: the bodies are the model's own.
    let single = bodies.iter().all(|&body| unsafe { *m.body_geomnum.add(body) } == 1);
    // SAFETY: as above.
    let trees = bodies.iter().all(|&body| unsafe { *m.body_bvhadr.add(body) } >= 0);
    !single && trees && m.opt.disableflags & ffi::mjDSBL_MIDPHASE as i32 == 0
}

/// Whether two bodies may touch each other, given what they are welded to: one has to have degrees of freedom.
pub(in crate::mujoco) fn may_meet(m: &ffi::mjModel, welds: [i32; 2]) -> bool {
    // SAFETY: a weld is a body of the model.
    welds.iter().any(|&weld| unsafe { *m.body_dofnum.add(weld as usize) } > 0)
}

/// The margin (or gap) of two geoms.
pub(in crate::mujoco) fn mix_margins([first, second]: [f64; 2]) -> f64 {
    first + second
}

/// The distance at which a contact is found, and that at which it is made into rows.
pub(in crate::mujoco) fn reach(margin: f64, gap: f64) -> (f64, f64) {
    (margin + gap, margin)
}

/// The friction that all contacts have instead of their own.
pub(in crate::mujoco) fn friction_override(model: &CompiledModel) -> Option<[f64; 5]> {
    // SAFETY: the model is valid for as long as the reference.
    let options = unsafe { &(*model.as_ptr()).opt };
    model.overrides_contacts().then(|| options.o_friction.map(|coefficient| coefficient.max(ffi::mjMINMU)))
}

/// To which the engine's search for the distance of convex shapes goes, m.
pub(in crate::mujoco) fn distance_tolerance(m: &ffi::mjModel) -> f64 {
    m.opt.ccd_tolerance
}

/// Contacts that certainly fit, with room for what the collision stage needs meanwhile: at most as much again.
pub(in crate::mujoco) fn contact_room(_m: &ffi::mjModel, d: &ffi::mjData) -> usize {
    const OTHERS: usize = 1 << 16;
    let free = (d.narena as usize).saturating_sub(d.pstack + d.ncon as usize * size_of::<ffi::mjContact>());
    free.saturating_sub(OTHERS) / (2 * size_of::<ffi::mjContact>())
}

/// Which pairs are tested: those of `<pair>`, and those that contype and conaffinity allow.
pub(in crate::mujoco) fn collision_kinds(_m: &ffi::mjModel) -> (bool, bool) {
    (true, true)
}
