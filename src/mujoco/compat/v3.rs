//! MuJoCo 3.x, tested with 3.17.0.
//!
//! What is different for this crate, besides names:
//! - Islands and sleeping are switched off in every model: they reorder rows and leave out stages.
//! - Models with flexes, with actuators of several controls or forces, and with delays or stateful plugins are refused.
//! - Contacts and rows live in the arena, without sizes of their own.
//! - The engine's collision stage always runs: its narrow phase cannot be called alone as in 2.2.2.

use crate::mujoco::arrays::{factor, read_arrays, slice};
use crate::mujoco::compiled::CompiledModel;
use crate::mujoco::error::Error;
use crate::mujoco::ffi;
use crate::mujoco::guard;
use crate::mujoco::simulation::Simulation;
use crate::mujoco::warnings::WarningKind;
use nalgebra::Vector3;
#[cfg(test)]
use std::ffi::CStr;
use std::ffi::{c_char, c_int};

pub(in crate::mujoco) use ffi::mj_implicit;

type Handler = unsafe extern "C-unwind" fn(*const ffi::mjLogMessage);

unsafe extern "C-unwind" {
    /// The calling thread's handler, with which the Python binding works; it takes precedence over the process-wide one
    /// of `mju_setLogHandler`.
    fn _mjPRIVATE_setTlsLogHandler(handler: Option<Handler>) -> Option<Handler>;
}

/// Constants of later headers.
pub(in crate::mujoco) mod later {}

/// Whether the engine has an integrator, of those that the crate knows.
pub(in crate::mujoco) fn has_integrator(_number: i32) -> bool {
    true
}

// ---------------------------------------------------------------------------------------------------- messages

/// Makes the engine hand its messages to the guard on the current thread, instead of printing, logging and exiting.
pub(in crate::mujoco) fn install_handlers() {
    // SAFETY: only stores the pointer in a thread-local of the engine.
    unsafe { _mjPRIVATE_setTlsLogHandler(Some(on_message)) };
}

unsafe extern "C-unwind" fn on_message(message: *const ffi::mjLogMessage) {
    // SAFETY: the engine passes a valid message, whose subject is NUL-terminated, that lives until we leave.
    let (level, text) = unsafe { ((*message).level, guard::text_of((&raw const (*message).subject).cast())) };
    match u32::try_from(level) {
        Ok(ffi::mjLOG_ERROR) => guard::raise(text.into_owned()),
        Ok(ffi::mjLOG_WARNING) => guard::note(&text),
        // Timing and the like, which has to be asked for.
        _ => {}
    }
}

/// Raises an engine fault, for tests.
#[cfg(test)]
pub(in crate::mujoco) fn raise_fault(text: &CStr) {
    // SAFETY: a constant string without conversions.
    unsafe { ffi::mju_error(text.as_ptr()) }
}

/// Raises an engine warning, for tests.
#[cfg(test)]
pub(in crate::mujoco) fn raise_warning(text: &CStr) {
    // SAFETY: a constant string without conversions.
    unsafe { ffi::mju_warning(text.as_ptr()) }
}

/// The attribute of `<size>` to raise, if the message of a fault means that the engine's stack is full.
pub(in crate::mujoco) fn full_stack(message: &str) -> Option<&'static str> {
    message.contains("stack overflow").then_some("memory")
}

/// The counted warnings, in the order of mjtWarning.
pub(in crate::mujoco) const COUNTED: [WarningKind; ffi::mjNWARNING as usize] = [
    WarningKind::Inertia,
    WarningKind::ContactsFull,
    WarningKind::ConstraintsFull,
    WarningKind::BadPosition,
    WarningKind::BadVelocity,
    WarningKind::BadAcceleration,
    WarningKind::BadControl,
];

/// What to raise in `<size>` when the contact list or the constraint rows are full.
pub(in crate::mujoco) const SIZE_OF_CONTACTS: &str = "memory";
pub(in crate::mujoco) const SIZE_OF_CONSTRAINTS: &str = "memory";

// ---------------------------------------------------------------------------------------------------- model

