//! One grasp: who holds what, its phase and its live contacts.

mod latched;
mod saved;

pub(super) use latched::Rows;

use super::cones::coupled::CoupledConstraints;
use super::cones::dynamics::Dynamics;
use super::cones::solve::{GraspSolver, SolveStatus};
use super::contact::contacts::{ContactSet, GraspContact};
use super::contact::softness::SolverOptions;
use super::error::Error;
use super::hand::search::find_hand;
use super::hand::topology::{Topology, Tree, is_ancestor};
use super::monitor::gram::Gram;
use super::monitor::phase::{Phase, PhaseMachine};
use super::monitor::wrench::LoadedContact;
use super::spec::{GraspSpec, Limits, check_softness, palm_of, thresholds, weight};
use super::state::Identity;
use super::weld::rows;
use super::weld::solve::MergedSolver;
use crate::mujoco::{BodyId, EqualityId, Integrator, Simulation, Stamp};
use nalgebra::Vector3;

/// Controller and monitor of one grasp; see [`Grasps`](super::Grasps).
#[derive(Clone, Debug)]
pub struct Grasp {
    target: BodyId,
    palm: BodyId,
    links: Vec<BodyId>,
    is_link: Vec<bool>,
    limits: Limits,
    merged: Option<(EqualityId, MergedSolver)>,
    latch_quality: f64,
    release_quality: f64,
    machine: PhaseMachine,
    topology: Topology,
    set: ContactSet,
    gram: Gram,
    solver: GraspSolver,
    coupled: CoupledConstraints,
    status: SolveStatus,
    live: Vec<LoadedContact>,
    identity: Identity,
    /// After the last step; `None` if anything was done to it since.
    stamp: Option<Stamp>,
}

impl Grasp {
    /// Checks a grasp against the model and prepares it; see [`Grasps::add`](super::Grasps::add).
    pub(super) fn new(sim: &Simulation, spec: &GraspSpec) -> Result<Grasp, Error> {
        let model = sim.model();
        spec.check_bodies(model.nbody())?;
        let name = |body: BodyId| model.label(body);
        let parents = model.body_parentid();
        if model.integrator() == Integrator::Rk4 {
            return Err(Error::Integrator);
        }
        let indices = |bodies: &[BodyId]| -> Vec<usize> { bodies.iter().map(|b| b.index()).collect() };
        let (palm, named) = match spec.palm {
            Some(palm) => (palm, spec.effectors.clone()),
            None if spec.effectors.is_empty() => find_hand(model, spec.target)?,
            None => (BodyId::from_index(palm_of(parents, &indices(&spec.effectors))), spec.effectors.clone()),
        };
        if let Some(&e) = named.iter().find(|e| is_ancestor(parents, spec.target.index(), e.index())) {
            return Err(Error::EffectorIsTarget(name(e)));
        }
        let outside = |e: &&BodyId| **e == BodyId::WORLD || !is_ancestor(parents, palm.index(), e.index());
        if let Some(&e) = named.iter().find(outside) {
            return Err(Error::EffectorOutsideHand { effector: name(e), palm: name(palm) });
        }
        let tree = Tree {
            body_parent: parents,
            body_dofadr: model.body_dofadr(),
            body_dofnum: model.body_dofnum(),
            dof_parent: model.dof_parentid(),
            dof_body: model.dof_bodyid(),
        };
        let topology = Topology::new(&tree, palm.index(), &indices(&named), spec.target.index());
        if topology.shares_tree(&tree) {
            return Err(Error::TargetInHand { target: name(spec.target), palm: name(palm) });
        }
        if topology.leaf(spec.target.index()).is_none() {
            return Err(Error::StaticTarget(name(spec.target)));
        }
        let links = if named.is_empty() {
            model
                .bodies()
                .filter(|b| {
                    b.index() != palm.index() && topology.in_hand(b.index()) && model.body_geomnum()[b.index()] > 0
                })
                .collect()
        } else {
            named
        };
        if links.is_empty() {
            return Err(if palm == BodyId::WORLD {
                Error::WorldWithoutEffectors
            } else {
                Error::NoEffectors(name(palm))
            });
        }
        let merged = match spec.limits {
            Limits::Cones => None,
            Limits::Box | Limits::Rigid => {
                let weld = rows::find(sim, &topology, spec.limits, &name(spec.target))?;
                Some((weld, MergedSolver::new(model, &topology, spec)))
            }
        };
        check_softness(spec)?;
        let (latch_quality, release_quality) = thresholds(spec, weight(model, spec.target))?;
        let mut is_link = vec![false; parents.len()];
        for link in &links {
            is_link[link.index()] = true;
        }
        let identity = Identity::new(model, spec, (palm, &links), [latch_quality, release_quality]);
        Ok(Grasp {
            identity,
            target: spec.target,
            palm,
            links,
            is_link,
            limits: spec.limits,
            merged,
            latch_quality,
            release_quality,
            machine: PhaseMachine::new(spec.latch_time, spec.release_time),
            set: ContactSet::default(),
            gram: Gram::new(Vector3::zeros(), 0.0),
            solver: GraspSolver::new(&topology, model.dof_parentid()),
            coupled: CoupledConstraints::default(),
            status: SolveStatus::default(),
            topology,
            live: Vec::new(),
            stamp: None,
        })
    }

    /// Base of the fingers.
    pub fn palm(&self) -> BodyId {
        self.palm
    }

    /// The body that is grasped.
    pub fn target(&self) -> BodyId {
        self.target
    }

    /// The links that may hold the target.
    pub fn links(&self) -> &[BodyId] {
        &self.links
    }

