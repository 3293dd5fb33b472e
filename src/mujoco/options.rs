//! Physics options: read from any model, set on a simulation's own.

use super::compat;
use super::compiled::CompiledModel;
use super::error::{Error, check_value};
use super::ffi;
use super::ids::{BodyId, EqualityId, GeomId, JointId};
use super::kinds::*;
use super::simulation::Simulation;
use nalgebra::Vector3;

impl CompiledModel {
    fn options(&self) -> &ffi::mjOption {
        // SAFETY: the pointer is valid for as long as `self`.
        unsafe { &(*self.as_ptr()).opt }
    }

    /// Time step, s.
    pub fn timestep(&self) -> f64 {
        self.options().timestep
    }

    /// Gravitational acceleration, m/s^2, world axes.
    pub fn gravity(&self) -> Vector3<f64> {
        self.options().gravity.into()
    }

    /// The integrator.
    pub fn integrator(&self) -> Integrator {
        Integrator::from_raw(self.options().integrator)
    }

    /// The friction cone's shape.
    pub fn cone(&self) -> Cone {
        Cone::from_raw(self.options().cone)
    }

    /// The constraint solver.
    pub fn solver(&self) -> Solver {
        Solver::from_raw(self.options().solver)
    }

    /// The storage asked for; see [`is_sparse`](Self::is_sparse) for the one in use.
    pub fn jacobian_storage(&self) -> JacobianStorage {
        JacobianStorage::from_raw(self.options().jacobian)
    }

    /// Whether the constraint Jacobian is stored sparse.
    pub fn is_sparse(&self) -> bool {
        // SAFETY: only reads the model.
        unsafe { ffi::mj_isSparse(self.as_ptr()) != 0 }
    }

    /// The solver's iterations at most.
    pub fn iterations(&self) -> usize {
        self.options().iterations.max(0) as usize
    }

    /// The solver's tolerance.
    pub fn tolerance(&self) -> f64 {
        self.options().tolerance
    }

    /// Iterations of the noslip solver; 0 for none.
    pub fn noslip_iterations(&self) -> usize {
        self.options().noslip_iterations.max(0) as usize
    }

    /// Ratio of friction to normal impedance of elliptic contacts.
    pub fn impratio(&self) -> f64 {
        self.options().impratio
    }

    /// Disabled features (mjtDisableBit).
    pub fn disable_flags(&self) -> u32 {
        self.options().disableflags as u32
    }

    /// Enabled features (mjtEnableBit).
    pub fn enable_flags(&self) -> u32 {
        self.options().enableflags as u32
    }

    /// Whether constraints are solved island by island (MuJoCo 3, unless the `island` flag disables it).
    pub fn has_islands(&self) -> bool {
        compat::ISLAND.is_some_and(|flag| self.disable_flags() & flag == 0)
    }

    /// Whether parts of the model that are at rest may sleep (MuJoCo 3, if the `sleep` flag enables it).
    pub fn has_sleeping(&self) -> bool {
        compat::SLEEP.is_some_and(|flag| self.enable_flags() & flag != 0)
    }

    /// Whether gravity is switched on.
    pub fn has_gravity(&self) -> bool {
        self.disable_flags() & ffi::mjDSBL_GRAVITY == 0
    }

    /// Whether contacts are switched on.
    pub fn has_contacts(&self) -> bool {
        self.disable_flags() & (ffi::mjDSBL_CONTACT | ffi::mjDSBL_CONSTRAINT) == 0
    }

    /// Whether [`contact_override`](Self::contact_override) replaces every contact's own parameters.
    pub fn overrides_contacts(&self) -> bool {
        self.enable_flags() & ffi::mjENBL_OVERRIDE != 0
    }

    /// Margin, solref and solimp of the contact override (o_margin, o_solref, o_solimp).
    pub fn contact_override(&self) -> (f64, [f64; 2], [f64; 5]) {
        let options = self.options();
        (options.o_margin, options.o_solref, options.o_solimp)
    }

    /// Mean diagonal inertia at the initial configuration (stat.meaninertia), with which the solver scales costs.
    pub fn mean_inertia(&self) -> f64 {
        // SAFETY: the pointer is valid for as long as `self`.
        unsafe { (*self.as_ptr()).stat.meaninertia }
    }

