//! MuJoCo 2.2.2.

mod collision;
#[cfg(feature = "render")]
mod pictures;

pub(in crate::mujoco) use collision::*;
#[cfg(feature = "render")]
pub(in crate::mujoco) use pictures::*;

use crate::mujoco::arrays::{factor, read_arrays, slice};
use crate::mujoco::compiled::CompiledModel;
use crate::mujoco::ffi;
use crate::mujoco::guard;
use crate::mujoco::simulation::Simulation;
use crate::mujoco::warnings::WarningKind;
use std::ffi::{c_char, c_int};

type Handler = unsafe extern "C-unwind" fn(*const c_char);

unsafe extern "C-unwind" {
    /// Exported by the library, but not declared in the headers of 2.2.2.
    pub(in crate::mujoco) fn mj_implicit(m: *const ffi::mjModel, d: *mut ffi::mjData);

    // The calling thread's handlers; they take precedence over the process-wide `mju_user_error`.
    fn _mjPRIVATE__get_tls_error_fn() -> Option<Handler>;
    fn _mjPRIVATE__get_tls_warning_fn() -> Option<Handler>;
    fn _mjPRIVATE__set_tls_error_fn(handler: Option<Handler>);
    fn _mjPRIVATE__set_tls_warning_fn(handler: Option<Handler>);
}

/// Constants of later headers.
pub(in crate::mujoco) mod later {
    #![allow(non_upper_case_globals)]
    pub const mjINT_IMPLICITFAST: u32 = 3;
}

/// The flags of constraint islands and of sleeping: this version has neither.
pub(in crate::mujoco) const ISLAND: Option<u32> = None;
pub(in crate::mujoco) const SLEEP: Option<u32> = None;

/// The disable flag of Euler's implicit damping: this version always has it.
pub(in crate::mujoco) const EULER_DAMPING: Option<u32> = None;

/// Whether the engine has an integrator, of those that the crate knows.
pub(in crate::mujoco) fn has_integrator(number: i32) -> bool {
    number != later::mjINT_IMPLICITFAST as i32
}

// ---------------------------------------------------------------------------------------------------- messages

/// What a thread does with the engine's messages: for errors, for warnings.
pub(in crate::mujoco) type Handlers = [Option<Handler>; 2];

/// Makes the engine hand its messages to the guard on the current thread, instead of printing, logging and exiting; returns
/// what it did with them before.
pub(in crate::mujoco) fn install_handlers() -> Handlers {
    // SAFETY: the calls only read pointers from thread-locals of the engine.
    let before = unsafe { [_mjPRIVATE__get_tls_error_fn(), _mjPRIVATE__get_tls_warning_fn()] };
    put_back_handlers([Some(on_error), Some(on_warning)]);
    before
}

/// Gives the current thread the handlers that [`install_handlers`] has returned.
pub(in crate::mujoco) fn put_back_handlers([error, warning]: Handlers) {
    // SAFETY: both calls only store the pointer in a thread-local of the engine.
    unsafe {
        _mjPRIVATE__set_tls_error_fn(error);
        _mjPRIVATE__set_tls_warning_fn(warning);
    }
}

unsafe extern "C-unwind" fn on_error(message: *const c_char) {
    // SAFETY: the engine passes a NUL-terminated string that lives until we leave.
    guard::raise(unsafe { guard::text_of(message) }.into_owned());
}

unsafe extern "C-unwind" fn on_warning(message: *const c_char) {
    // SAFETY: as above.
    guard::note(&unsafe { guard::text_of(message) });
}

/// The attribute of `<size>` to raise, if the message of a fault means that the engine's stack is full.
pub(in crate::mujoco) fn full_stack(message: &str) -> Option<&'static str> {
    (message == "Stack overflow").then_some("nstack")
}

/// The counted warnings, in the order of mjtWarning.
pub(in crate::mujoco) const COUNTED: [WarningKind; ffi::mjNWARNING as usize] = [
    WarningKind::Inertia,
    WarningKind::ContactsFull,
    WarningKind::ConstraintsFull,
    WarningKind::DrawnShapesFull,
    WarningKind::BadPosition,
    WarningKind::BadVelocity,
    WarningKind::BadAcceleration,
    WarningKind::BadControl,
];