    /// Ungrasped or grasped.
    pub fn phase(&self) -> Phase {
        self.machine.phase()
    }

    /// What stands for the contacts while grasped.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// Smallest singular value of the grasp matrix of the last step's contacts \[N\], thesis Eqs. 2.17 and 2.18.
    pub fn quality(&self) -> f64 {
        self.gram.min_singular_value()
    }

    /// `Q_Th` \[N\].
    pub fn latch_quality(&self) -> f64 {
        self.latch_quality
    }

    /// `Q_M` \[N\].
    pub fn release_quality(&self) -> f64 {
        self.release_quality
    }

    /// Forbids or allows latching; a grasp that is latched stays so.
    pub fn allow_latch(&mut self, allowed: bool) {
        self.machine.allow_latch(allowed);
    }

    /// See [`allow_latch`](Self::allow_latch).
    pub(super) fn may_latch(&self) -> bool {
        self.machine.is_allowed()
    }

    /// True once the quality has been at `Q_Th`, with contact, for the latch time.
    pub fn would_latch(&self) -> bool {
        self.machine.phase() == Phase::Grasped || self.machine.is_ripe()
    }

    /// Gives the contacts back to the engine.
    pub fn release(&mut self) {
        self.machine.release();
        self.forget();
    }

    /// As when it was made.
    pub(super) fn reset(&mut self) {
        self.machine.allow_latch(true);
        self.release();
        self.set = ContactSet::default();
        self.forget_results();
    }

    /// What the last step came to.
    pub(super) fn forget_results(&mut self) {
        self.status = SolveStatus::default();
        self.stamp = None;
        self.live.clear();
        self.gram = Gram::new(Vector3::zeros(), 0.0);
    }

    /// What the solver remembers of the last step means nothing in a later latch.
    fn forget(&mut self) {
        self.stamp = None;
        self.solver.reset();
        self.coupled.forget();
    }

    /// A step was begun and not made.
    pub(super) fn unmake(&mut self) {
        self.forget();
        self.set.unread();
    }

    /// Live contacts of the last step between hand and target.
    pub fn contacts(&self) -> &[GraspContact] {
        self.set.contacts()
    }

    /// Newton iterations of the last grasp solve.
    pub fn solve_status(&self) -> SolveStatus {
        self.status
    }

    /// After a step of the engine's own solve: reads contacts and forces, and counts good time without latching.
    pub(super) fn monitor(&mut self, sim: &Simulation) -> Result<(), Error> {
        self.read_engine_contacts(sim)?;
        self.machine.count_good(self.is_good(), sim.model().timestep());
        Ok(())
    }

    /// After an ungrasped step: reads contacts and forces, and latches when they are good.
    pub(super) fn observe_ungrasped(&mut self, sim: &Simulation) -> Result<(), Error> {
        self.read_engine_contacts(sim)?;
        if self.machine.observe_ungrasped(self.is_good(), sim.model().timestep()) == Phase::Grasped {
            self.forget();
            let options = SolverOptions::of(sim.model());
            if let Some((_, merged)) = &mut self.merged {
                merged.begin(sim, &self.topology, &options, self.set.contacts());
            }
        }
        Ok(())
    }

    /// After a grasped step: releases when the hand has lost its hold.
    pub(super) fn observe_grasped(&mut self, sim: &Simulation) {
        self.measure(sim);
        self.keep_or_release(sim.model().timestep());
    }

    /// A weld to effectors that no longer resist all six motions of the target stands for nothing: that is the end at once,
    /// whatever the release time.
    fn keep_or_release(&mut self, elapsed: f64) {
        let void = self.is_merged() && !self.gram.exceeds(0.0);
        if void || self.machine.observe_grasped(self.has_hold(), elapsed) == Phase::Ungrasped {
            self.release();
        }
    }

    /// Slip velocities of the last step's contacts (not needed by the grasp itself).
    pub fn read_slip(&mut self, sim: &Simulation) {
        self.set.read_slip(&Dynamics::of(sim));
    }

    fn read_engine_contacts(&mut self, sim: &Simulation) -> Result<(), Error> {
        self.set.read(sim.contacts(), sim, &self.topology)?;
        self.set.read_forces(sim)?;
        self.check_forces(sim).inspect_err(|_| self.set.unread())?;
        self.measure(sim);
        Ok(())
    }

    fn measure(&mut self, sim: &Simulation) {
        let com = sim.body_com(self.target);
        self.live.clear();
        self.live.extend(self.set.contacts().iter().filter(|c| self.is_link[c.link]).map(|c| c.loaded()));
        self.gram = Gram::of(&self.live, &com);
    }

    /// Whether the quality is good enough to latch, with an effector that pushes on the target.
    fn is_good(&self) -> bool {
        self.is_touched() && self.gram.exceeds(self.latch_quality)
    }

    /// Whether a latched grasp is worth keeping. With cones that is as long as anything below the palm presses on the target,
    /// since nothing is gained by giving the contacts back; a target that an opened hand only has in its palm is not held.
    /// See [`GraspSpec::release_quality`].
    fn has_hold(&self) -> bool {
        match self.limits {
            Limits::Cones => {
                let grips = |c: &&GraspContact| c.link_id != self.palm || self.is_link[c.link];
                let grip: f64 = self.set.contacts().iter().filter(grips).map(GraspContact::normal_force).sum();
                grip > 0.0 && grip >= self.release_quality
            }
            Limits::Box | Limits::Rigid => self.is_touched() && self.gram.exceeds(self.release_quality),
        }
    }

    fn is_touched(&self) -> bool {
        self.set.touched_by(|link| self.is_link[link])
    }
}
