//! A latched grasp's part in a step: its contacts leave the engine's solve, its forces come in their place.

use super::Grasp;
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::cones::solve::SolveStatus;
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::softness::SolverOptions;
use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::grasp::monitor::phase::Phase;
use crate::grasp::spec::Limits;
use crate::grasp::weld::bounds::Bounds;
use crate::mujoco::{Cone, Contact, EqualityId, Simulation, Stamp};
use nalgebra::Vector6;
use std::ops::Range;

/// Where the rows of a solve come from.
pub(in crate::grasp) enum Rows {
    /// They were made in this step; of the engine's, `welds` belong to merged grasps. `alone`: no other grasp is latched.
    Made { welds: Range<usize>, alone: bool },
    /// They are those of the last step.
    Frozen,
}

impl Grasp {
    /// Hand and target.
    pub(in crate::grasp) fn topology(&self) -> &Topology {
        &self.topology
    }

    /// Reads contacts that were found without the engine's collision stage, those of other grasps among them.
    pub(in crate::grasp) fn read_found(&mut self, sim: &Simulation, found: &[Contact]) -> Result<(), Error> {
        self.set.read(found.iter(), sim, &self.topology)
    }

    /// Takes the contacts out of the engine's solve, between collision and constraint making.
    pub(in crate::grasp) fn take_contacts(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        self.set.read(sim.contacts(), sim, &self.topology)?;
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
    /// `[force; torque]`; `None` with cones and while not grasped.
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
        let options = SolverOptions::of(sim.model());
        let Some((_, merged)) = &mut self.merged else { return Ok(()) };
        merged.write_rows(sim, &self.topology, &options, self.set.contacts(), rigid, bounded)
    }

    /// Before the rows of a whole step are made.
    pub(in crate::grasp) fn forget_weld_rows(&mut self) {
        if let Some((_, merged)) = &mut self.merged {
            merged.forget_rows();
        }
    }

    /// Sets the weld rows' references and bounds, and adds the internal forces to `out`; `frozen`: one step on frozen geometry
    /// after the last.
    pub(in crate::grasp) fn load_merged(
        &mut self,
        sim: &mut Simulation,
        frozen: bool,
        out: &mut [f64],
    ) -> Result<(), Error> {
        let Some((_, merged)) = &mut self.merged else { return Ok(()) };
        if frozen {
            merged.resume(sim, &self.topology, self.set.contacts_mut());
        }
        merged.load(sim, &self.topology, self.set.contacts(), out)
    }

    /// Reads the contacts' forces from the solved weld rows.
    pub(in crate::grasp) fn read_merged(&mut self, sim: &Simulation) {
        if let Some((_, merged)) = &mut self.merged {
            merged.read(sim, self.set.contacts_mut());
        }
    }

    /// True while this grasp's constraint is its contacts' friction cones.
    pub(in crate::grasp) fn is_cones(&self) -> bool {
        self.limits == Limits::Cones && self.machine.phase() == Phase::Grasped
    }

    /// Drops the coupled of an earlier step: in this one they are another solve's.
    pub(in crate::grasp) fn forget_coupled(&mut self) {
        self.coupled.forget();
    }

    /// True while contacts of this latched grasp wait for a solve of their own or as another grasp's foreign.
    pub(in crate::grasp) fn awaits_solve(&self) -> bool {
        self.is_cones() && self.set.contacts().iter().any(|c| !c.solved)
    }

    /// Solves the grasp and adds its generalised force to `out`; and with it those of `others` that wait for a solve and
    /// move with it.
    pub(in crate::grasp) fn solve_cones(
        &mut self,
        sim: &Simulation,
        others: &mut [Grasp],
        rows: &Rows,
        out: &mut [f64],
    ) -> Result<(), Error> {
        let dynamics = Dynamics::of(sim);
        let options = SolverOptions::of(sim.model());
        let contacts = self.set.contacts_mut();
        self.status = match rows {
            Rows::Made { welds, alone } => {
                self.coupled.read(sim, welds, *alone)?;
                for other in others.iter().filter(|g| g.awaits_solve()) {
                    self.coupled.invite(&dynamics, &options, other.set.contacts());
                }
                self.solver.solve(&dynamics, &self.topology, &options, contacts, &mut self.coupled)
            }
            Rows::Frozen => {
                self.coupled.resume(sim, &dynamics, &options);
                self.solver.resume(&dynamics, &options, contacts, &mut self.coupled)
            }
        };
        self.check_forces(sim)?;
        self.solver.add_forces(&dynamics, &self.topology, self.set.contacts(), out);
        self.coupled.add_foreign_forces(out);
        let mut foreign = self.coupled.foreign().iter();
        for other in others.iter_mut().filter(|g| g.awaits_solve()) {
            other.take_back(&mut foreign, self.status);
        }
        Ok(())
    }

