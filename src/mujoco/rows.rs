//! Reading and rewriting constraint rows, between [`make_constraint`](Simulation::make_constraint) and the solve.
//!
//! Rows are ordered: `ne` equality rows, `nf` friction rows, then limits and contacts. A friction row's force is bounded
//! by its own `frictionloss`, row by row, so turning the last equality rows into friction rows gives an equality with
//! force limits. The engine reads a friction row's type and id only while it makes the rows (engine_core_constraint.c
//! and engine_solver.c of 2.2.2), so rewritten rows are as good as made ones, until the next `make_constraint`.

use super::arrays::slice;
use super::compat;
use super::error::{Error, check_index, check_length, check_value};
use super::ffi;
use super::ids::EqualityId;
use super::kinds::{JointKind, RowKind, RowState};
use super::simulation::Simulation;
use std::ops::Range;

/// One constraint row's identity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConstraintRow {
    /// Its type.
    pub kind: RowKind,
    /// The equality constraint, degree of freedom, joint, tendon or contact that it belongs to. A friction row made of
    /// an equality row keeps the equality constraint's number.
    pub id: usize,
}

impl Simulation {
    /// Identity of a row.
    pub fn constraint_row(&self, row: usize) -> Result<ConstraintRow, Error> {
        self.check_row(row)?;
        Ok(ConstraintRow { kind: RowKind::from_raw(self.efc_type()[row]), id: self.efc_id()[row] as usize })
    }

    /// What a row did in the last solve.
    pub fn row_state(&self, row: usize) -> Result<RowState, Error> {
        self.check_row(row)?;
        Ok(RowState::from_raw(self.efc_state()[row]))
    }

    /// The rows of an equality constraint; `None` if it has none (switched off, or nothing can move).
    pub fn equality_rows(&self, id: EqualityId) -> Option<Range<usize>> {
        let ids = &self.efc_id()[..self.ne()];
        let belongs = |row_id: &i32| usize::try_from(*row_id) == Ok(id.index());
        let first = ids.iter().position(belongs)?;
        let count = ids[first..].iter().take_while(|row_id| belongs(row_id)).count();
        Some(first..first + count)
    }

    /// Turns the last `count` equality rows into friction rows with friction limits of zero, and returns them. Set the
    /// limits with [`set_row_friction_limit`](Self::set_row_friction_limit).
    pub fn make_friction_rows(&mut self, count: usize) -> Result<Range<usize>, Error> {
        let ne = self.ne();
        if count > ne {
            return Err(Error::OutOfRange { kind: "equality row", index: count, count: ne });
        }
        let rows = ne - count..ne;
        let data = self.data_mut();
        compat::forget_islands(data);
        data.ne -= count as i32;
        data.nf += count as i32;
        for row in rows.clone() {
            // SAFETY: `row < nefc`, and both arrays have at least that many elements. The id stays: it is read only
            // for rows that are being made.
            unsafe {
                *data.efc_type.add(row) = ffi::mjCNSTR_FRICTION_DOF as i32;
                *data.efc_frictionloss.add(row) = 0.0;
            }
        }
        Ok(rows)
    }

    /// Sets the largest force of a friction row, in the row's unit; zero or more.
    pub fn set_row_friction_limit(&mut self, row: usize, limit: f64) -> Result<(), Error> {
        self.edit_row(row)?;
        let friction = self.ne()..self.ne() + self.nf();
        if !friction.contains(&row) {
            return Err(Error::Unsupported(format!(
                "constraint row {row} has no friction limit: the friction rows are {friction:?}"
            )));
        }
        check_value("the friction limit", limit, "finite and zero or more", |limit| limit >= 0.0)?;
        // SAFETY: `row < nefc`.
        unsafe { *self.data_mut().efc_frictionloss.add(row) = limit };
        Ok(())
    }

    /// Sets the position error of a row (in the row's unit), from which the reference acceleration is computed in the
    /// velocity stage: aref = -B J qvel - K I (pos - margin).
    pub fn set_row_position(&mut self, row: usize, position: f64) -> Result<(), Error> {
        self.edit_row(row)?;
        check_value("the position error", position, "finite", |_| true)?;
        // SAFETY: `row < nefc`.
        unsafe { *self.data_mut().efc_pos.add(row) = position };
        Ok(())
    }

    /// Sets stiffness K, damping B, impedance I and its derivative P of a row.
    pub fn set_row_kbip(&mut self, row: usize, kbip: [f64; 4]) -> Result<(), Error> {
        self.edit_row(row)?;
        for value in kbip {
            check_value("a row's stiffness, damping or impedance", value, "finite", |_| true)?;
        }
        // SAFETY: `row < nefc`, four numbers per row.
        unsafe { self.data_mut().efc_KBIP.add(4 * row).cast::<[f64; 4]>().write_unaligned(kbip) };
        Ok(())
    }

    /// Sets the regularization R of a row, and D = 1/R with it; more than zero. Not for a contact's rows, whose ratios
    /// the engine relies on.
    pub fn set_row_regularization(&mut self, row: usize, r: f64) -> Result<(), Error> {
        self.edit_row(row)?;
        check_value("the regularization", r, "finite and more than zero", |r| r > 0.0 && (1.0 / r).is_finite())?;
        let data = self.data_mut();
        // SAFETY: `row < nefc`.
        unsafe {
            *data.efc_R.add(row) = r;
            *data.efc_D.add(row) = 1.0 / r;
            // The engine keeps R = (1 - I)/I diagApprox.
            let impedance = *data.efc_KBIP.add(4 * row + 2);
            *compat::efc_diagonal(data).add(row) = r * impedance / (1.0 - impedance);
        }
        Ok(())
    }

