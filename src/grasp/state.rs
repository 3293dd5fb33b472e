//! The state of a grasp, to save and restore.
//!
//! It holds what the next step depends on and cannot be computed anew: the phase machine, and while latched the forces and
//! cone zones of the last step, from which contacts, other constraints and the two passes of the solve start. What finds
//! contacts is left out: a step that skips MuJoCo's collision stage has the same contacts as one that does not (see
//! [`super::detector`]), so when the stage is skipped cannot be seen in the result.

use super::arrow::RootVector;
use super::error::Error;
use super::merged_solve::MergedState;
use super::phase::Phase;
use super::spec::{GraspSpec, Limits};
use super::weld::Settings;
use super::{contacts, neighbours};
use crate::mujoco::{BodyId, CompiledModel};
use serde::{Deserialize, Serialize};
use std::fmt::Debug;

/// Everything that a [`Grasp`](super::Grasp) remembers from step to step: with the
/// [`State`](crate::mujoco::State) of its simulation, a replay is the same bit for bit. See
/// [`Snapshot`](super::Snapshot) for both in one.
///
/// It can be written with any serde format that keeps all bits of an `f64`; for JSON, with serde_json's feature
/// `float_roundtrip`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspState {
    pub(super) grasp: Identity,
    pub(super) phase: Phase,
    /// Simulated time of good quality so far \[s\].
    pub(super) good_for: f64,
    pub(super) may_latch: bool,
    /// The user's solver settings, while a merged grasp has others.
    pub(super) settings: Option<Settings>,
    /// These are empty while ungrasped.
    pub(super) contacts: Vec<contacts::Past>,
    pub(super) neighbours: Vec<neighbours::Past>,
    pub(super) warm_start: [RootVector; 2],
    pub(super) merged: Option<MergedState>,
}

/// Which grasp a state is of: the structure of its model, and its spec with all defaults filled in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Identity {
    bodies: usize,
    geoms: usize,
    dofs: usize,
    /// Checksum of how bodies, joints and geoms hang together.
    structure: u32,
    target: usize,
    palm: usize,
    links: Vec<usize>,
    limits: Limits,
    /// `Q_Th` and `Q_M` \[N\].
    thresholds: [f64; 2],
    /// \[s\]
    latch_time: f64,
    /// What [`Limits::Box`] bounds: axes, and their orientation (w, x, y, z).
    bounded: Option<([bool; 6], [f64; 4])>,
}

impl Identity {
    pub(super) fn new(
        model: &CompiledModel,
        spec: &GraspSpec,
        (palm, links): (BodyId, &[BodyId]),
        thresholds: [f64; 2],
    ) -> Self {
        let q = spec.axes.quaternion();
        Identity {
            bodies: model.nbody(),
            geoms: model.ngeom(),
            dofs: model.nv(),
            structure: structure(model),
            target: spec.target.index(),
            palm: palm.index(),
            links: links.iter().map(|link| link.index()).collect(),
            limits: spec.limits,
            thresholds,
            latch_time: spec.latch_time,
            bounded: (spec.limits == Limits::Box).then_some((spec.relaxed, [q.w, q.i, q.j, q.k])),
        }
    }

    /// That a state of `other` is one of this grasp.
    fn check(&self, other: &Identity) -> Result<(), Error> {
        same("number of bodies", &other.bodies, &self.bodies)?;
        same("number of geoms", &other.geoms, &self.geoms)?;
        same("number of degrees of freedom", &other.dofs, &self.dofs)?;
        same("model's structure (a checksum)", &other.structure, &self.structure)?;
        same("target", &other.target, &self.target)?;
        same("palm", &other.palm, &self.palm)?;
        same("list of effectors", &other.links, &self.links)?;
        same("limits", &other.limits, &self.limits)?;
        same("pair of latch_quality and release_quality", &other.thresholds, &self.thresholds)?;
        same("latch_time", &other.latch_time, &self.latch_time)?;
        same("choice of relaxed axes", &other.bounded, &self.bounded)
    }
}

impl GraspState {
    /// The phase that the grasp was in.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Of a grasp that has done nothing.
    pub(super) fn empty(grasp: Identity) -> Self {
        GraspState {
            grasp,
            phase: Phase::Ungrasped,
            good_for: 0.0,
            may_latch: true,
            settings: None,
            contacts: Vec::new(),
            neighbours: Vec::new(),
            warm_start: Default::default(),
            merged: None,
        }
    }

    /// That this is a sound state of the grasp `of`.
    pub(super) fn check(&self, of: &Identity) -> Result<(), Error> {
        of.check(&self.grasp)?;
        sound("time of good quality", self.good_for.is_finite() && self.good_for >= 0.0)?;
        sound("solver settings", self.settings.is_none_or(|settings| settings.are_known()))?;
        sound("warm start", self.warm_start.iter().flatten().all(|x| x.is_finite()))?;
        let known = |(a, b): (usize, usize)| a < of.geoms && b < of.geoms;
        sound("list of contacts", self.contacts.iter().all(|c| c.is_finite() && known(c.geoms)))?;
        let neighbour = |n: &neighbours::Past| n.is_sound() && n.geoms().is_none_or(known);
        sound("list of other constraints", self.neighbours.iter().all(neighbour))?;
        if let Some(merged) = &self.merged {
            let bounds = [merged.bounds.force, merged.bounds.torque];
            sound("list of merged contacts", merged.contacts.iter().all(|c| c.is_finite() && known(c.geoms())))?;
            sound("merged wrench", merged.wrench.iter().all(|x| x.is_finite()))?;
            sound("pair of bounds", bounds.iter().all(|x| x.is_finite() && *x >= 0.0))?;
        }
        let latched = self.phase == Phase::Grasped;
        let cones = of.limits == Limits::Cones;
        sound("merged part", self.merged.is_some() == (latched && !cones))?;
        sound("memory of contacts", (latched && cones) || (self.contacts.is_empty() && self.neighbours.is_empty()))
    }
}

fn same<T: PartialEq + Debug>(what: &'static str, saved: &T, here: &T) -> Result<(), Error> {
    if saved == here {
        return Ok(());
    }
    Err(Error::OtherState { what, saved: format!("{saved:?}"), here: format!("{here:?}") })
}

fn sound(what: &'static str, is: bool) -> Result<(), Error> {
    if is { Ok(()) } else { Err(Error::BadState(what)) }
}

/// FNV-1a over how the parts of a model hang together. Sizes, masses and friction are not in it: a state may go on with
/// others.
fn structure(model: &CompiledModel) -> u32 {
    let parts = [
        model.body_parentid(),
        model.body_dofnum(),
        model.geom_bodyid(),
        model.geom_type(),
        model.dof_parentid(),
        model.eq_obj1id(),
        model.eq_obj2id(),
    ];
    let words = parts.into_iter().flat_map(|part| part.iter().copied().chain([part.len() as i32]));
    words.flat_map(i32::to_le_bytes).fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}
