//! A latched grasp's part in a step: its contacts leave the engine's solve, its forces come in their place.

use super::Grasp;
use crate::grasp::bounds::Bounds;
use crate::grasp::contacts::GraspContact;
use crate::grasp::error::Error;
use crate::grasp::mobility::Dynamics;
use crate::grasp::phase::Phase;
use crate::grasp::softness::{ConeKind, SolverOptions};
use crate::grasp::solve::SolveStatus;
use crate::grasp::spec::Limits;
use crate::grasp::weld::Settings;
use crate::mujoco::{Cone, DISABLE_REFSAFE, EqualityId, Simulation};
use nalgebra::Vector6;
use std::ops::Range;

impl Grasp {
    /// Finds the contacts of all latched grasps in the place of the engine's collision stage; false if the engine has to
    /// look itself, because something else might touch something.
    pub(in crate::grasp) fn detect_alone(sim: &mut Simulation, grasps: &mut [Grasp]) -> Result<bool, Error> {
        let is_latched = |grasp: &Grasp| grasp.phase() == Phase::Grasped;
        let Some(first) = grasps.iter().position(is_latched) else { return Ok(false) };
        let mut detector = std::mem::take(&mut grasps[first].detector);
        let latched = grasps.iter().filter(|grasp| is_latched(grasp));
        let alone = detector.replaces_collision(sim, latched.map(|grasp| &grasp.topology));
        if matches!(alone, Ok(true)) {
            for grasp in grasps.iter_mut().filter(|grasp| is_latched(grasp)) {
                grasp.set.read(detector.found().iter().cloned(), sim, &grasp.topology);
            }
        }
        grasps[first].detector = detector;
        alone
    }

    /// Takes the contacts out of the engine's solve, between collision and constraint making.
    pub(in crate::grasp) fn take_contacts(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        self.set.read(sim.contacts(), sim, &self.topology);
        for contact in self.set.contacts() {
            sim.exclude_contact(contact.index)?;
        }
        Ok(())
    }

    /// True while this grasp's constraint is the weld.
    pub(in crate::grasp) fn is_merged(&self) -> bool {
        self.merged.is_some() && self.machine.phase() == Phase::Grasped
    }

    /// True if the weld is to have rows in this step.
    pub(in crate::grasp) fn wants_weld(&self) -> bool {
        self.is_merged() && !self.set.contacts().is_empty()
    }

    /// The weld of a merged grasp.
    pub(in crate::grasp) fn weld(&self) -> Option<EqualityId> {
        self.merged.as_ref().map(|(weld, _)| *weld)
    }

    /// Number of the weld's rows that have bounds.
    pub(in crate::grasp) fn relaxed_count(&self) -> usize {
        self.merged.as_ref().map_or(0, |(_, merged)| merged.bounded_count())
    }

    /// Largest wrench that a grasp with [`Limits::Box`] carries in the next step on each of its axes, thesis Eqs. 4.1 to
    /// 4.3; `None` for the other forms and while not grasped.
    pub fn bounds(&self) -> Option<Bounds> {
        let (_, merged) = self.merged.as_ref().filter(|_| self.limits == Limits::Box && self.is_merged())?;
        Some(merged.bounds())
    }

    /// Wrench across a merged grasp in the last step: on the target, about its centre of mass, in the grasp's axes,
    /// `[force; torque]`; `None` for form 1 and while not grasped.
    pub fn merged_wrench(&self) -> Option<Vector6<f64>> {
        let (_, merged) = self.merged.as_ref().filter(|_| self.is_merged())?;
        Some(merged.wrench())
    }

    /// Fills the weld's rows, the rigid ones from `rigid` on and those with bounds from `bounded` on.
    pub(in crate::grasp) fn write_weld_rows(
        &mut self,
        sim: &mut Simulation,
        rigid: &mut usize,
        bounded: &mut usize,
    ) -> Result<(), Error> {
        let options = solver_options(sim);
        let Some((_, merged)) = &mut self.merged else { return Ok(()) };
        merged.write_rows(sim, &self.topology, &options, self.set.contacts(), rigid, bounded)
    }

    /// Sets the weld rows' references and bounds, and adds the squeeze to `out`.
    pub(in crate::grasp) fn load_merged(&mut self, sim: &mut Simulation, out: &mut [f64]) -> Result<(), Error> {
        let Some((_, merged)) = &mut self.merged else { return Ok(()) };
        merged.load(sim, &self.topology, self.set.contacts(), out)
    }

    /// Reads the contacts' forces from the solved weld rows.
    pub(in crate::grasp) fn read_merged(&mut self, sim: &Simulation) {
        if let Some((_, merged)) = &mut self.merged {
            merged.read(sim, self.set.contacts_mut());
        }
    }

    /// The user's solver settings, while a merged grasp keeps them.
    pub(in crate::grasp) fn settings(&self) -> Option<&Settings> {
        self.settings.as_ref()
    }

    /// As [`settings`](Self::settings), to keep them.
    pub(in crate::grasp) fn settings_mut(&mut self) -> &mut Option<Settings> {
        &mut self.settings
    }