    /// Sets the reference acceleration of a row; to be called after the velocity stage, which computes it.
    pub fn set_row_reference(&mut self, row: usize, aref: f64) -> Result<(), Error> {
        self.edit_row(row)?;
        check_value("the reference acceleration", aref, "finite", |_| true)?;
        // SAFETY: `row < nefc`.
        unsafe { *self.data_mut().efc_aref.add(row) = aref };
        Ok(())
    }

    /// The Jacobian of a row, dense, into `out` (nv).
    pub fn row_jacobian(&self, row: usize, out: &mut [f64]) -> Result<(), Error> {
        self.check_row(row)?;
        let nv = self.model().nv();
        check_length("the buffer for a row of nv numbers", nv, out.len())?;
        let data = self.data();
        if !self.model().is_sparse() {
            // SAFETY: `row < nefc` rows of nv numbers.
            out.copy_from_slice(unsafe { slice(data.efc_J.add(row * nv), nv) });
            return Ok(());
        }
        out.fill(0.0);
        let (values, columns) = self.sparse_row(row);
        for (value, column) in values.iter().zip(columns) {
            out[*column as usize] = *value;
        }
        Ok(())
    }

    /// Degree of freedom and entry of a row whose Jacobian has no other: friction of a degree of freedom, limit of a hinge or
    /// slide. `None` of any other row. Not for rows of [`make_friction_rows`](Self::make_friction_rows), which pass for
    /// friction of a degree of freedom.
    pub(crate) fn row_single_entry(&self, row: usize) -> Result<Option<(usize, f64)>, Error> {
        let ConstraintRow { kind, id } = self.constraint_row(row)?;
        let model = self.model();
        let dof = match kind {
            RowKind::FrictionDof => id,
            RowKind::LimitJoint => {
                let hinge_or_slide = [JointKind::Hinge.raw(), JointKind::Slide.raw()];
                match model.jnt_type().get(id) {
                    Some(kind) if hinge_or_slide.contains(kind) => model.jnt_dofadr()[id] as usize,
                    _ => return Ok(None),
                }
            }
            _ => return Ok(None),
        };
        if !model.is_sparse() {
            // SAFETY: `row < nefc` rows of nv numbers.
            let values = unsafe { slice(self.data().efc_J.add(row * model.nv()), model.nv()) };
            return Ok(values.get(dof).map(|&value| (dof, value)));
        }
        let (values, columns) = self.sparse_row(row);
        Ok(if let ([value], [column]) = (values, columns) { Some((*column as usize, *value)) } else { None })
    }

    /// Replaces the Jacobian of a row by `jacobian` (nv, dense). With sparse storage the non-zeros must be among the
    /// row's own columns (for a weld: all degrees of freedom that move either body).
    pub fn set_row_jacobian(&mut self, row: usize, jacobian: &[f64]) -> Result<(), Error> {
        self.edit_row(row)?;
        let nv = self.model().nv();
        check_length("the row's Jacobian", nv, jacobian.len())?;
        if let Some(&bad) = jacobian.iter().find(|value| !value.is_finite()) {
            return check_value("an element of the row's Jacobian", bad, "finite", |_| true);
        }
        if !self.model().is_sparse() {
            // SAFETY: `row < nefc` rows of nv numbers, apart from the caller's.
            unsafe { self.data_mut().efc_J.add(row * nv).copy_from_nonoverlapping(jacobian.as_ptr(), nv) };
            return Ok(());
        }
        self.set_sparse_row(row, jacobian)
    }

    fn set_sparse_row(&mut self, row: usize, jacobian: &[f64]) -> Result<(), Error> {
        let (_, columns) = self.sparse_row(row);
        let held = columns.iter().filter(|column| jacobian[**column as usize] != 0.0).count();
        if held < jacobian.iter().filter(|value| **value != 0.0).count() {
            return Err(Error::Unsupported(format!(
                "the new Jacobian of constraint row {row} has non-zeros outside the row's columns {columns:?}"
            )));
        }
        let data = self.data_mut();
        // SAFETY: row addresses, counts and column indices are the engine's own, made for the current rows.
        unsafe {
            let (start, count) = (*data.efc_J_rowadr.add(row) as usize, *data.efc_J_rownnz.add(row) as usize);
            for k in start..start + count {
                let column = *data.efc_J_colind.add(k) as usize;
                *data.efc_J.add(k) = jacobian[column];
                compat::mirror_sparse(data, row, column, jacobian[column]);
            }
        }
        Ok(())
    }

    /// Values and columns of a row in sparse storage. The row must exist.
    fn sparse_row(&self, row: usize) -> (&[f64], &[i32]) {
        let data = self.data();
        // SAFETY: `row < nefc`; address and count are the engine's own.
        unsafe {
            let (start, count) = (*data.efc_J_rowadr.add(row) as usize, *data.efc_J_rownnz.add(row) as usize);
            (slice(data.efc_J.add(start), count), slice(data.efc_J_colind.add(start), count))
        }
    }

    /// Before a row is changed: the engine's islands hold copies of rows, so the next solve goes without islands.
    fn edit_row(&mut self, row: usize) -> Result<(), Error> {
        self.check_row(row)?;
        compat::forget_islands(self.data_mut());
        Ok(())
    }

    fn check_row(&self, row: usize) -> Result<(), Error> {
        check_index("constraint row", row, self.nefc())
    }
}
