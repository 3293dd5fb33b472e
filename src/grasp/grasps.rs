//! The grasps of one simulation: each with its own phase and quality, solved together where they move each other.

use super::controller::Grasp;
use super::error::Error;
use super::force::GraspForce;
use super::frozen::Frozen;
use super::monitor::detector::Detector;
use super::settings::Settings;
use super::spec::GraspSpec;
use super::state::{GraspsState, Structure};
use super::weld::bounded_rows::BoundedRows;
use crate::mujoco::{BodyId, Simulation};
use std::ops::{Index, IndexMut};

/// All grasps of a simulation, to be stepped with it; see [`step`](Self::step).
///
/// It belongs to one model: any simulation of that model can be stepped with it, one after the other even, and one of
/// another model is an error. Grasps are added at any time and keep their handles.
#[derive(Clone, Debug, Default)]
pub struct Grasps {
    pub(super) list: Vec<Grasp>,
    /// Of the model; `None` before the first grasp.
    model: Option<(u64, Structure)>,
    pub(super) force: GraspForce,
    pub(super) bounded_rows: BoundedRows,
    pub(super) detector: Detector,
    pub(super) frozen: Frozen,
    /// The user's solver settings, while a merged grasp has others.
    pub(super) settings: Option<Settings>,
}

/// Handle of one of the [`Grasps`], in the order in which they were added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GraspId(usize);

impl GraspId {
    /// The grasp that was added first.
    pub const FIRST: GraspId = GraspId(0);

    /// The handle of a grasp by its place in the order in which they were added, from 0.
    pub(crate) fn nth(index: usize) -> Self {
        GraspId(index)
    }

    /// Place in the order in which grasps were added, from 0.
    pub fn index(self) -> usize {
        self.0
    }
}

impl Grasps {
    /// None yet: [`add`](Self::add) them.
    pub fn new() -> Self {
        Self::default()
    }

    /// One grasp, with the handle [`GraspId::FIRST`].
    ///
    /// # Errors
    /// As [`add`](Self::add).
    pub fn of(sim: &Simulation, spec: &GraspSpec) -> Result<Self, Error> {
        let mut grasps = Self::new();
        grasps.add(sim, spec)?;
        Ok(grasps)
    }

    /// Checks a grasp against the model of `sim` and adds it.
    ///
    /// # Errors
    /// A simulation of another model than that of the grasps before. Bodies that the model does not have; no hand or
    /// several, where neither palm nor effectors are given; a target that is static or part of the hand; effectors that are
    /// the target or outside the hand; a hand that shares a link with that of another grasp of the same target; thresholds that
    /// are not positive and ordered; times that are negative or not finite; an integrator whose step cannot be taken apart (RK4).
    pub fn add(&mut self, sim: &Simulation, spec: &GraspSpec) -> Result<GraspId, Error> {
        self.check_model(sim)?;
        let grasp = Grasp::new(sim, spec)?;
        self.check_shares_no_link(sim, &grasp)?;
        self.list.push(grasp);
        self.model.get_or_insert_with(|| (sim.model().origin(), Structure::of(sim.model())));
        Ok(GraspId(self.list.len() - 1))
    }

    /// What two grasps of a target both hold it by would be divided between them at random.
    fn check_shares_no_link(&self, sim: &Simulation, grasp: &Grasp) -> Result<(), Error> {
        let shared = |(index, other): (usize, &Grasp)| {
            let link = other.topology().shared_with(grasp.topology())?;
            Some((index, other.palm(), BodyId::from_index(link)))
        };
        let Some((index, palm, link)) = self.list.iter().enumerate().find_map(shared) else { return Ok(()) };
        let [link, target, palm] = [link, grasp.target(), palm].map(|body| sim.model().label(body));
        Err(Error::SharedLink { link, target, grasp: index, palm })
    }

    /// Number of grasps.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// True without any grasp.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The grasp with this handle; `None` for a handle of other [`Grasps`] that are more.
    pub fn get(&self, id: GraspId) -> Option<&Grasp> {
        self.list.get(id.0)
    }

    /// As [`get`](Self::get).
    pub fn get_mut(&mut self, id: GraspId) -> Option<&mut Grasp> {
        self.list.get_mut(id.0)
    }

    /// Handles, in the order in which the grasps were added.
    pub fn ids(&self) -> impl ExactSizeIterator<Item = GraspId> + use<> {
        (0..self.list.len()).map(GraspId)
    }

