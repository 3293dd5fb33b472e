//! Contacts and constraint rows: both live in the arena.

use crate::mujoco::ffi;

/// Drops the constraint rows, and gives their memory back to the arena, which begins with the contacts.
pub(in crate::mujoco) fn forget_rows(d: &mut ffi::mjData) {
    (d.ne, d.nf, d.nl, d.nefc) = (0, 0, 0, 0);
    (d.nJ, d.nA, d.nisland, d.nidof) = (0, 0, 0, 0);
    d.parena = d.ncon as usize * size_of::<ffi::mjContact>();
    // What was made for the rows is looked for again.
    d.efc_AR = std::ptr::null_mut();
    #[cfg(mj_factored_rows)]
    {
        (d.nY, d.efc_Y) = (0, std::ptr::null_mut());
    }
    (d.efc_force, d.tendon_efcadr) = (std::ptr::null_mut(), std::ptr::null_mut());
    for i in 0..d.ncon as usize {
        // SAFETY: the first `ncon` contacts are initialised.
        unsafe { (*d.contact.add(i)).efc_address = -1 };
    }
}

/// Drops the islands of the rows, with which the solver has copies of them: it then solves all rows at once.
pub(in crate::mujoco) fn forget_islands(d: &mut ffi::mjData) {
    (d.nisland, d.nidof) = (0, 0);
}

/// mjContact.exclude: 0 included, 1 in gap, 2 fused, 3 no degrees of freedom, 4 passive. A contact is made into rows only
/// at 0.
pub(in crate::mujoco) const EXCLUDED_BY_US: i32 = 3;

/// Contacts that fit in the list: as many as the arena takes.
pub(in crate::mujoco) fn contact_capacity(_m: &ffi::mjModel) -> usize {
    i32::MAX as usize
}

/// Constraint rows that fit: as many as the arena takes.
pub(in crate::mujoco) fn row_capacity(_m: &ffi::mjModel) -> usize {
    i32::MAX as usize
}

/// Adds a contact to the list; false if it is full.
///
/// # Safety
/// `m` and `d` are valid and belong together, and all but the solver's own fields of the contact are set.
pub(in crate::mujoco) unsafe fn append_contact(
    m: *const ffi::mjModel,
    d: *mut ffi::mjData,
    contact: &ffi::mjContact,
) -> bool {
    // SAFETY: as the caller promises; the engine drops the rows, looks for room and copies the contact.
    unsafe {
        forget_rows(&mut *d);
        let room = (*d).narena as usize - (*d).pstack - (*d).parena;
        room >= 2 * size_of::<ffi::mjContact>() && ffi::mj_addContact(m, d, contact) == 0
    }
}

/// Sets what is particular to this version in a contact of two geoms, whose other fields are set; those that the crate
/// does not know are zero.
pub(in crate::mujoco) fn complete_contact(contact: &mut ffi::mjContact) {
    contact.geom = [contact.geom1, contact.geom2];
    (contact.flex, contact.elem, contact.vert) = ([-1; 2], [-1; 2], [-1; 2]);
}

/// Most rows that a contact has (a pyramid with condim 6).
const ROWS_OF_CONTACT: usize = 10;

/// Numbers that an extended `efc_force` has room for: see [`extend_forces`].
fn extended(d: &ffi::mjData) -> usize {
    d.nefc as usize + ROWS_OF_CONTACT * d.ncon as usize
}

/// Numbers that `efc_force` has room for; those behind the constraint rows are free.
pub(in crate::mujoco) fn force_capacity(_m: &ffi::mjModel, d: &ffi::mjData) -> usize {
    let end = d.arena as usize + d.parena;
    let is_extended = !d.efc_force.is_null() && d.efc_force as usize + 8 * extended(d) == end;
    if is_extended { extended(d) } else { d.nefc as usize }
}

/// Makes room in `efc_force` for forces of all contacts behind the rows, if that can be had: the arena gives rows no
/// more than their own, so the array moves to the arena's end.
pub(in crate::mujoco) fn extend_forces(d: &mut ffi::mjData) {
    let (rows, places) = (d.nefc as usize, extended(d));
    let start = d.parena.next_multiple_of(64);
    let end = start + 8 * places;
    // The stack grows from the other end; the next stages need some of it.
    if places == rows || end + d.pstack + 65536 > d.narena as usize {
        return;
    }
    // SAFETY: the arena has `narena` bytes, of which those from `start` to `end` are free; the old array has `rows`
    // numbers, if there are any.
    unsafe {
        let forces = d.arena.cast::<u8>().add(start).cast::<f64>();
        forces.write_bytes(0, places);
        if rows > 0 {
            forces.copy_from_nonoverlapping(d.efc_force, rows);
        }
        d.efc_force = forces;
    }
    d.parena = end;
}

/// Copies what mj_copyData leaves out: forces behind the rows.
pub(in crate::mujoco) fn complete_copy(m: &ffi::mjModel, from: &ffi::mjData, to: &mut ffi::mjData) {
    let (rows, places) = (from.nefc as usize, force_capacity(m, from));
    if places > rows && force_capacity(m, to) == places {
        // SAFETY: both arrays have room for that many numbers.
        unsafe { to.efc_force.add(rows).copy_from_nonoverlapping(from.efc_force.add(rows), places - rows) };
    }
}

/// Approximate diagonal of A.
pub(in crate::mujoco) fn efc_diagonal(d: &ffi::mjData) -> *mut f64 {
    #[cfg(mj_efc_diag_a)]
    {
        d.efc_diagA
    }
    #[cfg(not(mj_efc_diag_a))]
    {
        d.efc_diagApprox
    }
}

/// Writes a value of a sparse Jacobian to what the engine keeps besides `efc_J`: nothing here.
///
/// # Safety
/// None to keep.
pub(in crate::mujoco) unsafe fn mirror_sparse(_d: &mut ffi::mjData, _row: usize, _column: usize, _value: f64) {}
