//! The inertia matrix, and the arrays that are stored in other shapes than in 2.2.2.

use crate::mujoco::arrays::{factor, read_arrays, slice};
use crate::mujoco::compiled::CompiledModel;
use crate::mujoco::ffi;
use crate::mujoco::simulation::Simulation;

/// The inertia matrix, dense.
///
/// # Safety
/// `m` and `d` belong together; `dst` has room for `nv * nv` numbers.
pub(in crate::mujoco) unsafe fn full_mass_matrix(m: *const ffi::mjModel, d: *const ffi::mjData, dst: *mut f64) {
    // SAFETY: as the caller promises; `M` has the rows of the lower triangle, whose columns are the engine's own.
    unsafe {
        let nv = (*m).nv as usize;
        dst.write_bytes(0, nv * nv);
        for row in 0..nv {
            let start = *(*m).M_rowadr.add(row) as usize;
            for k in start..start + *(*m).M_rownnz.add(row) as usize {
                let column = *(*m).M_colind.add(k) as usize;
                *dst.add(row * nv + column) = *(*d).M.add(k);
                *dst.add(column * nv + row) = *(*d).M.add(k);
            }
        }
    }
}

/// The inertia matrix `M`, or the factor `L` of `M = L^T D L`: of each only the entries of a degree of freedom's ancestors are
/// stored, here in compressed rows that end with the diagonal, the nearest ancestor before it.
#[derive(Debug, Clone, Copy)]
pub struct MassRows<'a> {
    values: &'a [f64],
    start: &'a [i32],
    count: &'a [i32],
}

impl<'a> MassRows<'a> {
    pub(in crate::mujoco) fn of_factor(sim: &'a Simulation) -> Self {
        Self { values: sim.qLD(), start: sim.model().M_rowadr(), count: sim.model().M_rownnz() }
    }

    pub(in crate::mujoco) fn of_inertia(sim: &'a Simulation) -> Self {
        Self { values: sim.M(), ..Self::of_factor(sim) }
    }

    /// Entries of a degree of freedom: its diagonal one (of the factor `D`), then those for its ancestors, the nearest first; what
    /// comes after the last ancestor has no meaning, and missing ones are zero. Nothing for a degree of freedom that does not
    /// exist.
    #[inline]
    pub fn row(&self, dof: usize) -> impl Iterator<Item = f64> + use<'a> {
        let row = self.start.get(dof).zip(self.count.get(dof)).map(|(&start, &count)| (start as usize, count as usize));
        let entries = row.and_then(|(start, count)| self.values.get(start..start + count));
        entries.unwrap_or_default().iter().rev().copied()
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

#[allow(non_snake_case)] // The engine's names are the field's.
impl Simulation {
    read_arrays! { data, sizes;
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
        M_rownnz: i32 [nv], "Reduced inertia: non-zeros in each row";
        M_rowadr: i32 [nv], "Reduced inertia: row addresses";
        M_colind: i32 [nC], "Reduced inertia: column indices";
        D_rownnz: i32 [nv], "Full inertia: non-zeros in each row";
        D_rowadr: i32 [nv], "Full inertia: row addresses";
        D_colind: i32 [nD], "Full inertia: column indices";
    }
}

#[cfg(mj_sparse_tendons)]
#[allow(non_snake_case)] // As above.
impl Simulation {
    read_arrays! { data, sizes;
        ten_J: f64 [nJten], "Tendon Jacobian (sparse)";
    }
}

#[cfg(mj_sparse_tendons)]
#[allow(non_snake_case)] // As above.
impl CompiledModel {
    read_arrays! { model_fields, model_fields;
        ten_J_rownnz: i32 [ntendon], "Number of non-zeros in Jacobian row";
        ten_J_rowadr: i32 [ntendon], "Row start address in colind array";
        ten_J_colind: i32 [nJten], "Column indices in sparse Jacobian";
    }
}

#[cfg(not(mj_sparse_tendons))]
#[allow(non_snake_case)] // As above.
impl Simulation {
    read_arrays! { data, sizes;
        ten_J_rownnz: i32 [ntendon], "Number of non-zeros in Jacobian row";
        ten_J_rowadr: i32 [ntendon], "Row start address in colind array";
        ten_J_colind: i32 [ntendon x nv], "Column indices in sparse Jacobian";
        ten_J: f64 [ntendon x nv], "Tendon Jacobian";
    }
}
