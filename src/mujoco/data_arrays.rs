//! Access to the numeric arrays of a simulation's data, under the engine's names.
//!
//! Matrices are row-major; quaternions are w, x, y, z; world frame and SI units unless said otherwise. The engine's
//! own spatial vectors (`cvel`, `cdof`, `cacc`, ...) are [rotation; translation] about the subtree's centre of mass.
#![allow(non_snake_case)] // The engine's names are the field's.

use super::arrays::{factor, read_arrays, slice, slice_mut, write_arrays};
use super::compat::{self, MassRows};
use super::error::{Error, check_index, check_length};
use super::ids::{ActuatorId, Id};
use super::simulation::Simulation;

impl Simulation {
    read_arrays! { data, sizes;
        // state
        qpos: f64 [nq], "Generalized position";
        qvel: f64 [nv], "Generalized velocity";
        act: f64 [na], "Actuator activation";
        qacc_warmstart: f64 [nv], "Acceleration used for warmstart";
        // control
        ctrl: f64 [nu], "Controls";
        qfrc_applied: f64 [nv], "Applied generalized force";
        xfrc_applied: f64 [nbody x 6], "Applied wrench on each body, [force; torque] at its centre of mass, world axes";
        // mocap data
        mocap_pos: f64 [nmocap x 3], "Positions of mocap bodies";
        mocap_quat: f64 [nmocap x 4], "Orientations of mocap bodies";
        // dynamics
        qacc: f64 [nv], "Generalized acceleration";
        act_dot: f64 [na], "Time-derivative of actuator activation";
        // sensors
        sensordata: f64 [nsensordata], "Sensor data array";
        // computed by mj_fwdPosition/mj_kinematics
        xpos: f64 [nbody x 3], "Cartesian position of body frame";
        xquat: f64 [nbody x 4], "Cartesian orientation of body frame";
        xmat: f64 [nbody x 9], "Cartesian orientation of body frame";
        xipos: f64 [nbody x 3], "Cartesian position of body com";
        ximat: f64 [nbody x 9], "Cartesian orientation of body inertia";
        xanchor: f64 [njnt x 3], "Cartesian position of joint anchor";
        xaxis: f64 [njnt x 3], "Cartesian joint axis";
        geom_xpos: f64 [ngeom x 3], "Cartesian geom position";
        geom_xmat: f64 [ngeom x 9], "Cartesian geom orientation";
        site_xpos: f64 [nsite x 3], "Cartesian site position";
        site_xmat: f64 [nsite x 9], "Cartesian site orientation";
        cam_xpos: f64 [ncam x 3], "Cartesian camera position";
        cam_xmat: f64 [ncam x 9], "Cartesian camera orientation";
        // computed by mj_fwdPosition/mj_comPos
        subtree_com: f64 [nbody x 3], "Center of mass of each subtree";
        cdof: f64 [nv x 6], "Com-based motion axis of each dof";
        cinert: f64 [nbody x 10], "Com-based body inertia and mass";
        // computed by mj_fwdPosition/mj_tendon
        ten_wrapadr: i32 [ntendon], "Start address of tendon's path";
        ten_wrapnum: i32 [ntendon], "Number of wrap points in path";
        ten_length: f64 [ntendon], "Tendon lengths";
        wrap_obj: i32 [nwrap x 2], "Geom id; -1: site; -2: pulley";
        wrap_xpos: f64 [nwrap x 2 x 3], "Cartesian 3D points in all path";
        // computed by mj_fwdPosition/mj_transmission
        actuator_length: f64 [nu], "Actuator lengths";
        // computed by mj_fwdPosition/mj_crb
        crb: f64 [nbody x 10], "Com-based composite inertia and mass";
        // computed by mj_fwdPosition/mj_factorM
        qLDiagInv: f64 [nv], "1/diag(D)";
        // computed by mj_fwdVelocity
        ten_velocity: f64 [ntendon], "Tendon velocities";
        actuator_velocity: f64 [nu], "Actuator velocities";
        // computed by mj_fwdVelocity/mj_comVel
        cvel: f64 [nbody x 6], "Com-based velocity [3D rot; 3D tran]";
        cdof_dot: f64 [nv x 6], "Time-derivative of cdof";
        // computed by mj_fwdVelocity/mj_rne (without acceleration)
        qfrc_bias: f64 [nv], "C(qpos,qvel)";
        // computed by mj_fwdVelocity/mj_passive
        qfrc_passive: f64 [nv], "Passive force";
        // computed by mj_sensorVel/mj_subtreeVel if needed
        subtree_linvel: f64 [nbody x 3], "Linear velocity of subtree com";
        subtree_angmom: f64 [nbody x 3], "Angular momentum about subtree com";
        // computed by mj_Euler
        qHDiagInv: f64 [nv], "1/diag(D) of modified M";
        // computed by mj_implicit/mj_derivative
        qDeriv: f64 [nD], "d (passive + actuator - bias) / d qvel";
        // computed by mj_implicit/mju_factorLUSparse
        qLU: f64 [nD], "Sparse LU of (qM - dt*qDeriv)";
        // computed by mj_fwdActuation
        actuator_force: f64 [nu], "Actuator force in actuation space";
        qfrc_actuator: f64 [nv], "Actuator force";
        // computed by mj_fwdAcceleration
        qfrc_smooth: f64 [nv], "Net unconstrained force";
        qacc_smooth: f64 [nv], "Unconstrained acceleration";
        // computed by mj_fwdConstraint/mj_inverse
        qfrc_constraint: f64 [nv], "Constraint force";
        // computed by mj_inverse
        qfrc_inverse: f64 [nv], "Net external force; should equal qfrc_applied + J^T xfrc_applied + qfrc_actuator";
        // computed by mj_sensorAcc/mj_rnePostConstraint if needed; rotation:translation format
        cacc: f64 [nbody x 6], "Com-based acceleration";
        cfrc_int: f64 [nbody x 6], "Com-based interaction force with parent";
        cfrc_ext: f64 [nbody x 6], "Com-based external force on body";
    }

