//! Jacobians, the inertia matrix and generalized forces, in the caller's buffers.

use super::compat;
use super::error::{Error, check_index, check_length};
use super::ffi;
use super::ids::{BodyId, GeomId, Id, SiteId};
use super::kinds::Integrator;
use super::simulation::Simulation;
use nalgebra::{DMatrix, Vector3, Vector6};

impl Simulation {
    /// Jacobian of a point fixed in `body`, at `point` (world, m): `twist = J qvel`, with twist [linear; angular] in
    /// world axes. `out` is 6 x nv, row-major.
    pub fn jac_point(&self, body: BodyId, point: &Vector3<f64>, out: &mut [f64]) -> Result<(), Error> {
        let body = self.index_of(body, self.model().nbody())?;
        self.jacobian("mj_jac", out, |m, d, jacp, jacr| {
            // SAFETY: the body exists; each half of the buffer takes 3 x nv numbers.
            unsafe { ffi::mj_jac(m, d, jacp, jacr, point.as_ptr(), body) }
        })
    }

    /// As [`jac_point`](Self::jac_point), at the origin of the body's frame.
    pub fn jac_body(&self, body: BodyId, out: &mut [f64]) -> Result<(), Error> {
        let body = self.index_of(body, self.model().nbody())?;
        // SAFETY: as above.
        self.jacobian("mj_jacBody", out, |m, d, jacp, jacr| unsafe { ffi::mj_jacBody(m, d, jacp, jacr, body) })
    }

    /// As [`jac_point`](Self::jac_point), at the body's centre of mass.
    pub fn jac_body_com(&self, body: BodyId, out: &mut [f64]) -> Result<(), Error> {
        let body = self.index_of(body, self.model().nbody())?;
        // SAFETY: as above.
        self.jacobian("mj_jacBodyCom", out, |m, d, jacp, jacr| unsafe { ffi::mj_jacBodyCom(m, d, jacp, jacr, body) })
    }

    /// As [`jac_point`](Self::jac_point), at a site.
    pub fn jac_site(&self, site: SiteId, out: &mut [f64]) -> Result<(), Error> {
        let site = self.index_of(site, self.model().nsite())?;
        // SAFETY: the site exists; otherwise as above.
        self.jacobian("mj_jacSite", out, |m, d, jacp, jacr| unsafe { ffi::mj_jacSite(m, d, jacp, jacr, site) })
    }

    /// As [`jac_point`](Self::jac_point), at a geom's centre.
    pub fn jac_geom(&self, geom: GeomId, out: &mut [f64]) -> Result<(), Error> {
        let geom = self.index_of(geom, self.model().ngeom())?;
        // SAFETY: the geom exists; otherwise as above.
        self.jacobian("mj_jacGeom", out, |m, d, jacp, jacr| unsafe { ffi::mj_jacGeom(m, d, jacp, jacr, geom) })
    }

    /// [`jac_point`](Self::jac_point) as a new 6 x nv matrix.
    pub fn point_jacobian(&self, body: BodyId, point: &Vector3<f64>) -> Result<DMatrix<f64>, Error> {
        let nv = self.model().nv();
        let mut rows = vec![0.0; 6 * nv];
        self.jac_point(body, point, &mut rows)?;
        Ok(DMatrix::from_row_slice(6, nv, &rows))
    }

    fn jacobian(
        &self,
        call: &'static str,
        out: &mut [f64],
        f: impl FnOnce(*const ffi::mjModel, *const ffi::mjData, *mut f64, *mut f64),
    ) -> Result<(), Error> {
        let nv = self.model().nv();
        check_length("the buffer for a 6 x nv Jacobian", 6 * nv, out.len())?;
        let (linear, angular) = out.split_at_mut(3 * nv);
        self.query(call, |m, d| f(m, d, linear.as_mut_ptr(), angular.as_mut_ptr()))
    }

    fn index_of<I: Id>(&self, id: I, count: usize) -> Result<i32, Error> {
        check_index(I::KIND, id.index(), count)?;
        Ok(id.index() as i32)
    }