/// Checks and adapts a model that was just loaded.
///
/// # Safety
/// `m` is valid and nobody else's.
pub(in crate::mujoco) unsafe fn adopt(m: *mut ffi::mjModel) -> Result<(), String> {
    // SAFETY: as the caller promises.
    let m = unsafe { &mut *m };
    let refused = [
        (m.nflex > 0, "flexible bodies (flex)"),
        (m.nactuator != m.nu || m.nout != m.nu, "actuators with several controls or forces"),
        (m.nhistory > 0, "delays of actuators or sensors"),
        (m.npluginstate > 0, "plugins with a state"),
    ];
    if let Some((_, what)) = refused.iter().find(|(has, _)| *has) {
        return Err(format!("it has {what}, with which mujoco-grasp does not work"));
    }
    m.opt.disableflags |= ffi::mjDSBL_ISLAND as i32;
    m.opt.enableflags &= !(ffi::mjENBL_SLEEP as i32);
    Ok(())
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

// ---------------------------------------------------------------------------------------------------- stages

/// Begins a position stage that is run in parts: kinematics.
///
/// # Safety
/// Model and data are valid and belong together.
pub(in crate::mujoco) unsafe fn kinematics(m: *mut ffi::mjModel, d: *mut ffi::mjData) {
    // SAFETY: as the caller promises.
    unsafe {
        (*d).flg_energypos = false;
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
        (*d).flg_rnepost = false;
        ffi::mj_sensorAcc(m, d);
    }
}

/// Empties the engine's stack after a fault has skipped the code that does.
pub(in crate::mujoco) fn empty_stack(d: &mut ffi::mjData) {
    (d.pstack, d.pbase) = (0, 0);
}

/// Drops the constraint rows, and gives their memory back to the arena, which begins with the contacts.
pub(in crate::mujoco) fn forget_rows(d: &mut ffi::mjData) {
    (d.ne, d.nf, d.nl, d.nefc) = (0, 0, 0, 0);
    (d.nJ, d.nY, d.nA, d.nisland, d.nidof) = (0, 0, 0, 0, 0);
    d.parena = d.ncon as usize * size_of::<ffi::mjContact>();
    // What was made for the rows is looked for again.
    (d.efc_AR, d.efc_Y) = (std::ptr::null_mut(), std::ptr::null_mut());
    (d.efc_force, d.tendon_efcadr) = (std::ptr::null_mut(), std::ptr::null_mut());
    for i in 0..d.ncon as usize {
        // SAFETY: the first `ncon` contacts are initialised.
        unsafe { (*d.contact.add(i)).efc_address = -1 };
    }
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

/// Iterations of the solver in the last solve.
pub(in crate::mujoco) fn solver_iter(d: &ffi::mjData) -> i32 {
    d.solver_niter[0]
}

// ---------------------------------------------------------------------------------------------------- inertia

/// The inertia matrix, dense.
///
/// # Safety
/// `m` and `d` belong together; `dst` has room for `nv * nv` numbers.
pub(in crate::mujoco) unsafe fn full_mass_matrix(m: *const ffi::mjModel, d: *const ffi::mjData, dst: *mut f64) {
    // SAFETY: as the caller promises.
    unsafe { ffi::mj_fullM(m, d, dst) }
}

/// The factor `L` of the inertia matrix `M = L^T D L`, of which only the entries of a degree of freedom's ancestors
/// are stored: here in compressed rows that end with the diagonal, the nearest ancestor before it.
#[derive(Debug, Clone, Copy)]
pub struct MassFactor<'a> {
    values: &'a [f64],
    start: &'a [i32],
    count: &'a [i32],
}

impl<'a> MassFactor<'a> {
    pub(in crate::mujoco) fn of(sim: &'a Simulation) -> Self {
        Self { values: sim.qLD(), start: sim.model().M_rowadr(), count: sim.model().M_rownnz() }
    }

    /// `L` entries of a degree of freedom for its ancestors, the nearest first; what comes after the last ancestor has no
    /// meaning, and missing ones are zero.
    #[inline]
    pub fn ancestors(&self, dof: usize) -> impl Iterator<Item = f64> + use<'a> {
        let start = self.start[dof] as usize;
        self.values[start..start + self.count[dof] as usize - 1].iter().rev().copied()
    }
}

/// Row of an actuator in the Jacobian of the actuators' lengths, dense.
///
/// # Safety
/// `m` and `d` are valid and belong together, the actuator exists, and `out` has nv numbers.
pub(in crate::mujoco) unsafe fn actuator_moment(
    _m: *const ffi::mjModel,
    d: *const ffi::mjData,
    actuator: usize,
    out: &mut [f64],
) {
    out.fill(0.0);
    // SAFETY: addresses, counts and column indices are the engine's own.
    unsafe {
        let (start, count) = (*(*d).moment_rowadr.add(actuator) as usize, *(*d).moment_rownnz.add(actuator) as usize);
        for k in start..start + count {
            out[*(*d).moment_colind.add(k) as usize] = *(*d).actuator_moment.add(k);
        }
    }
}