/// What to raise in `<size>` when the contact list or the constraint rows are full.
pub(in crate::mujoco) const SIZE_OF_CONTACTS: &str = "nconmax";
pub(in crate::mujoco) const SIZE_OF_CONSTRAINTS: &str = "njmax";

// ---------------------------------------------------------------------------------------------------- model

/// Checks a model that was just loaded.
///
/// # Safety
/// `m` is valid and nobody else's.
pub(in crate::mujoco) unsafe fn adopt(_m: *const ffi::mjModel) -> Result<(), String> {
    Ok(())
}

/// Elements, attributes and keywords of MJCF that came with MuJoCo 3.
#[rustfmt::skip]
const NEWER: &[&str] = &[
    "actdim", "actearly", "actuatorfrclimited", "actuatorfrcrange", "actuatorgravcomp", "actuatorgroupdisable",
    "align", "alignfree", "assetdir", "attach", "autoreset", "bvactive", "cable", "camprojection", "ccd_iterations",
    "ccd_tolerance", "colorspace", "content_type", "dampratio", "deformable", "elastic2d", "elasticity", "eulerdamp",
    "extension", "flex", "flexcomp", "focal", "focalpixel", "frame", "gravcomp", "gridrange", "hemisphere",
    "implicitfast", "inheritrange", "insidesite", "instance", "invdiscrete", "island", "jointactuatorfrc", "layer",
    "ls_iterations", "ls_tolerance", "maxhullvert", "memory", "midphase", "nativeccd", "nchannel", "opacity",
    "orthographic", "plugin", "principal", "principalpixel", "replicate", "resolution", "saveinertial", "sdf",
    "sdf_initpoints", "sdf_iterations", "selfcollide", "sensorsize", "shell", "site1", "site2", "sleep",
    "sleep_tolerance", "supersphere", "supertorus", "tactile", "tausmooth", "tendonactuatorfrc", "trilinear",
    "vertcollide",
];

/// What to add to a message of the loader about something that MuJoCo 3 knows.
pub(in crate::mujoco) fn newer_advice(message: &str) -> &'static str {
    let unknown = ["unrecognized", "invalid keyword"].iter().any(|start| message.contains(start));
    let mut quoted = message.split('\'').skip(1).step_by(2);
    match unknown && quoted.any(|name| NEWER.contains(&name)) {
        true => "; this needs MuJoCo 3: build with MUJOCO_DIR=$(scripts/mujoco), or the folder of any MuJoCo 3 release",
        false => "",
    }
}

/// Files in memory for the loader.
pub(in crate::mujoco) mod vfs {
    use super::*;

    /// # Safety
    /// `vfs` is the engine's, zeroed.
    pub(in crate::mujoco) unsafe fn init(_vfs: *mut ffi::mjVFS) {
        // All-zero is the engine's empty file system (mj_defaultVFS is a memset).
    }

    /// Adds a copy of a file; 0 on success, 1 if there is no more room, 2 if the name is in use.
    ///
    /// # Safety
    /// The file system is valid, the name NUL-terminated, and the content not empty and smaller than 2 GB.
    pub(in crate::mujoco) unsafe fn add(vfs: *mut ffi::mjVFS, name: *const c_char, content: &[u8]) -> c_int {
        // SAFETY: as the caller promises; after success the engine has just appended an entry with a buffer of this size.
        unsafe {
            let result = ffi::mj_makeEmptyFileVFS(vfs, name, content.len() as c_int);
            if result == 0 {
                let last = (*vfs).nfile as usize - 1;
                let buffer = (*vfs).filedata[last].cast::<u8>();
                buffer.copy_from_nonoverlapping(content.as_ptr(), content.len());
            }
            result
        }
    }
}

/// Where the switch of each equality constraint is: in the model.
pub(in crate::mujoco) fn eq_active(m: *mut ffi::mjModel, _d: *mut ffi::mjData) -> *mut u8 {
    // SAFETY: the caller's model is alive for as long as the simulation that owns it.
    unsafe { (*m).eq_active }
}

/// The body that an object of an equality constraint is or lies on, of a connect or weld: the object is a body.
///
/// # Safety
/// `equality` is one of the model's, and `object` one of its two objects.
pub(in crate::mujoco) unsafe fn equality_body(_m: &ffi::mjModel, _equality: usize, object: i32) -> i32 {
    object
}

