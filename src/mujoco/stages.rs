//! One step, whole or in its parts.
//!
//! MuJoCo's step is, in this order (engine_forward.c of 2.2.2):
//!
//! | part | methods |
//! |---|---|
//! | checks | [`check_pos`](Simulation::check_pos), [`check_vel`](Simulation::check_vel) |
//! | position | [`kinematics`](Simulation::kinematics), [`inertia`](Simulation::inertia), [`collision`](Simulation::collision), [`make_constraint`](Simulation::make_constraint), [`transmission`](Simulation::transmission), [`project_constraint`](Simulation::project_constraint) |
//! | | [`sensor_pos`](Simulation::sensor_pos), [`energy_pos`](Simulation::energy_pos) if enabled |
//! | velocity | [`velocity`](Simulation::velocity), [`sensor_vel`](Simulation::sensor_vel), [`energy_vel`](Simulation::energy_vel) if enabled |
//! | forces | [`actuation`](Simulation::actuation), [`acceleration`](Simulation::acceleration), [`constraint`](Simulation::constraint), [`sensor_acc`](Simulation::sensor_acc) |
//! | integration | [`check_acc`](Simulation::check_acc), [`integrate`](Simulation::integrate) |
//!
//! Run in that order they give [`step`](Simulation::step) bit for bit, where the model has neither islands nor sleeping
//! (MuJoCo 3), which have stages that the engine does not publish. Each method returns the fault, if any, and what the
//! engine silently did meanwhile: [`Error::BufferFull`], [`Error::Diverged`], [`Error::BadControl`].

use super::compat;
use super::error::Error;
use super::ffi;
use super::kinds::Integrator;
use super::simulation::Simulation;