    /// All grasps in that order.
    pub fn iter(&self) -> std::slice::Iter<'_, Grasp> {
        self.list.iter()
    }

    /// As [`iter`](Self::iter).
    pub fn iter_mut(&mut self) -> std::slice::IterMut<'_, Grasp> {
        self.list.iter_mut()
    }

    /// After a step of the engine's own ([`Simulation::step`]): reads contacts, forces and quality of all grasps, and
    /// counts good time without latching.
    ///
    /// # Errors
    /// A simulation of another model; what the engine reports.
    pub fn monitor(&mut self, sim: &Simulation) -> Result<(), Error> {
        self.check_model(sim)?;
        self.list.iter_mut().try_for_each(|grasp| grasp.monitor(sim))
    }

    /// What the next step depends on, to be taken between two steps. A replay also needs the simulation's own
    /// [`save`](Simulation::save): [`Snapshot`](super::Snapshot) has both.
    #[must_use]
    pub fn save(&self) -> GraspsState {
        let mut state = GraspsState::default();
        self.save_into(&mut state);
        state
    }

    /// Writes the current state over `state`, reusing its memory.
    pub fn save_into(&self, state: &mut GraspsState) {
        state.settings = self.settings;
        state.grasps.truncate(self.list.len());
        for (i, grasp) in self.list.iter().enumerate() {
            match state.grasps.get_mut(i) {
                Some(state) => grasp.save_into(state),
                None => state.grasps.push(grasp.save()),
            }
        }
    }

    /// All grasps are as when they were added: ungrasped, allowed to latch, with nothing counted or remembered. For a simulation
    /// that begins anew, which then goes as the first time.
    pub fn reset(&mut self) {
        self.list.iter_mut().for_each(Grasp::reset);
        self.forget_geometry();
    }

    /// What was found out of how far things are apart would decide which of the next steps are whole.
    fn forget_geometry(&mut self) {
        self.frozen.forget();
        self.detector = Detector::default();
    }

    /// Goes back to a saved state, of these grasps or of others that were made with the same specs in another simulation of
    /// the same model, be it in another process. [`Grasp::contacts`] are empty and [`Grasp::quality`] is 0 until the next
    /// step.
    ///
    /// Solver settings of the simulation that a merged grasp has changed stay as they are until that step, which sees to
    /// them.
    ///
    /// # Errors
    /// Another number of grasps; a state of another model or another spec, or one with numbers that no grasp can have;
    /// nothing is changed then.
    pub fn restore(&mut self, state: &GraspsState) -> Result<(), Error> {
        self.check_state(state)?;
        // if this simulation's settings are changed now, what they were is known here
        self.settings = self.settings.or(state.settings);
        for (grasp, state) in self.list.iter_mut().zip(&state.grasps) {
            grasp.restore(state);
        }
        self.forget_geometry();
        Ok(())
    }

    /// That [`restore`](Self::restore) accepts `state`.
    pub(super) fn check_state(&self, state: &GraspsState) -> Result<(), Error> {
        state.check(self.list.len())?;
        self.list.iter().zip(&state.grasps).try_for_each(|(grasp, state)| grasp.check_state(state))
    }

    /// That `sim` is of the model that the grasps are made for: compiled as one with it, or alike in structure.
    pub(super) fn check_model(&mut self, sim: &Simulation) -> Result<(), Error> {
        match &mut self.model {
            Some((origin, structure)) if *origin != sim.model().origin() => {
                structure.check(&Structure::of(sim.model()))?;
                *origin = sim.model().origin();
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl Index<GraspId> for Grasps {
    type Output = Grasp;

    /// # Panics
    /// As a slice does, where [`get`](Grasps::get) gives `None`.
    fn index(&self, id: GraspId) -> &Grasp {
        &self.list[id.0]
    }
}

impl IndexMut<GraspId> for Grasps {
    /// # Panics
    /// As a slice does, where [`get_mut`](Grasps::get_mut) gives `None`.
    fn index_mut(&mut self, id: GraspId) -> &mut Grasp {
        &mut self.list[id.0]
    }
}

impl<'a> IntoIterator for &'a Grasps {
    type Item = &'a Grasp;
    type IntoIter = std::slice::Iter<'a, Grasp>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}
