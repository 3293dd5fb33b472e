//! One grasp: who holds what, its phase and its live contacts.

use super::bounds::Bounds;
use super::contacts::{ContactSet, GraspContact};
use super::detector::Detector;
use super::error::Error;
use super::merged_solve::MergedSolver;
use super::mobility::Dynamics;
use super::neighbours::Neighbours;
use super::phase::{Observation, Phase, PhaseMachine};
use super::quality::{self, Gram};
use super::softness::{ConeKind, SolverOptions};
use super::solve::{GraspSolver, SolveStatus};
use super::step::GraspForce;
use super::topology::{Topology, Tree, is_ancestor, lowest_common_ancestor};
use super::weld::{self, Settings};
use super::wrench::ContactForce;
use crate::mujoco::{BodyId, Cone, DISABLE_REFSAFE, EqualityId, Integrator, Simulation};
use nalgebra::{UnitQuaternion, Vector3, Vector6};

/// What stands for the contacts while the grasp is latched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Limits {
    /// Each contact's friction cone: the grasp holds, slides and opens as the contacts would.
    #[default]
    Cones,
    /// The thesis's Eqs. 4.1 to 4.3: one bound on each axis of a weld with the merged effectors.
    Box,
    /// A weld with the merged effectors, without bounds.
    Rigid,
}

impl Limits {
    /// The name in scenario files.
    pub fn name(self) -> &'static str {
        match self {
            Limits::Cones => "cones",
            Limits::Box => "box",
            Limits::Rigid => "rigid",
        }
    }
}

/// A grasp as the user describes it.
#[derive(Clone, Debug)]
pub struct GraspSpec {
    /// Body that is grasped.
    pub target: BodyId,
    /// Links that may hold it; empty: every link below the palm.
    pub effectors: Vec<BodyId>,
    /// Base of the fingers; `None`: the lowest common ancestor of the effectors.
    pub palm: Option<BodyId>,
    /// Quality at which the grasp latches, `Q_Th` \[N\]; `None`: from the target's weight.
    pub latch_quality: Option<f64>,
    /// Quality below which it is given up, `Q_M` \[N\]; `None`: from `Q_Th`.
    pub release_quality: Option<f64>,
    /// Simulated time for which the quality must be good before the grasp latches \[s\].
    pub latch_time: f64,
    /// What stands for the contacts.
    pub limits: Limits,
    /// Axes that may slip (x, y, z, then rotations), [`Limits::Box`] only.
    pub relaxed: [bool; 6],
    /// Orientation of those axes in the target's frame, [`Limits::Box`] only.
    pub axes: UnitQuaternion<f64>,
}

/// Simulated time of good quality after which a grasp latches, unless set otherwise \[s\].
pub const DEFAULT_LATCH_TIME: f64 = 0.05;

impl GraspSpec {
    /// A grasp of `target` by every link below `palm`, with all defaults.
    pub fn new(target: BodyId, palm: BodyId) -> Self {
        GraspSpec {
            target,
            effectors: Vec::new(),
            palm: Some(palm),
            latch_quality: None,
            release_quality: None,
            latch_time: DEFAULT_LATCH_TIME,
            limits: Limits::default(),
            relaxed: [true; 6],
            axes: UnitQuaternion::identity(),
        }
    }
}

/// Controller and monitor of one grasp.
#[derive(Clone, Debug)]
pub struct Grasp {
    target: BodyId,
    palm: BodyId,
    links: Vec<BodyId>,
    is_link: Vec<bool>,
    limits: Limits,
    merged: Option<(EqualityId, MergedSolver)>,
    settings: Option<Settings>,
    latch_quality: f64,
    release_quality: f64,
    machine: PhaseMachine,
    topology: Topology,
    detector: Detector,
    set: ContactSet,
    gram: Gram,
    solver: GraspSolver,
    neighbours: Neighbours,
    status: SolveStatus,
    live: Vec<ContactForce>,
    force: GraspForce,
}