// ---------------------------------------------------------------------------------------------------- stages

/// Begins a position stage that is run in parts: kinematics.
///
/// # Safety
/// Model and data are valid and belong together.
pub(in crate::mujoco) unsafe fn kinematics(m: *mut ffi::mjModel, d: *mut ffi::mjData) {
    // SAFETY: as the caller promises.
    unsafe {
        ffi::mj_kinematics(m, d);
        ffi::mj_comPos(m, d);
        ffi::mj_camlight(m, d);
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
        ffi::mj_crb(m, d);
        ffi::mj_factorM(m, d);
    }
}

/// Sensors that depend on accelerations.
///
/// # Safety
/// As for [`kinematics`].
pub(in crate::mujoco) unsafe fn sensor_acc(m: *mut ffi::mjModel, d: *mut ffi::mjData) {
    // SAFETY: as the caller promises.
    unsafe { ffi::mj_sensorAcc(m, d) }
}

/// Empties the engine's stack after a fault has skipped the code that does.
pub(in crate::mujoco) fn empty_stack(d: &mut ffi::mjData) {
    d.pstack = 0;
}

/// Drops the constraint rows.
pub(in crate::mujoco) fn forget_rows(d: &mut ffi::mjData) {
    (d.ne, d.nf, d.nefc) = (0, 0, 0);
}

/// To be called before the solver: here nothing is missing.
///
/// # Safety
/// None to keep.
pub(in crate::mujoco) unsafe fn before_solver(_m: *mut ffi::mjModel, _d: *mut ffi::mjData) {}

/// Iterations of the solver in the last solve.
pub(in crate::mujoco) fn solver_iter(d: &ffi::mjData) -> i32 {
    d.solver_iter
}

// ---------------------------------------------------------------------------------------------------- inertia

/// The inertia matrix, dense.
///
/// # Safety
/// `m` and `d` belong together; `dst` has room for `nv * nv` numbers.
pub(in crate::mujoco) unsafe fn full_mass_matrix(m: *const ffi::mjModel, d: *const ffi::mjData, dst: *mut f64) {
    // SAFETY: as the caller promises.
    unsafe { ffi::mj_fullM(m, dst, (*d).qM) }
}

/// The inertia matrix `M`, or the factor `L` of `M = L^T D L`: of each only the entries of a degree of freedom's ancestors are
/// stored, here they follow the diagonal, the nearest first.
#[derive(Debug, Clone, Copy)]
pub struct MassRows<'a> {
    values: &'a [f64],
    diagonal: &'a [i32],
}

impl<'a> MassRows<'a> {
    pub(in crate::mujoco) fn of_factor(sim: &'a Simulation) -> Self {
        Self { values: sim.qLD(), diagonal: sim.model().dof_Madr() }
    }

    pub(in crate::mujoco) fn of_inertia(sim: &'a Simulation) -> Self {
        Self { values: sim.qM(), ..Self::of_factor(sim) }
    }

    /// Entries of a degree of freedom: its diagonal one (of the factor `D`), then those for its ancestors, the nearest first; what
    /// comes after the last ancestor has no meaning, and missing ones are zero. Nothing for a degree of freedom that does not
    /// exist.
    #[inline]
    pub fn row(&self, dof: usize) -> impl Iterator<Item = f64> + use<'a> {
        let diagonal = self.diagonal.get(dof).map_or(usize::MAX, |&address| address as usize);
        self.values.get(diagonal..).unwrap_or_default().iter().copied()
    }

    /// As [`row`](Self::row), without the diagonal.
    #[inline]
    pub fn ancestors(&self, dof: usize) -> impl Iterator<Item = f64> + use<'a> {
        self.row(dof).skip(1)
    }
}

/// Row of an actuator in the Jacobian of the actuators' lengths, dense.
///
/// # Safety
/// `m` and `d` are valid and belong together, the actuator exists, and `out` has nv numbers.
pub(in crate::mujoco) unsafe fn actuator_moment(
    m: *const ffi::mjModel,
    d: *const ffi::mjData,
    actuator: usize,
    out: &mut [f64],
) {
    // SAFETY: nu rows of nv numbers.
    out.copy_from_slice(unsafe { slice((*d).actuator_moment.add(actuator * (*m).nv as usize), out.len()) });
}

