//! The state of a grasp, to save and restore.
//!
//! It holds what the next step depends on and cannot be computed anew: the phase machine, and while latched the forces and
//! active sets of the last step, from which contacts, other constraints and the two passes of the solve start. What finds
//! contacts is left out: a step that skips MuJoCo's collision stage has the same contacts as one that does not (see
//! [`super::monitor::detector`]), so when the stage is skipped cannot be seen in the result.

use super::cones::arrow::RootVector;
use super::cones::coupled::SavedConstraint;
use super::contact::contacts::SavedContact;
use super::error::Error;
use super::monitor::phase::Phase;
use super::settings::Settings;
use super::spec::{AxisSoftness, GraspSpec, Limits};
use super::weld::solve::MergedState;
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
    /// Simulated time of good quality so far while ungrasped, or without hold while grasped \[s\].
    pub(super) counted: f64,
    pub(super) may_latch: bool,
    /// These are empty while ungrasped.
    pub(super) contacts: Vec<SavedContact>,
    pub(super) coupled: Vec<SavedConstraint>,
    pub(super) warm_start: [RootVector; 2],
    pub(super) merged: Option<MergedState>,
}

/// Which grasp a state is of: the structure of its model, and its spec with all defaults filled in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Identity {
    model: Structure,
    target: usize,
    palm: usize,
    links: Vec<usize>,
    limits: Limits,
    /// `Q_Th` and `Q_M` \[N\].
    thresholds: [f64; 2],
    /// Of latch and release \[s\].
    times: [f64; 2],
    /// What [`Limits::Box`] bounds: axes, and their orientation (w, x, y, z).
    bounded: Option<([bool; 6], [f64; 4])>,
    /// Spring and damper of each of the weld's axes, where they are given.
    softness: [Option<AxisSoftness>; 6],
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
            model: Structure::of(model),
            target: spec.target.index(),
            palm: palm.index(),
            links: links.iter().map(|link| link.index()).collect(),
            limits: spec.limits,
            thresholds,
            times: [spec.latch_time, spec.release_time],
            bounded: (spec.limits == Limits::Box).then_some((spec.relaxed, [q.w, q.i, q.j, q.k])),
            softness: spec.softness(),
        }
    }

    /// That a state of `other` is one of this grasp.
    fn check(&self, other: &Identity) -> Result<(), Error> {
        if let Some((what, saved, here)) = other.model.difference(&self.model) {
            return Err(Error::OtherState { what, saved, here });
        }
        same("target", &other.target, &self.target)?;
        same("palm", &other.palm, &self.palm)?;
        same("list of effectors", &other.links, &self.links)?;
        same("limits", &other.limits, &self.limits)?;
        same("pair of latch_quality and release_quality", &other.thresholds, &self.thresholds)?;
        same("pair of latch_time and release_time", &other.times, &self.times)?;
        same("choice of relaxed axes", &other.bounded, &self.bounded)?;
        same("softness of the weld's axes", &other.softness, &self.softness)
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
            counted: 0.0,
            may_latch: true,
            contacts: Vec::new(),
            coupled: Vec::new(),
            warm_start: Default::default(),
            merged: None,
        }
    }

    /// That this is a sound state of the grasp `of`.
    pub(super) fn check(&self, of: &Identity) -> Result<(), Error> {
        of.check(&self.grasp)?;
        sound("time of good quality or without hold", self.counted.is_finite() && self.counted >= 0.0)?;
        sound("warm start", self.warm_start.iter().flatten().all(|x| x.is_finite()))?;
        let known = |(a, b): (usize, usize)| a < of.model.geoms && b < of.model.geoms;
        sound("list of contacts", self.contacts.iter().all(|c| c.is_finite() && known(c.geoms)))?;
        let constraint = |n: &SavedConstraint| n.is_sound() && n.geoms().is_none_or(known);
        sound("list of other constraints", self.coupled.iter().all(constraint))?;
        if let Some(merged) = &self.merged {
            let bounds = [merged.bounds.force, merged.bounds.torque];
            sound("list of merged contacts", merged.contacts.iter().all(|c| c.is_finite() && known(c.geoms())))?;
            sound("memory of soft axes", merged.soft.is_sound())?;
            sound("merged wrench", merged.wrench.iter().all(|x| x.is_finite()))?;
            sound("pair of bounds", bounds.iter().all(|x| x.is_finite() && *x >= 0.0))?;
        }
        let latched = self.phase == Phase::Grasped;
        let cones = of.limits == Limits::Cones;
        sound("merged part", self.merged.is_some() == (latched && !cones))?;
        sound("memory of contacts", (latched && cones) || (self.contacts.is_empty() && self.coupled.is_empty()))
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

/// How a model hangs together. Sizes, masses and friction are not in it: a state may go on with others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Structure {
    bodies: usize,
    geoms: usize,
    dofs: usize,
    /// FNV-1a over the arrays that say what belongs to what.
    checksum: u32,
}

impl Structure {
    pub(super) fn of(model: &CompiledModel) -> Self {
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
        let mix = |hash: u32, byte: u8| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        let checksum = words.flat_map(i32::to_le_bytes).fold(0x811c_9dc5, mix);
        Structure { bodies: model.nbody(), geoms: model.ngeom(), dofs: model.nv(), checksum }
    }

    /// What the first difference is called, and what it is here and in the other.
    fn difference(&self, other: &Structure) -> Option<(&'static str, String, String)> {
        let counts = [
            ("number of bodies", self.bodies, other.bodies),
            ("number of geoms", self.geoms, other.geoms),
            ("number of degrees of freedom", self.dofs, other.dofs),
            ("model's structure (a checksum)", self.checksum as usize, other.checksum as usize),
        ];
        let (what, here, there) = counts.into_iter().find(|(_, here, there)| here != there)?;
        Some((what, here.to_string(), there.to_string()))
    }

    /// That a simulation of the model `other` can be stepped with grasps for this one.
    pub(super) fn check(&self, other: &Structure) -> Result<(), Error> {
        match self.difference(other) {
            Some((what, here, there)) => Err(Error::OtherModel { what, grasps: here, simulation: there }),
            None => Ok(()),
        }
    }
}

/// What all [`Grasps`](super::Grasps) of a simulation remember from step to step; see [`GraspState`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GraspsState {
    pub(super) grasps: Vec<GraspState>,
    /// The user's solver settings, while a merged grasp has others.
    pub(super) settings: Option<Settings>,
}

impl GraspsState {
    /// Of each grasp, in the order in which they were added.
    pub fn grasps(&self) -> &[GraspState] {
        &self.grasps
    }

    /// That it is of so many grasps, with settings that the engine has.
    pub(super) fn check(&self, grasps: usize) -> Result<(), Error> {
        same("number of grasps", &self.grasps.len(), &grasps)?;
        sound("solver settings", self.settings.is_none_or(|settings| settings.are_known()))
    }
}