    /// Adds what the contact forces of the last step will add to the generalised force with each further step, as contacts
    /// and joints' axes move on; `elapsed`: steps between the last two readings of the contacts.
    pub(in crate::grasp) fn add_turn(&self, sim: &Simulation, elapsed: usize, out: &mut [f64]) {
        let (dynamics, timestep) = (Dynamics::of(sim), sim.model().timestep());
        for contact in self.set.contacts() {
            contact.add_turn(&dynamics, timestep, elapsed, out);
        }
    }

    /// Number of whole steps since a contact came, went or jumped.
    pub(in crate::grasp) fn steps_since_contacts_changed(&self) -> usize {
        self.set.kept()
    }

    /// How fast the contacts slide whose friction is at its limit, in the last step \[m/s\].
    pub(in crate::grasp) fn slip_speed(&self, sim: &Simulation) -> f64 {
        self.set.slip_speed(&Dynamics::of(sim))
    }

    /// After a step: the moment from which a frozen one may go on.
    pub(in crate::grasp) fn remember(&mut self, now: Stamp) {
        self.stamp = Some(now);
    }

    /// Before a frozen step: all contacts are to be solved again.
    pub(in crate::grasp) fn unsolve(&mut self) {
        self.set.contacts_mut().iter_mut().for_each(|contact| contact.solved = false);
    }

    /// Whether the next solve can go on from this one where nothing but time has passed.
    pub(in crate::grasp) fn can_resume(&self, now: Stamp) -> bool {
        match self.machine.phase() {
            Phase::Grasped => {
                let solved = match &self.merged {
                    Some((_, merged)) => merged.has_rows(),
                    None => self.set.contacts().iter().all(|c| c.solved),
                };
                solved && self.stamp == Some(now)
            }
            Phase::Ungrasped => self.set.contacts().is_empty(),
        }
    }

    /// After a frozen step: releases when the hand has lost its hold. With cones the quality stays that of the last whole step.
    pub(in crate::grasp) fn observe_frozen(&mut self, sim: &Simulation) {
        if self.is_merged() {
            self.measure(sim);
        }
        self.keep_or_release(sim.model().timestep());
    }

    pub(super) fn check_forces(&self, sim: &Simulation) -> Result<(), Error> {
        let finite = |c: &GraspContact| c.force.iter().chain(c.torque.iter()).all(|x| x.is_finite());
        match self.set.contacts().iter().chain(self.coupled.foreign()).all(finite) {
            true => Ok(()),
            false => Err(Error::Diverged { time: sim.time(), what: "a contact force" }),
        }
    }

    /// Takes this grasp's contacts back from the solve of another grasp in which they were foreign.
    fn take_back<'a>(&mut self, foreign: &mut impl Iterator<Item = &'a GraspContact>, status: SolveStatus) {
        let mut solved = false;
        for (contact, foreign) in self.set.contacts_mut().iter_mut().zip(foreign) {
            if foreign.solved {
                contact.clone_from(foreign);
                solved = true;
            }
        }
        if solved {
            self.status = status;
            self.coupled.forget();
        }
    }

    /// Number of the engine's rows that were solved together with the grasp in this step.
    pub(in crate::grasp) fn solved_rows(&self) -> usize {
        self.coupled.solved_rows()
    }

    /// Writes the forces of those rows.
    pub(in crate::grasp) fn write_row_forces(&self, sim: &mut Simulation) {
        self.coupled.write_forces(sim);
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