    read_arrays! { data, data;
        // the constraint rows of the current step: equality, then friction loss, then limits, then contacts
        efc_type: i32 [nefc], "Type of each constraint row (mjtConstraint)";
        efc_id: i32 [nefc], "Element that each constraint row belongs to";
        efc_pos: f64 [nefc], "Position error of each constraint row";
        efc_margin: f64 [nefc], "Inclusion margin of each constraint row";
        efc_frictionloss: f64 [nefc], "Friction limit of each friction row";
        efc_KBIP: f64 [nefc x 4], "Stiffness, damping, impedance and its derivative of each row";
        efc_D: f64 [nefc], "Constraint mass 1/R of each row";
        efc_R: f64 [nefc], "Regularization R of each row";
        efc_vel: f64 [nefc], "Velocity J qvel of each row";
        efc_aref: f64 [nefc], "Reference acceleration of each row";
        efc_b: f64 [nefc], "J qacc_smooth - aref";
        efc_force: f64 [nefc], "Constraint force of each row";
        efc_state: i32 [nefc], "State of each row (mjtConstraintState)";
    }

    write_arrays! { data, sizes, note_input;
        qvel => qvel_mut: f64 [nv], "Generalized velocity, to write";
        act => act_mut: f64 [na], "Actuator activation, to write";
        ctrl => ctrl_mut: f64 [nu], "Controls, to write";
        qfrc_applied => qfrc_applied_mut: f64 [nv], "Applied generalized force, to write";
        xfrc_applied => xfrc_applied_mut: f64 [nbody x 6], "Applied wrench on each body, [force; torque] at its centre of mass, world axes, to write";
    }

    write_arrays! { data, sizes, note_change;
        qpos => qpos_mut: f64 [nq], "Generalized position, to write";
        mocap_pos => mocap_pos_mut: f64 [nmocap x 3], "Positions of mocap bodies, to write";
        mocap_quat => mocap_quat_mut: f64 [nmocap x 4], "Orientations of mocap bodies, to write";
        qacc_warmstart => qacc_warmstart_mut: f64 [nv], "Acceleration with which the solver starts, to write";
        qacc => qacc_mut: f64 [nv], "Generalized acceleration, to write";
        qacc_smooth => qacc_smooth_mut: f64 [nv], "Acceleration without constraints, to write";
        qfrc_smooth => qfrc_smooth_mut: f64 [nv], "Force without constraints, to write";
        qfrc_constraint => qfrc_constraint_mut: f64 [nv], "Constraint force, to write";
        qfrc_passive => qfrc_passive_mut: f64 [nv], "Passive force, to write";
    }