    /// Gives the solver settings back that a latched grasp with [`Limits::Box`] or [`Limits::Rigid`] has changed (noslip
    /// iterations, storage of the Jacobian). A step after the release does it by itself; this is for a simulation that
    /// goes on without its grasps. The current contacts and constraint rows are dropped if there is something to restore.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn restore_settings(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        match self.settings.take() {
            Some(settings) => settings.restore(sim),
            None => Ok(()),
        }
    }

    /// True while this grasp's constraint is its contacts' friction cones.
    pub(in crate::grasp) fn is_cones(&self) -> bool {
        self.limits == Limits::Cones && self.machine.phase() == Phase::Grasped
    }

    /// Drops the neighbours of an earlier step: in this one they are another solve's.
    pub(in crate::grasp) fn leave_neighbours(&mut self) {
        self.neighbours.forget();
    }

    /// True while contacts of this latched grasp wait for a solve of their own or as another grasp's guests.
    pub(in crate::grasp) fn awaits_solve(&self) -> bool {
        self.is_cones() && self.set.contacts().iter().any(|c| !c.solved)
    }

    /// Solves the grasp and adds its generalised force to `out`; and with it those of `others` that wait for a solve and
    /// move with it. `welds`: the engine's rows that belong to merged grasps.
    pub(in crate::grasp) fn solve_cones(
        &mut self,
        sim: &Simulation,
        others: &mut [Grasp],
        welds: &Range<usize>,
        out: &mut [f64],
    ) -> Result<(), Error> {
        let model = sim.model();
        let dynamics = Dynamics {
            dof_parent: model.dof_parentid(),
            dof_body: model.dof_bodyid(),
            factor: sim.mass_factor(),
            inverse_diagonal: sim.qLDiagInv(),
            dof_axis: sim.cdof(),
            composite_inertia: sim.crb(),
            body_root: model.body_rootid(),
            subtree_com: sim.subtree_com(),
            body_velocity: sim.cvel(),
            acceleration: sim.qacc_smooth(),
        };
        let options = solver_options(sim);
        self.neighbours.read(sim, welds)?;
        for other in others.iter().filter(|g| g.awaits_solve()) {
            self.neighbours.invite(&dynamics, &other.topology, &options, other.set.contacts());
        }
        let contacts = self.set.contacts_mut();
        self.status = self.solver.solve(&dynamics, &self.topology, &options, contacts, &mut self.neighbours);
        let finite = |c: &GraspContact| c.force.iter().chain(c.torque.iter()).all(|x| x.is_finite());
        if !self.set.contacts().iter().chain(self.neighbours.guests()).all(finite) {
            return Err(Error::Diverged { time: sim.time(), what: "a contact force" });
        }
        self.solver.add_forces(&dynamics, &self.topology, self.set.contacts(), out);
        self.neighbours.add_guest_forces(out);
        let mut guests = self.neighbours.guests().iter();
        for other in others.iter_mut().filter(|g| g.awaits_solve()) {
            other.take_back(&mut guests, self.status);
        }
        Ok(())
    }

    /// Takes this grasp's contacts back from the solve of another grasp in which they were guests.
    fn take_back<'a>(&mut self, guests: &mut impl Iterator<Item = &'a GraspContact>, status: SolveStatus) {
        let mut solved = false;
        for (contact, guest) in self.set.contacts_mut().iter_mut().zip(guests) {
            contact.clone_from(guest);
            solved |= guest.solved;
        }
        if solved {
            self.status = status;
            self.neighbours.forget();
        }
    }

    /// Number of the engine's rows that were solved together with the grasp in this step.
    pub(in crate::grasp) fn solved_rows(&self) -> usize {
        self.neighbours.solved_rows()
    }

    /// Writes the forces of those rows.
    pub(in crate::grasp) fn write_row_forces(&self, sim: &mut Simulation) {
        self.neighbours.write_forces(sim);
    }

    /// Shows the engine the forces of the contacts, from `offset` numbers behind its rows on, and moves `offset` on. In a
    /// merged grasp the weld's rows carry them already.
    pub(in crate::grasp) fn show_forces(&self, sim: &mut Simulation, offset: &mut usize) -> Result<(), Error> {
        if self.limits == Limits::Cones {
            let pyramidal = sim.model().cone() == Cone::Pyramidal;
            let listed = sim.contact_count();
            for contact in self.set.contacts().iter().filter(|c| c.index < listed) {
                let (rows, count) = contact.engine_rows(pyramidal);
                sim.show_contact_force(contact.index, *offset, &rows[..count])?;
                *offset += count;
            }
        }
        Ok(())
    }
}

/// The options of the engine that enter a contact's softness.
pub(in crate::grasp) fn solver_options(sim: &Simulation) -> SolverOptions {
    let model = sim.model();
    SolverOptions {
        timestep: model.timestep(),
        refsafe: model.disable_flags() & DISABLE_REFSAFE == 0,
        impratio: model.impratio(),
        cone: if model.cone() == Cone::Elliptic { ConeKind::Elliptic } else { ConeKind::Pyramidal },
    }
}