    /// `out = J v`: from generalized to constraint space (nefc), with the current rows.
    pub fn mul_constraint_jacobian(&self, v: &[f64], out: &mut [f64]) -> Result<(), Error> {
        check_length("the generalized vector", self.model().nv(), v.len())?;
        check_length("the constraint-space result", self.nefc(), out.len())?;
        if out.is_empty() {
            return Ok(());
        }
        // SAFETY: the lengths are those that the engine uses.
        self.query("mj_mulJacVec", |m, d| unsafe { ffi::mj_mulJacVec(m, d, out.as_mut_ptr(), v.as_ptr()) })
    }

    /// `out = J^T f`: from constraint space (nefc) to generalized forces, with the current rows.
    pub fn mul_constraint_jacobian_transposed(&self, f: &[f64], out: &mut [f64]) -> Result<(), Error> {
        check_length("the constraint-space vector", self.nefc(), f.len())?;
        check_length("the generalized result", self.model().nv(), out.len())?;
        if f.is_empty() {
            out.fill(0.0);
            return Ok(());
        }
        // SAFETY: the lengths are those that the engine uses.
        self.query("mj_mulJacTVec", |m, d| unsafe { ffi::mj_mulJacTVec(m, d, out.as_mut_ptr(), f.as_ptr()) })
    }

    /// The inertia matrix, nv x nv (kg, kg m, kg m^2), into `out`; it is symmetric. Valid after
    /// [`inertia`](Self::inertia).
    pub fn full_mass_matrix_into(&self, out: &mut [f64]) -> Result<(), Error> {
        let nv = self.model().nv();
        check_length("the buffer for the nv x nv inertia matrix", nv * nv, out.len())?;
        // SAFETY: the buffer takes nv x nv numbers.
        self.query("mj_fullM", |m, d| unsafe { compat::full_mass_matrix(m, d, out.as_mut_ptr()) })
    }

    /// The inertia matrix as a new matrix.
    pub fn full_mass_matrix(&self) -> Result<DMatrix<f64>, Error> {
        let nv = self.model().nv();
        let mut matrix = DMatrix::zeros(nv, nv);
        self.full_mass_matrix_into(matrix.as_mut_slice())?;
        Ok(matrix)
    }

    /// `x = M^-1 x` in place, for one or more vectors of nv numbers after each other. Valid after
    /// [`inertia`](Self::inertia).
    pub fn solve_mass(&self, x: &mut [f64]) -> Result<(), Error> {
        let nv = self.model().nv();
        if nv == 0 || !x.len().is_multiple_of(nv) {
            return check_length("the vectors to solve for (a multiple of nv)", nv, x.len());
        }
        let count = (x.len() / nv) as i32;
        let x = x.as_mut_ptr();
        // SAFETY: `count` vectors of nv numbers; the engine allows source and result to be the same.
        self.query("mj_solveM", |m, d| unsafe { ffi::mj_solveM(m, d, x, x, count) })
    }

    /// `out = M v`. Valid after [`inertia`](Self::inertia).
    pub fn mul_mass(&self, v: &[f64], out: &mut [f64]) -> Result<(), Error> {
        let nv = self.model().nv();
        check_length("the generalized vector", nv, v.len())?;
        check_length("the generalized result", nv, out.len())?;
        // SAFETY: both hold nv numbers.
        self.query("mj_mulM", |m, d| unsafe { ffi::mj_mulM(m, d, out.as_mut_ptr(), v.as_ptr()) })
    }

    /// Ends a solve whose row forces (`efc_force`) are given, in the place of [`constraint`](Self::constraint): with
    /// `extra` (nv), generalized forces of constraints that have no rows, they make qfrc_constraint and qacc.
    pub fn impose_constraint_forces(&mut self, extra: &[f64]) -> Result<(), Error> {
        self.impose_forces(extra, true)
    }

    /// As [`impose_constraint_forces`](Self::impose_constraint_forces); qacc only where the integrator reads it.
    pub(crate) fn impose_forces_to_integrate(&mut self, extra: &[f64]) -> Result<(), Error> {
        self.impose_forces(extra, !self.integrates_forces())
    }

    /// Whether the integrator takes forces, and makes accelerations of its own of them: Euler with damping does.
    fn integrates_forces(&self) -> bool {
        let model = self.model();
        let explicit = compat::EULER_DAMPING.is_some_and(|flag| model.disable_flags() & flag != 0);
        model.integrator() == Integrator::Euler && !explicit && model.dof_damping().iter().any(|&d| d > 0.0)
    }