// ---------------------------------------------------------------------------------------------------- contacts and rows

/// Drops the islands of the rows: here there are none.
pub(in crate::mujoco) fn forget_islands(_d: &mut ffi::mjData) {}

/// mjContact.exclude: 0 included, 1 in gap, 2 fused, 3 equality, 4 no degrees of freedom. A contact is made into rows
/// only at 0.
pub(in crate::mujoco) const EXCLUDED_BY_US: i32 = 3;

/// Contacts that fit in the list.
pub(in crate::mujoco) fn contact_capacity(m: &ffi::mjModel) -> usize {
    m.nconmax as usize
}

/// Constraint rows that fit.
pub(in crate::mujoco) fn row_capacity(m: &ffi::mjModel) -> usize {
    m.njmax as usize
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
    // SAFETY: the list holds `nconmax` contacts.
    unsafe {
        let index = (*d).ncon as usize;
        if index >= contact_capacity(&*m) {
            return false;
        }
        (*d).contact.add(index).write(*contact);
        (*d).ncon += 1;
    }
    true
}

/// Sets what is particular to this version in a contact of two geoms, whose other fields are set.
pub(in crate::mujoco) fn complete_contact(_contact: &mut ffi::mjContact) {}

/// Numbers that `efc_force` has room for; those behind the constraint rows are free.
pub(in crate::mujoco) fn force_capacity(m: &ffi::mjModel, _d: &ffi::mjData) -> usize {
    row_capacity(m)
}

/// Makes room in `efc_force` for forces of all contacts behind the rows, if that can be had.
pub(in crate::mujoco) fn extend_forces(_d: &mut ffi::mjData) {}

/// Copies what mj_copyData leaves out: nothing here.
pub(in crate::mujoco) fn complete_copy(_m: &ffi::mjModel, _from: &ffi::mjData, _to: &mut ffi::mjData) {}

/// Approximate diagonal of A.
pub(in crate::mujoco) fn efc_diagonal(d: &ffi::mjData) -> *mut f64 {
    d.efc_diagApprox
}

/// Writes a value of a sparse Jacobian to what the engine keeps besides `efc_J`: its transpose.
///
/// # Safety
/// The data has sparse rows, and this one an entry for the column.
pub(in crate::mujoco) unsafe fn mirror_sparse(d: &mut ffi::mjData, row: usize, column: usize, value: f64) {
    // SAFETY: addresses and counts are the engine's own; the transpose has an entry for every entry of a row.
    unsafe {
        let (first, rows) = (*d.efc_JT_rowadr.add(column) as usize, *d.efc_JT_rownnz.add(column) as usize);
        for k in first..first + rows {
            if *d.efc_JT_colind.add(k) as usize == row {
                *d.efc_JT.add(k) = value;
            }
        }
    }
}

// ---------------------------------------------------------------------------------------------------- arrays

#[allow(non_snake_case)] // The engine's names are the field's.
impl Simulation {
    read_arrays! { data, sizes;
        ten_J_rownnz: i32 [ntendon], "Number of non-zeros in Jacobian row";
        ten_J_rowadr: i32 [ntendon], "Row start address in colind array";
        ten_J_colind: i32 [ntendon x nv], "Column indices in sparse Jacobian";
        ten_J: f64 [ntendon x nv], "Tendon Jacobian";
        actuator_moment: f64 [nu x nv], "Actuator moments";
        qM: f64 [nM], "Total inertia (sparse)";
        qLD: f64 [nM], "L'*D*L factorization of M (sparse)";
        qLDiagSqrtInv: f64 [nv], "1/sqrt(diag(D))";
        qH: f64 [nM], "L'*D*L factorization of modified M";
        D_rownnz: i32 [nv], "Non-zeros in each row";
        D_rowadr: i32 [nv], "Address of each row in D_colind";
        D_colind: i32 [nD], "Column indices of non-zeros";
    }
}

impl CompiledModel {
    /// Springs' resting lengths: one number per tendon.
    pub fn tendon_lengthspring(&self) -> &[f64] {
        // SAFETY: the engine's own shape; lives as long as `self`, and whatever writes it takes `&mut`.
        unsafe { slice((*self.as_ptr()).tendon_lengthspring, self.ntendon()) }
    }
}