    write_arrays! { model_fields, model_fields, note_change;
        eq_solref => eq_solref_mut: f64 [neq x 2], "Solver reference of the equality constraints, to write";
        eq_solimp => eq_solimp_mut: f64 [neq x 5], "Solver impedance of the equality constraints, to write";
        geom_friction => geom_friction_mut: f64 [ngeom x 3], "Friction (slide, spin, roll) of each geom, to write";
        geom_rgba => geom_rgba_mut: f32 [ngeom x 4], "Colour of each geom without material, to write";
        dof_damping => dof_damping_mut: f64 [nv], "Damping of each degree of freedom, to write";
        dof_armature => dof_armature_mut: f64 [nv], "Armature inertia of each degree of freedom, to write (a simple body takes `dof_M0` instead)";
        dof_M0 => dof_M0_mut: f64 [nv], "Diagonal inertia, which the degrees of freedom of simple bodies take, to write";
        dof_frictionloss => dof_frictionloss_mut: f64 [nv], "Friction loss of each degree of freedom, to write";
        jnt_stiffness => jnt_stiffness_mut: f64 [njnt], "Stiffness of each joint, to write";
        actuator_gainprm => actuator_gainprm_mut: f64 [nu x 10], "Gain parameters of each actuator, to write";
        actuator_biasprm => actuator_biasprm_mut: f64 [nu x 10], "Bias parameters of each actuator, to write";
    }

    /// Numeric data of each equality constraint, to write. Shape: `neq x eq_data_stride()`; see
    /// [`CompiledModel::eq_data`](super::CompiledModel::eq_data).
    pub fn eq_data_mut(&mut self) -> &mut [f64] {
        self.note_change();
        let model = self.model_fields();
        // SAFETY: as in `write_arrays!`, with the engine's number of columns.
        unsafe { slice_mut(model.eq_data, model.neq as usize * compat::EQ_DATA) }
    }

    /// Approximate diagonal of A = J M^-1 J^T.
    pub fn efc_diagonal(&self) -> &[f64] {
        // SAFETY: the first `nefc` elements are in use; whatever writes them takes `&mut self`.
        unsafe { slice(compat::efc_diagonal(self.data()), self.nefc()) }
    }

    /// The factor of the inertia matrix. Valid after [`inertia`](Self::inertia).
    pub fn mass_factor(&self) -> MassRows<'_> {
        MassRows::of_factor(self)
    }

    /// The inertia matrix `M`, its lower triangle. Valid after [`inertia`](Self::inertia).
    pub fn mass_rows(&self) -> MassRows<'_> {
        MassRows::of_inertia(self)
    }

    /// What one actuator moves: the derivative of its length by each degree of freedom, into `out` (nv). Valid after
    /// [`transmission`](Self::transmission).
    pub fn actuator_moment_into(&self, actuator: ActuatorId, out: &mut [f64]) -> Result<(), Error> {
        check_index(ActuatorId::KIND, actuator.index(), self.model().nu())?;
        check_length("the buffer for nv numbers", self.model().nv(), out.len())?;
        let (m, d) = self.pointers();
        // SAFETY: the actuator exists, and the buffer has nv numbers.
        unsafe { compat::actuator_moment(m, d, actuator.index(), out) };
        Ok(())
    }

    /// Constraint force of each row, to write.
    pub fn efc_force_mut(&mut self) -> &mut [f64] {
        let data = self.data();
        // SAFETY: the first `nefc` elements are in use, and `&mut self` makes the access exclusive.
        unsafe { slice_mut(data.efc_force, data.nefc as usize) }
    }

    /// State of each row (mjtConstraintState), to write.
    pub fn efc_state_mut(&mut self) -> &mut [i32] {
        let data = self.data();
        // SAFETY: as above.
        unsafe { slice_mut(data.efc_state, data.nefc as usize) }
    }

    /// Number of constraint rows.
    pub fn nefc(&self) -> usize {
        self.data().nefc as usize
    }

    /// Number of equality rows: rows `0..ne`.
    pub fn ne(&self) -> usize {
        self.data().ne as usize
    }

    /// Number of friction-loss rows: rows `ne..ne + nf`.
    pub fn nf(&self) -> usize {
        self.data().nf as usize
    }

    /// Simulation time, s.
    pub fn time(&self) -> f64 {
        self.data().time
    }

    /// Iterations of the constraint solver in the last solve.
    pub fn solver_iter(&self) -> usize {
        compat::solver_iter(self.data()) as usize
    }

    /// Potential and kinetic energy, J; computed only with the `energy` flag
    /// ([`set_energy_enabled`](Self::set_energy_enabled)).
    pub fn energy(&self) -> [f64; 2] {
        self.data().energy
    }

    /// The most contacts and constraint rows since the last reset.
    pub fn peak_use(&self) -> (usize, usize) {
        (self.data().maxuse_con as usize, self.data().maxuse_efc as usize)
    }
}