    fn impose_forces(&mut self, extra: &[f64], accelerate: bool) -> Result<(), Error> {
        check_length("the generalized force", self.model().nv(), extra.len())?;
        let data = self.data();
        let (total, acceleration, smooth, warm) =
            (data.qfrc_constraint, data.qacc, data.qacc_smooth, data.qacc_warmstart);
        let (rows, forces, nv) = (self.nefc(), data.efc_force, extra.len());
        // SAFETY: arrays of nv numbers that belong to the data, do not overlap each other or `extra`, and are not
        // borrowed otherwise, as `self` is exclusive; the engine allows source and result of mj_solveM to be the same.
        self.query("mj_mulJacTVec, mj_solveM", |m, d| unsafe {
            if rows > 0 {
                ffi::mj_mulJacTVec(m, d, total, forces);
            } else {
                total.write_bytes(0, nv);
            }
            for (i, extra) in extra.iter().enumerate() {
                *total.add(i) += extra;
            }
            if !accelerate {
                return;
            }
            ffi::mj_solveM(m, d, acceleration, total, 1);
            for i in 0..nv {
                *acceleration.add(i) += *smooth.add(i);
            }
            warm.copy_from_nonoverlapping(acceleration, nv);
        })
    }

    /// Sets the wrench that acts on a body from now on: force (N) at its centre of mass and torque (N m), world axes.
    pub fn set_body_wrench(&mut self, body: BodyId, force: &Vector3<f64>, torque: &Vector3<f64>) -> Result<(), Error> {
        check_index(BodyId::KIND, body.index(), self.model().nbody())?;
        let wrench = &mut self.xfrc_applied_mut()[6 * body.index()..6 * body.index() + 6];
        wrench[..3].copy_from_slice(force.as_slice());
        wrench[3..].copy_from_slice(torque.as_slice());
        Ok(())
    }

    /// The wrench set with [`set_body_wrench`](Self::set_body_wrench), [force; torque].
    pub fn body_wrench(&self, body: BodyId) -> Result<Vector6<f64>, Error> {
        check_index(BodyId::KIND, body.index(), self.model().nbody())?;
        Ok(Vector6::from_column_slice(&self.xfrc_applied()[6 * body.index()..6 * body.index() + 6]))
    }

    /// Removes the wrenches from all bodies.
    pub fn clear_body_wrenches(&mut self) {
        self.xfrc_applied_mut().fill(0.0);
    }

    /// Adds, to `target` (nv), the generalized force of a force (N) at `point` (m) and a torque (N m) on a body; world
    /// axes.
    pub fn add_generalized_force(
        &self,
        body: BodyId,
        force: &Vector3<f64>,
        torque: &Vector3<f64>,
        point: &Vector3<f64>,
        target: &mut [f64],
    ) -> Result<(), Error> {
        let body = self.index_of(body, self.model().nbody())?;
        check_length("the generalized force", self.model().nv(), target.len())?;
        self.query("mj_applyFT", |m, d| {
            let (force, torque, point) = (force.as_ptr(), torque.as_ptr(), point.as_ptr());
            // SAFETY: the body exists, vectors of three, and nv numbers to add to; the stack is left as found.
            unsafe { ffi::mj_applyFT(m, d, force, torque, point, body, target.as_mut_ptr()) }
        })
    }

    /// Adds a force (N) at `point` (m) and a torque (N m) on a body to the generalized forces (`qfrc_applied`) that act
    /// from now on; world axes. They do not follow the body.
    pub fn apply_force_at(
        &mut self,
        body: BodyId,
        force: &Vector3<f64>,
        torque: &Vector3<f64>,
        point: &Vector3<f64>,
    ) -> Result<(), Error> {
        let body = self.index_of(body, self.model().nbody())?;
        self.query("mj_applyFT", |m, d| {
            let (force, torque, point) = (force.as_ptr(), torque.as_ptr(), point.as_ptr());
            // SAFETY: as above; the target is the data's own array of nv numbers, and `&mut self` is exclusive.
            unsafe { ffi::mj_applyFT(m, d, force, torque, point, body, (*d).qfrc_applied) }
        })
    }
}