// ---------------------------------------------------------------------------------------------------- contacts and rows

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

/// Sets what is particular to this version in a contact of two geoms, whose other fields are set.
pub(in crate::mujoco) fn complete_contact(contact: &mut ffi::mjContact) {
    contact.solreffriction = [0.0; 2];
    contact.adhesion = 0.0;
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
    d.efc_diagA
}

/// Writes a value of a sparse Jacobian to what the engine keeps besides `efc_J`: nothing here.
///
/// # Safety
/// None to keep.
pub(in crate::mujoco) unsafe fn mirror_sparse(_d: &mut ffi::mjData, _row: usize, _column: usize, _value: f64) {}

// ---------------------------------------------------------------------------------------------------- collision

/// Whether [`narrow_phase`] gives the engine's functions, and the pairs that this crate tests are the engine's.
pub(in crate::mujoco) const NARROW_PHASE: bool = false;

/// One contact as the engine's narrow phase gives it.
pub(in crate::mujoco) type Raw = ffi::mjContact;

type NarrowPhase =
    unsafe extern "C-unwind" fn(*const ffi::mjModel, *mut ffi::mjData, *mut Raw, c_int, c_int, f64) -> c_int;

/// The engine's narrow phase is not used alone: broad phase, filters, margins and what follows the functions are others
/// than in 2.2.2.
pub(in crate::mujoco) fn narrow_phase(_kinds: [i32; 2]) -> Option<NarrowPhase> {
    None
}

/// Which pairs are tested: those of `<pair>`, and those that contype and conaffinity allow.
pub(in crate::mujoco) fn collision_kinds(_m: &ffi::mjModel) -> (bool, bool) {
    (true, true)
}

// ---------------------------------------------------------------------------------------------------- pictures

/// Makes a geom of the scene an arrow, line or the like from one point to another.
///
/// # Safety
/// The geom is initialised.
pub(in crate::mujoco) unsafe fn connect(
    geom: *mut ffi::mjvGeom,
    kind: i32,
    width: f64,
    from: Vector3<f64>,
    to: Vector3<f64>,
) {
    // SAFETY: as the caller promises; two points of three numbers.
    unsafe { ffi::mjv_connector(geom, kind, width, from.as_ptr(), to.as_ptr()) }
}

// ---------------------------------------------------------------------------------------------------- arrays

#[allow(non_snake_case)] // The engine's names are the field's.
impl Simulation {
    read_arrays! { data, sizes;
        ten_J: f64 [nJten], "Tendon Jacobian (sparse)";
        actuator_moment: f64 [nJmom], "Actuator moments (sparse)";
        moment_rownnz: i32 [nu], "Number of non-zeros in actuator_moment row";
        moment_rowadr: i32 [nu], "Row start address in colind array";
        moment_colind: i32 [nJmom], "Column indices in sparse Jacobian";
        M: f64 [nC], "Total inertia (sparse)";
        qLD: f64 [nC], "L'*D*L factorization of M (sparse)";
        qH: f64 [nC], "L'*D*L factorization of modified M";
    }
}

#[allow(non_snake_case)] // As above.
impl CompiledModel {
    fn model_fields(&self) -> &ffi::mjModel {
        // SAFETY: the pointer is valid for as long as `self`.
        unsafe { &*self.as_ptr() }
    }

    read_arrays! { model_fields, model_fields;
        tendon_lengthspring: f64 [ntendon x 2], "Springs' resting length range";
        ten_J_rownnz: i32 [ntendon], "Number of non-zeros in Jacobian row";
        ten_J_rowadr: i32 [ntendon], "Row start address in colind array";
        ten_J_colind: i32 [nJten], "Column indices in sparse Jacobian";
        M_rownnz: i32 [nv], "Reduced inertia: non-zeros in each row";
        M_rowadr: i32 [nv], "Reduced inertia: row addresses";
        M_colind: i32 [nC], "Reduced inertia: column indices";
        D_rownnz: i32 [nv], "Full inertia: non-zeros in each row";
        D_rowadr: i32 [nv], "Full inertia: row addresses";
        D_colind: i32 [nD], "Full inertia: column indices";
    }
}

/// What cannot run in stages, if the model has it.
pub(in crate::mujoco) fn check_stages(m: &ffi::mjModel) -> Result<(), Error> {
    if m.opt.disableflags & ffi::mjDSBL_ISLAND as i32 == 0 || m.opt.enableflags & ffi::mjENBL_SLEEP as i32 != 0 {
        return Err(Error::Unsupported("a step in stages needs islands and sleeping switched off".into()));
    }
    Ok(())
}