    /// Type of a joint; `None` if it does not exist.
    pub fn joint_kind(&self, id: JointId) -> Option<JointKind> {
        self.jnt_type().get(id.index()).copied().map(JointKind::from_raw)
    }

    /// Shape of a geom; `None` if it does not exist.
    pub fn geom_kind(&self, id: GeomId) -> Option<GeomKind> {
        self.geom_type().get(id.index()).copied().map(GeomKind::from_raw)
    }

    /// Type of an equality constraint; `None` if it does not exist.
    pub fn equality_kind(&self, id: EqualityId) -> Option<EqualityKind> {
        self.eq_type().get(id.index()).copied().map(EqualityKind::from_raw)
    }

    /// The two bodies of a connect or weld, or those of its sites (the second may be the world); `None` for other
    /// constraints.
    pub fn equality_bodies(&self, id: EqualityId) -> Option<[BodyId; 2]> {
        let kind = self.equality_kind(id)?;
        if !matches!(kind, EqualityKind::Connect | EqualityKind::Weld) {
            return None;
        }
        let body = |object: i32| {
            // SAFETY: the equality exists, and these are its objects.
            let body = unsafe { compat::equality_body(&*self.as_ptr(), id.index(), object) };
            BodyId::from_index(body.max(0) as usize)
        };
        Some([self.eq_obj1id(), self.eq_obj2id()].map(|ids| body(ids[id.index()])))
    }
}

impl Simulation {
    fn options_mut(&mut self) -> &mut ffi::mjOption {
        &mut self.model_fields_mut().opt
    }

    /// Sets the time step, s; more than zero.
    pub fn set_timestep(&mut self, timestep: f64) -> Result<(), Error> {
        check_value("the time step", timestep, "finite and more than zero", |h| h > 0.0)?;
        self.options_mut().timestep = timestep;
        Ok(())
    }

    /// Sets gravity, m/s^2, world axes.
    pub fn set_gravity(&mut self, gravity: Vector3<f64>) -> Result<(), Error> {
        for value in gravity.iter() {
            check_value("gravity", *value, "finite", |_| true)?;
        }
        // read anew in every step, like a force
        self.note_input();
        let (model, _) = self.pointers();
        // SAFETY: valid for as long as `self`, and exclusive.
        unsafe { (*model).opt.gravity = gravity.into() };
        Ok(())
    }

    /// Sets the integrator.
    pub fn set_integrator(&mut self, integrator: Integrator) -> Result<(), Error> {
        let unknown = matches!(integrator, Integrator::Other(_)) || !compat::has_integrator(integrator.raw());
        self.options_mut().integrator = known(integrator.raw(), unknown, "integrator")?;
        Ok(())
    }

    /// Sets the friction cone's shape. The current contacts and constraint rows are dropped.
    pub fn set_cone(&mut self, cone: Cone) -> Result<(), Error> {
        self.options_mut().cone = known(cone.raw(), matches!(cone, Cone::Other(_)), "friction cone")?;
        self.forget_contacts();
        Ok(())
    }

    /// Sets the constraint solver. The current contacts and constraint rows are dropped.
    pub fn set_solver(&mut self, solver: Solver) -> Result<(), Error> {
        self.options_mut().solver = known(solver.raw(), matches!(solver, Solver::Other(_)), "solver")?;
        self.forget_contacts();
        Ok(())
    }

    /// Sets the storage of the constraint Jacobian. The current contacts and constraint rows are dropped.
    pub fn set_jacobian_storage(&mut self, storage: JacobianStorage) -> Result<(), Error> {
        let unknown = matches!(storage, JacobianStorage::Other(_));
        self.options_mut().jacobian = known(storage.raw(), unknown, "Jacobian storage")?;
        self.forget_contacts();
        Ok(())
    }

    /// Sets the solver's iterations at most; one at least, and no more than the engine keeps statistics of (1000).
    pub fn set_iterations(&mut self, iterations: usize) -> Result<(), Error> {
        self.options_mut().iterations = count("the number of solver iterations", iterations, 1)?;
        Ok(())
    }