macro_rules! stages {
    ($($(#[$doc:meta])* $name:ident = $($function:ident)+;)*) => { $(
        $(#[$doc])*
        pub fn $name(&mut self) -> Result<(), Error> {
            self.run(concat!($(stringify!($function), " "),+).trim_ascii_end(), |m, d| {
                // SAFETY: model and data belong together.
                unsafe { $(ffi::$function(m, d);)+ }
            })
        }
    )* };
}

impl Simulation {
    stages! {
        /// One time step (mj_step). On [`Error::BufferFull`] and [`Error::BadControl`] the step was made, without
        /// what was dropped; on [`Error::Diverged`] it was made from the initial configuration.
        step = mj_step;
        /// The first half of a step, before forces and controls are set (mj_step1).
        step1 = mj_step1;
        /// Everything but the integration (mj_forward): all quantities for the current state.
        forward = mj_forward;

        /// Resets the simulation and reports it if a position is bad.
        check_pos = mj_checkPos;
        /// Resets the simulation and reports it if a velocity is bad.
        check_vel = mj_checkVel;
        /// Resets the simulation and reports it if an acceleration is bad.
        check_acc = mj_checkAcc;
        /// The whole position stage, without sensors and energy (mj_fwdPosition).
        position = mj_fwdPosition;
        /// Actuator lengths and moments.
        transmission = mj_transmission;
        /// The matrix of the dual solvers; nothing for CG and Newton without noslip.
        project_constraint = mj_projectConstraint;
        /// Velocity and reference acceleration of the constraint rows; part of [`velocity`](Self::velocity).
        reference_constraint = mj_referenceConstraint;
        /// Sensors that depend on positions.
        sensor_pos = mj_sensorPos;
        /// Potential energy; does nothing without the `energy` flag.
        energy_pos = mj_energyPos;
        /// Velocities, passive and bias forces, and the constraint rows' reference acceleration.
        velocity = mj_fwdVelocity;
        /// Sensors that depend on velocities.
        sensor_vel = mj_sensorVel;
        /// Kinetic energy; does nothing without the `energy` flag.
        energy_vel = mj_energyVel;
        /// Actuator forces.
        actuation = mj_fwdActuation;
        /// The sum of all forces but the constraints', and the acceleration that it gives.
        acceleration = mj_fwdAcceleration;
        /// Semi-implicit Euler integration.
        euler = mj_Euler;
        /// Accelerations and interaction forces of all bodies (cacc, cfrc_int, cfrc_ext).
        rne_post_constraint = mj_rnePostConstraint;
        /// Compares forward with inverse dynamics (a step does, if `fwdinv` is enabled).
        compare_forward_inverse = mj_compareFwdInv;
    }

    /// Poses of everything, centres of mass, tendons.
    pub fn kinematics(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.run("mj_kinematics", |m, d| unsafe { compat::kinematics(m, d) })
    }

    /// The inertia matrix and its factorization.
    pub fn inertia(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.run("mj_factorM", |m, d| unsafe { compat::inertia(m, d) })
    }

    /// The second half of a step (mj_step2); an RK4 model is integrated with Euler.
    pub fn step2(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.run("mj_step2", |m, d| unsafe {
            compat::before_solver(m, d);
            ffi::mj_step2(m, d);
        })
    }

    /// The constraint solver: efc_force, qfrc_constraint, qacc.
    pub fn constraint(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.run("mj_fwdConstraint", |m, d| unsafe {
            compat::before_solver(m, d);
            ffi::mj_fwdConstraint(m, d);
        })
    }

    /// Sensors that depend on accelerations and forces.
    pub fn sensor_acc(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.run("mj_sensorAcc", |m, d| unsafe { compat::sensor_acc(m, d) })
    }

    /// Collision detection: fills the contacts. The previous constraint rows are dropped, as they refer to the
    /// previous contacts.
    pub fn collision(&mut self) -> Result<(), Error> {
        self.forget_rows();
        // SAFETY: model and data belong together.
        self.run("mj_collision", |m, d| unsafe { ffi::mj_collision(m, d) })
    }

    /// Makes the constraint rows from equality constraints, friction losses, limits and contacts.
    pub fn make_constraint(&mut self) -> Result<(), Error> {
        self.forget_rows();
        // SAFETY: model and data belong together.
        self.run("mj_makeConstraint", |m, d| unsafe { ffi::mj_makeConstraint(m, d) })
    }

    /// Integration that is implicit in velocity.
    pub fn implicit(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.run("mj_implicit", |m, d| unsafe { compat::mj_implicit(m, d) })
    }

    /// The model's integrator: Euler or implicit. RK4 evaluates the forward dynamics four times per
    /// step, so it has no stage of its own: [`Error::Unsupported`].
    pub fn integrate(&mut self) -> Result<(), Error> {
        self.check_staged_integrator()?;
        match self.model().integrator() {
            Integrator::Implicit | Integrator::ImplicitFast => self.implicit(),
            _ => self.euler(),
        }
    }

    /// `Ok` if the model's integrator can run in stages.
    pub fn check_staged_integrator(&self) -> Result<(), Error> {
        match self.model().integrator() {
            Integrator::Euler | Integrator::Implicit | Integrator::ImplicitFast => Ok(()),
            other => Err(Error::Unsupported(format!(
                "a step in stages needs the integrator Euler or implicit; the model's is {other:?}"
            ))),
        }
    }

    /// One time step, stage by stage: the same as [`step`](Self::step) bit for bit, and with the same errors.
    ///
    /// # Errors
    /// As [`step`](Self::step); [`Error::Unsupported`] for a model with islands or sleeping, or an integrator whose step
    /// cannot be taken apart.
    pub fn step_in_stages(&mut self) -> Result<(), Error> {
        self.check_staged_integrator()?;
        if self.model().has_islands() || self.model().has_sleeping() {
            return Err(Error::Unsupported("a step in stages needs islands and sleeping switched off".into()));
        }
        self.step_with(&mut EngineStages)
    }

    /// One time step of the engine, with `hooks` in the place of its contact stages. What does not end a step (full
    /// buffers, bad controls, a reset after a bad number) is reported at its end, as [`step`](Self::step) does; any other
    /// error ends it at once. A step in stages has no islands and lets nothing sleep; the model keeps its flags.
    pub(crate) fn step_with<H: Hooks>(&mut self, hooks: &mut H) -> Result<(), H::Error> {
        self.deferring(|sim| match hooks.in_stages() {
            true => sim.without_islands(|sim| sim.all_stages(hooks)),
            false => sim.all_stages(hooks),
        })
    }

    /// Runs the stages of one step, and reports at its end what does not end it.
    pub(super) fn deferring<E: From<Error>>(
        &mut self,
        stages: impl FnOnce(&mut Self) -> Result<(), E>,
    ) -> Result<(), E> {
        self.check_staged_integrator()?;
        self.defer_warnings();
        let made = stages(self);
        let deferred = self.take_deferred();
        made?;
        Ok(deferred?)
    }

    pub(super) fn all_stages<H: Hooks>(&mut self, hooks: &mut H) -> Result<(), H::Error> {
        self.checked(hooks, Self::check_pos)?;
        self.checked(hooks, Self::check_vel)?;
        if hooks.in_stages() {
            self.forward_in_stages(hooks)?;
        } else {
            self.forward()?;
        }
        self.checked(hooks, Self::check_acc)?;
        let kept = hooks.keeps_inertia();
        if !kept && self.model().enable_flags() & ffi::mjENBL_FWDINV != 0 {
            self.compare_forward_inverse()?;
        }
        hooks.observe(self)?;
        let integrated = if kept { self.integrate_again() } else { self.integrate() };
        Ok(integrated?)
    }

    /// One of the engine's checks, after which it may have gone back to its initial configuration.
    pub(super) fn checked<H: Hooks>(
        &mut self,
        hooks: &mut H,
        check: impl Fn(&mut Self) -> Result<(), Error>,
    ) -> Result<(), H::Error> {
        let before = self.has_diverged();
        check(self)?;
        if !before && self.has_diverged() {
            hooks.forget();
        }
        Ok(())
    }

    fn forward_in_stages<H: Hooks>(&mut self, hooks: &mut H) -> Result<(), H::Error> {
        let kept = hooks.keeps_inertia();
        self.kinematics()?;
        if !kept {
            self.inertia()?;
        }
        hooks.collision(self)?;
        hooks.make_constraint(self)?;
        self.transmission()?;
        hooks.project_constraint(self)?;
        if !kept {
            self.measure(Self::sensor_pos, Self::energy_pos)?;
        }
        self.velocity()?;
        if !kept {
            self.measure(Self::sensor_vel, Self::energy_vel)?;
        }
        self.actuation()?;
        self.acceleration()?;
        hooks.constraint(self)?;
        if !kept {
            self.sensor_acc()?;
        }
        Ok(())
    }

    /// What nothing in the step depends on: `sensors`, and `energy` if enabled.
    fn measure(
        &mut self,
        sensors: impl Fn(&mut Self) -> Result<(), Error>,
        energy: impl Fn(&mut Self) -> Result<(), Error>,
    ) -> Result<(), Error> {
        sensors(self)?;
        if self.model().enable_flags() & ffi::mjENBL_ENERGY != 0 { energy(self) } else { Ok(()) }
    }
}

/// What takes the place of the engine's contact stages in one step; each method is the engine's own unless given.
pub(crate) trait Hooks {
    /// What can go wrong.
    type Error: From<Error>;

    /// False: there is nothing to replace, and the engine's forward dynamics run as a whole.
    fn in_stages(&self) -> bool {
        true
    }

    /// True for a step in stages of which only the state is wanted, with the inertia and its factors of an earlier one; sensors,
    /// energy and the comparison with inverse dynamics stay what they are.
    fn keeps_inertia(&self) -> bool {
        false
    }

    /// Collision detection.
    fn collision(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        Ok(sim.collision()?)
    }

    /// The making of constraint rows.
    fn make_constraint(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        Ok(sim.make_constraint()?)
    }

    /// What the engine's dual solvers need of the rows.
    fn project_constraint(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        Ok(sim.project_constraint()?)
    }

    /// In a frozen step: velocities and passive forces are known, and what else there is may be added to them.
    fn velocity(&mut self, _: &mut Simulation) {}

    /// The solve, from smooth to constrained accelerations.
    fn constraint(&mut self, sim: &mut Simulation) -> Result<(), Self::Error> {
        Ok(sim.constraint()?)
    }

    /// All forces and accelerations are known, and nothing has moved yet.
    fn observe(&mut self, _: &mut Simulation) -> Result<(), Self::Error> {
        Ok(())
    }

    /// The engine has met a bad number and gone back to its initial configuration.
    fn forget(&mut self) {}
}

/// The engine alone.
pub(crate) struct EngineStages;

impl Hooks for EngineStages {
    type Error = Error;
}