impl Grasp {
    /// Checks a grasp against the model and prepares it.
    ///
    /// # Errors
    /// A target that is static or part of the hand, effectors that are the target or outside the hand, thresholds that
    /// are not positive and ordered, or an integrator whose step cannot be taken apart (RK4).
    pub fn new(sim: &Simulation, spec: &GraspSpec) -> Result<Grasp, Error> {
        let model = sim.model();
        let name = |body: BodyId| model.label(body);
        let parents = model.body_parentid();
        if model.integrator() == Integrator::Rk4 {
            return Err(Error::Integrator);
        }
        let effectors: Vec<usize> = spec.effectors.iter().map(|b| b.index()).collect();
        let palm = match spec.palm {
            Some(palm) => palm,
            None if effectors.is_empty() => return Err(Error::NoHand),
            None => BodyId::from_index(palm_of(parents, &effectors)),
        };
        if let Some(&e) = spec.effectors.iter().find(|e| is_ancestor(parents, spec.target.index(), e.index())) {
            return Err(Error::EffectorIsTarget(name(e)));
        }
        if let Some(&e) = spec.effectors.iter().find(|e| !is_ancestor(parents, palm.index(), e.index())) {
            return Err(Error::EffectorOutsideHand { effector: name(e), palm: name(palm) });
        }
        let tree = Tree {
            body_parent: parents,
            body_dofadr: model.body_dofadr(),
            body_dofnum: model.body_dofnum(),
            dof_parent: model.dof_parentid(),
            dof_body: model.dof_bodyid(),
        };
        let topology = Topology::new(&tree, palm.index(), &effectors, spec.target.index());
        if topology.shares_tree(&tree) {
            return Err(Error::TargetInHand { target: name(spec.target), palm: name(palm) });
        }
        if topology.leaf(spec.target.index()).is_none() {
            return Err(Error::StaticTarget(name(spec.target)));
        }
        let links = if spec.effectors.is_empty() {
            model
                .bodies()
                .filter(|b| {
                    b.index() != palm.index() && topology.in_hand(b.index()) && model.body_geomnum()[b.index()] > 0
                })
                .collect()
        } else {
            spec.effectors.clone()
        };
        if links.is_empty() {
            return Err(Error::NoEffectors(name(palm)));
        }
        let weight = model.body_subtreemass()[spec.target.index()] * model.gravity().norm();
        let merged = match spec.limits {
            Limits::Cones => None,
            Limits::Box | Limits::Rigid => {
                let weld = weld::find(sim, &topology, spec.limits, &name(spec.target))?;
                let (limits, relaxed, axes) = (spec.limits, spec.relaxed, spec.axes);
                Some((weld, MergedSolver::new(model, &topology, spec.target, limits, relaxed, axes)))
            }
        };
        let (latch_quality, release_quality) = thresholds(spec, weight)?;
        let mut is_link = vec![false; parents.len()];
        for link in &links {
            is_link[link.index()] = true;
        }
        let detector = Detector::new(sim, &topology)?;
        Ok(Grasp {
            target: spec.target,
            palm,
            links,
            is_link,
            limits: spec.limits,
            merged,
            settings: None,
            latch_quality,
            release_quality,
            machine: PhaseMachine::new(spec.latch_time),
            set: ContactSet::default(),
            gram: Gram::new(Vector3::zeros(), 0.0),
            solver: GraspSolver::new(&topology, model.dof_parentid()),
            neighbours: Neighbours::default(),
            status: SolveStatus::default(),
            topology,
            detector,
            live: Vec::new(),
            force: GraspForce::default(),
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

    /// True once the quality has been at `Q_Th`, with contact, for the latch time.
    pub fn would_latch(&self) -> bool {
        self.machine.phase() == Phase::Grasped || self.machine.is_ripe()
    }

    /// Gives the contacts back to the engine.
    pub fn release(&mut self) {
        self.machine.release();
        self.solver.reset();
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
    ///
    /// # Errors
    /// What the engine reports.
    pub fn monitor(&mut self, sim: &Simulation) -> Result<(), Error> {
        self.read_engine_contacts(sim)?;
        let now = self.observation(sim);
        self.machine.count(now);
        Ok(())
    }

    /// After an ungrasped step: reads contacts and forces, and latches when they are good.
    pub(super) fn observe_ungrasped(&mut self, sim: &Simulation) -> Result<(), Error> {
        self.read_engine_contacts(sim)?;
        let now = self.observation(sim);
        if self.machine.observe(now) == Phase::Grasped {
            self.solver.reset();
            let options = solver_options(sim);
            if let Some((_, merged)) = &mut self.merged {
                merged.begin(sim, &self.topology, &options, self.set.contacts());
            }
        }
        Ok(())
    }

    /// After a grasped step: releases when the quality is no longer sufficient.
    pub(super) fn observe_grasped(&mut self, sim: &Simulation) {
        self.measure(sim);
        let now = self.observation(sim);
        if self.machine.observe(now) == Phase::Ungrasped {
            self.solver.reset();
        }
    }

    /// Slip velocities of the last step's contacts (not needed by the grasp itself).
    pub fn read_slip(&mut self, sim: &Simulation) {
        self.set.read_slip(sim);
    }

    /// Lends the buffer of the generalised force, zeroed.
    pub(super) fn borrow_force(&mut self, nv: usize) -> GraspForce {
        std::mem::take(&mut self.force).cleared(nv)
    }

    /// Takes the buffer back.
    pub(super) fn return_force(&mut self, force: GraspForce) {
        self.force = force;
    }

    fn read_engine_contacts(&mut self, sim: &Simulation) -> Result<(), Error> {
        self.set.read(sim.contacts(), sim, &self.topology);
        self.set.read_forces(sim)?;
        self.measure(sim);
        Ok(())
    }

    fn measure(&mut self, sim: &Simulation) {
        let com = sim.body_com(self.target);
        self.live.clear();
        self.live.extend(self.set.contacts().iter().filter(|c| self.is_link[c.link]).map(|c| c.contact_force()));
        self.gram = Gram::of(&self.live, &com);
    }

    fn observation(&self, sim: &Simulation) -> Observation {
        Observation {
            good: self.gram.exceeds(self.latch_quality),
            sufficient: self.gram.exceeds(self.release_quality),
            touching: self.set.touched_by(|link| self.is_link[link]),
            elapsed: sim.model().timestep(),
        }
    }

    /// Finds the contacts in the place of the engine's collision stage; false if the engine has to look itself, because
    /// something else might touch something.
    pub(super) fn detect_alone(&mut self, sim: &mut Simulation) -> Result<bool, Error> {
        let alone = self.detector.replaces_collision(sim)?;
        if alone {
            for contact in self.detector.found() {
                sim.append_contact(contact);
            }
            self.set.read(self.detector.found().iter().cloned(), sim, &self.topology);
        }
        Ok(alone)
    }

    /// Takes the contacts out of the engine's solve, between collision and constraint making.
    pub(super) fn take_contacts(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        self.set.read(sim.contacts(), sim, &self.topology);
        for contact in self.set.contacts() {
            sim.exclude_contact(contact.index)?;
        }
        Ok(())
    }

    /// True while this grasp's constraint is the weld.
    pub(super) fn is_merged(&self) -> bool {
        self.merged.is_some() && self.machine.phase() == Phase::Grasped
    }

    /// True if the weld is to have rows in this step.
    pub(super) fn wants_weld(&self) -> bool {
        self.is_merged() && !self.set.contacts().is_empty()
    }

    /// The weld of a merged grasp.
    pub(super) fn weld(&self) -> Option<EqualityId> {
        self.merged.as_ref().map(|(weld, _)| *weld)
    }

    /// Number of the weld's rows that have bounds.
    pub(super) fn relaxed_count(&self) -> usize {
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
    pub(super) fn write_weld_rows(
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
    pub(super) fn load_merged(&mut self, sim: &mut Simulation, out: &mut [f64]) -> Result<(), Error> {
        let Some((_, merged)) = &mut self.merged else { return Ok(()) };
        merged.load(sim, &self.topology, self.set.contacts(), out)
    }

    /// Reads the contacts' forces from the solved weld rows.
    pub(super) fn read_merged(&mut self, sim: &Simulation) {
        if let Some((_, merged)) = &mut self.merged {
            merged.read(sim, self.set.contacts_mut());
        }
    }

    /// The user's solver settings, while a merged grasp keeps them.
    pub(super) fn settings(&self) -> Option<&Settings> {
        self.settings.as_ref()
    }

    /// As [`settings`](Self::settings), to keep them.
    pub(super) fn settings_mut(&mut self) -> &mut Option<Settings> {
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

    /// Solves the grasp and adds its generalised force to `out`.
    pub(super) fn solve_cones(&mut self, sim: &Simulation, out: &mut [f64]) -> Result<(), Error> {
        let model = sim.model();
        let dynamics = Dynamics {
            dof_parent: model.dof_parentid(),
            dof_body: model.dof_bodyid(),
            dof_address: model.dof_Madr(),
            factor: sim.qLD(),
            inverse_diagonal: sim.qLDiagInv(),
            dof_axis: sim.cdof(),
            composite_inertia: sim.crb(),
            body_root: model.body_rootid(),
            subtree_com: sim.subtree_com(),
            body_velocity: sim.cvel(),
            acceleration: sim.qacc_smooth(),
        };
        let options = solver_options(sim);
        self.neighbours.read(sim)?;
        let contacts = self.set.contacts_mut();
        self.status = self.solver.solve(&dynamics, &self.topology, &options, contacts, &mut self.neighbours);
        let finite = |c: &GraspContact| c.force.iter().chain(c.torque.iter()).all(|x| x.is_finite());
        if !self.set.contacts().iter().all(finite) {
            return Err(Error::Diverged { time: sim.time(), what: "a contact force" });
        }
        self.solver.add_forces(&dynamics, &self.topology, self.set.contacts(), out);
        Ok(())
    }
}

impl Grasp {
    /// Number of the engine's rows that were solved together with the grasp in this step.
    pub(super) fn solved_rows(&self) -> usize {
        if self.limits == Limits::Cones { self.neighbours.solved_rows() } else { 0 }
    }

    /// Writes the forces of those rows.
    pub(super) fn write_row_forces(&self, sim: &mut Simulation) {
        self.neighbours.write_forces(sim);
    }

    /// Shows the engine the forces of the contacts, from `offset` numbers behind its rows on, and moves `offset` on. In a
    /// merged grasp the weld's rows carry them already.
    pub(super) fn show_forces(&self, sim: &mut Simulation, offset: &mut usize) -> Result<(), Error> {
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

fn solver_options(sim: &Simulation) -> SolverOptions {
    let model = sim.model();
    SolverOptions {
        timestep: model.timestep(),
        refsafe: model.disable_flags() & DISABLE_REFSAFE == 0,
        impratio: model.impratio(),
        cone: if model.cone() == Cone::Elliptic { ConeKind::Elliptic } else { ConeKind::Pyramidal },
    }
}

/// The base of fingers given by their links: the lowest common ancestor, and for a single link its parent.
fn palm_of(parents: &[i32], effectors: &[usize]) -> usize {
    let ancestor = lowest_common_ancestor(parents, effectors);
    if effectors.contains(&ancestor) { parents[ancestor] as usize } else { ancestor }
}

fn thresholds(spec: &GraspSpec, weight: f64) -> Result<(f64, f64), Error> {
    let latch = spec.latch_quality.unwrap_or_else(|| quality::default_latch_quality(weight));
    if !(latch.is_finite() && latch > 0.0) {
        return Err(Error::Threshold { name: "latch_quality", value: latch, expected: "it must be a positive number" });
    }
    let release = spec.release_quality.unwrap_or_else(|| quality::default_release_quality(latch));
    if !(release >= 0.0 && release < latch) {
        return Err(Error::Threshold {
            name: "release_quality",
            value: release,
            expected: "it must be at least 0 and below latch_quality",
        });
    }
    Ok((latch, release))
}