    /// Sets the iterations of the noslip solver; 0 for none. The current contacts and constraint rows are dropped.
    pub fn set_noslip_iterations(&mut self, iterations: usize) -> Result<(), Error> {
        self.options_mut().noslip_iterations = count("the number of noslip iterations", iterations, 0)?;
        self.forget_contacts();
        Ok(())
    }

    /// Sets the solver's tolerance; zero or more.
    pub fn set_tolerance(&mut self, tolerance: f64) -> Result<(), Error> {
        check_value("the solver tolerance", tolerance, "finite and zero or more", |t| t >= 0.0)?;
        self.options_mut().tolerance = tolerance;
        Ok(())
    }

    /// Sets the improvement per iteration at which the noslip solver stops; zero or more.
    pub fn set_noslip_tolerance(&mut self, tolerance: f64) -> Result<(), Error> {
        check_value("the noslip tolerance", tolerance, "finite and zero or more", |t| t >= 0.0)?;
        self.options_mut().noslip_tolerance = tolerance;
        Ok(())
    }

    /// Sets the ratio of friction to normal impedance of elliptic contacts; more than zero.
    pub fn set_impratio(&mut self, impratio: f64) -> Result<(), Error> {
        check_value("impratio", impratio, "finite and more than zero", |r| r > 0.0)?;
        self.options_mut().impratio = impratio;
        Ok(())
    }

    /// Switches contacts on or off (the `contact` flag). The current ones are dropped.
    pub fn set_contacts_enabled(&mut self, enabled: bool) {
        self.set_disabled(ffi::mjDSBL_CONTACT, !enabled);
        self.forget_contacts();
    }

    /// Switches gravity on or off (the `gravity` flag).
    pub fn set_gravity_enabled(&mut self, enabled: bool) {
        self.set_disabled(ffi::mjDSBL_GRAVITY, !enabled);
    }

    /// Switches the solver's warm start on or off (the `warmstart` flag).
    pub fn set_warmstart_enabled(&mut self, enabled: bool) {
        self.set_disabled(ffi::mjDSBL_WARMSTART, !enabled);
    }

    /// Switches the computation of energies in a step on or off (the `energy` flag).
    pub fn set_energy_enabled(&mut self, enabled: bool) {
        let flags = &mut self.options_mut().enableflags;
        let bit = ffi::mjENBL_ENERGY as i32;
        *flags = if enabled { *flags | bit } else { *flags & !bit };
    }

    /// Runs `work` with islands and sleeping switched off; the user's flags are back afterwards. What sleeps is woken by
    /// the next [`kinematics`](Self::kinematics), as the engine does itself when sleeping is switched off.
    pub(crate) fn without_islands<R>(&mut self, work: impl FnOnce(&mut Self) -> R) -> R {
        let options = self.options_mut();
        let flags = (options.disableflags, options.enableflags);
        options.disableflags |= compat::ISLAND.unwrap_or(0) as i32;
        options.enableflags &= !(compat::SLEEP.unwrap_or(0) as i32);
        let result = work(self);
        let options = self.options_mut();
        (options.disableflags, options.enableflags) = flags;
        result
    }

    fn set_disabled(&mut self, bit: u32, disabled: bool) {
        let flags = &mut self.options_mut().disableflags;
        let bit = bit as i32;
        *flags = if disabled { *flags | bit } else { *flags & !bit };
    }
}

fn known(raw: i32, unknown: bool, what: &'static str) -> Result<i32, Error> {
    if unknown {
        Err(Error::Unsupported(format!("MuJoCo {} has no {what} number {raw}", compat::header_version())))
    } else {
        Ok(raw)
    }
}

fn count(what: &'static str, value: usize, least: usize) -> Result<i32, Error> {
    const MOST: usize = 1000; // Of these 2.2.2 keeps statistics.
    let rule = if least == 0 { "from 0 to 1000" } else { "from 1 to 1000" };
    match i32::try_from(value) {
        Ok(number) if (least..=MOST).contains(&value) => Ok(number),
        _ => Err(Error::Value { what, value: value as f64, rule }),
    }
}
