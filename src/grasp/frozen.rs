//! Steps on frozen geometry: between two whole steps a held grasp hardly moves, and what follows from positions need not be
//! computed anew.
//!
//! A frozen step keeps poses, inertia, contact points and constraint Jacobians of the last whole step. Distances and lengths
//! move on linearly, and everything that does not follow from positions is computed as in a whole step: velocities,
//! actuators, springs, limits, the contacts' cones in both passes. So the grasp sticks, slides, opens and gives way as ever.
//! What is left out is how lever arms turn under the contact forces; what that comes to in first order is added
//! ([`Grasps::measure_turn`]). When anything has turned by more than a tolerance, has slid as far, or may have come near
//! something else, the next step is a whole one.

// A motion that is not a number must count as too far: `!(a < b)` says that, `a >= b` does not.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod motion;

use super::Grasps;
use super::cones::dynamics::Dynamics;
use super::controller::Grasp;
use super::error::Error;
use super::hand::topology::Topology;
use super::linalg::axpy;
use super::monitor::phase::Phase;
use crate::mujoco::{Simulation, Stamp};
use nalgebra::Vector3;

/// Most frozen steps in a row.
const MAX_STEPS: usize = 12;

/// Angle by which a hand and its target may turn against the palm between two whole steps, unless it is set otherwise \[rad\].
pub const TOLERANCE: f64 = 2e-3;

/// What turns in the world, as an arm that carries a grasp does, counts so much of what turns against the palm: no contact's
/// lever arms change, only the directions of weight and inertia in the grasp's frame. Not so where several grasps are latched:
/// hands that hold one target press on each other through their arms.
const CARRIED: f64 = 0.2;

/// Most steps with one inertia: joints that slide change it, too, and turn nothing.
const INERTIA_STEPS: usize = 4 * MAX_STEPS;

/// So many whole steps in a row must have the same contacts, about where they were: one that bounces is found again in whole
/// steps only.
const SETTLED: usize = 3;

/// Where more than a third of the stretches of frozen steps have a [swing](Frozen::swings_back), by so many twice counted, each
/// further one is followed by a pause of so many whole steps: a contact that rolls further than its bodies move, and is found late,
/// keeps up a trembling, which whole steps end.
const SWINGS: u32 = 8;
const PAUSE: usize = 96;

/// What moves more slowly is at rest \[m/s or rad/s\]: contact points that are found by iterations can make whole steps swing by a
/// fifth of it.
const REST: f64 = 5e-5;

/// Where a contact slides, it may come as far as this lever times the tolerance between two whole steps \[m\].
const LEVER: f64 = 0.01;

/// A contact may be found so much too late \[m\]: some hundredths of what surfaces usually sink into each other.
const LATE: f64 = 2e-5;

/// What has happened since the last whole step.
#[derive(Clone, Debug)]
pub(super) struct Frozen {
    /// After the last step of these grasps.
    stamp: Option<Stamp>,
    /// What this step has of an earlier one.
    now: Option<Kept>,
    /// By how much things have [turned](CARRIED) since the inertia was made \[rad\], and in how many steps.
    since_inertia: (f64, usize),
    /// What [`motion`](Self::motion) found after the last step.
    moved: Option<(f64, f64)>,
    /// This stretch of frozen steps has had a [swing](Self::swings_back); how many have, see [`SWINGS`]; what is left of the pause
    /// after them; and the velocity after the last whole step.
    swung: bool,
    swings: u32,
    pause: usize,
    velocity: Vec<f64>,
    /// Frozen steps since the last whole one, and ever.
    steps: usize,
    count: u64,
    /// Whole steps by their [`Obstacle`].
    whole: [u64; Obstacle::NAMES.len()],
    tolerance: f64,
    /// By degree of freedom: how far it has come since the last whole step \[rad or m\].
    travel: Vec<f64>,
    /// How far contacts have slid since then \[m\].
    slip: f64,
    /// By degree of freedom: how far a point of what it carries moves by it \[m/rad or m/m\].
    reach: Vec<f64>,
    /// Of the model that `reach` is of.
    origin: Option<u64>,
    /// By degree of freedom: rotation and way of what it carries.
    motion: Vec<(Vector3<f64>, f64)>,
    /// Steps between the last two whole ones; `None` if something was changed from outside meanwhile.
    elapsed: Option<usize>,
    /// What the contact forces that the last whole step ended with add to the generalised force with each step.
    turn: Vec<f64>,
}

impl Default for Frozen {
    fn default() -> Self {
        Frozen {
            stamp: None,
            now: None,
            since_inertia: (0.0, 0),
            moved: None,
            swung: false,
            swings: 0,
            pause: 0,
            velocity: Vec::new(),
            steps: 0,
            count: 0,
            whole: [0; Obstacle::NAMES.len()],
            tolerance: TOLERANCE,
            travel: Vec::new(),
            slip: 0.0,
            reach: Vec::new(),
            origin: None,
            motion: Vec::new(),
            elapsed: None,
            turn: Vec::new(),
        }
    }
}

impl Grasps {
    /// As [`step`](Self::step), for a step after which only the state is wanted (`qpos`, `qvel`, `act`, time) and phases
    /// and contact forces of the grasps: where that is good enough it is made on the geometry of the last whole step, or else
    /// with its inertia.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn substep(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        self.check_model(sim)?;
        if !(self.frozen.tolerance > 0.0) || self.latched().next().is_none() {
            return self.step(sim);
        }
        if let Some(obstacle) = self.obstacle(sim) {
            self.frozen.whole[obstacle as usize] += 1;
            self.frozen.now = self.may_keep_inertia(sim, obstacle).then_some(Kept::Inertia);
            let made = self.step(sim);
            self.frozen.now = None;
            return made;
        }
        if self.frozen.steps == 0 {
            self.measure_turn(sim);
        }
        self.frozen.now = Some(Kept::Geometry);
        let made = sim.step_frozen(self);
        self.frozen.now = None;
        match made {
            Ok(()) => {
                let swings = |grasp: &Grasp| self.frozen.swings_back(sim, grasp.topology());
                self.frozen.swung = self.frozen.swung || self.latched().any(swings);
                self.frozen.advance(sim);
                self.list.iter_mut().for_each(|grasp| grasp.remember(sim.stamp()));
            }
            Err(_) => self.frozen.forget(),
        }
        self.recover(made)
    }

    /// `n` steps with the same controls: all of `sim` is as after the last one.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn steps(&mut self, sim: &mut Simulation, n: usize) -> Result<(), Error> {
        for _ in 1..n {
            self.substep(sim)?;
        }
        if n > 0 { self.step(sim) } else { Ok(()) }
    }

    /// Sets the angle by which a hand and its target may turn against the palm between two whole steps \[rad\], and anything in
    /// the world by five times as much (by as much where several grasps are latched); with 0 every step is whole. What a frozen
    /// step leaves out of lever arms and directions is about that share of the forces. What is negative or no number counts as 0.
    pub fn set_frozen_tolerance(&mut self, angle: f64) {
        self.frozen.tolerance = angle;
    }

    /// See [`set_frozen_tolerance`](Self::set_frozen_tolerance).
    pub fn frozen_tolerance(&self) -> f64 {
        self.frozen.tolerance
    }

    /// Number of steps so far that were made on frozen geometry.
    pub fn frozen_steps(&self) -> u64 {
        self.frozen.count
    }

    /// Why steps of latched grasps of which only the state was wanted were whole ones nevertheless, and how many: "merged" (rows
    /// beside a grasp with limits "box" or "rigid" that only the engine's solver can solve), "changed" (it has just latched, or
    /// something was changed from outside), "refresh" (after 12 frozen ones), "contacts" (some have just come, gone or jumped),
    /// "swings" (a pause, as the target swung to and fro between whole steps), "handover" (a hand that may latch reaches for
    /// what another holds; see [`Grasp::allow_latch`]), "turned" and "slid" (further than the tolerance), "near" (something else may
    /// touch something).
    pub fn whole_steps(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Obstacle::NAMES.into_iter().zip(self.frozen.whole).filter(|(_, count)| *count > 0)
    }

    /// After a whole step: how the contact forces will turn with the geometry.
    fn measure_turn(&mut self, sim: &Simulation) {
        let Frozen { turn, elapsed, .. } = &mut self.frozen;
        turn.clear();
        turn.resize(sim.model().nv(), 0.0);
        let Some(elapsed) = *elapsed else { return };
        for grasp in self.list.iter().filter(|grasp| grasp.phase() == Phase::Grasped) {
            grasp.add_turn(sim, elapsed, turn);
        }
    }

    /// Whether a hand that may latch reaches for what another holds: in which step it does so, and what each of them then presses
    /// with for good, hangs on less than what a frozen step leaves out.
    fn is_handed_over(&self) -> bool {
        let mut reaching = self.list.iter().filter(|grasp| grasp.phase() == Phase::Ungrasped && grasp.may_latch());
        reaching.any(|grasp| self.latched().any(|held| held.topology().in_target(grasp.target().index())))
    }

    /// What counts of what has turned, with the largest angle in the world; see [`CARRIED`].
    fn counted_turn(&self, in_world: f64) -> f64 {
        let mut held = self.latched().map(Grasp::topology);
        match (held.next(), held.next()) {
            (Some(hand), None) => self.frozen.turn_in(hand).max(CARRIED * in_world),
            _ => in_world,
        }
    }

    /// Whether a whole step of which only the state is wanted may have the inertia of an earlier one, and the factors that
    /// take most of the time where there are many joints: what it changes by as bodies turn moves no contact's lever arm. Once
    /// before such a step: what has turned is added up.
    fn may_keep_inertia(&mut self, sim: &Simulation, obstacle: Obstacle) -> bool {
        let known = !matches!(obstacle, Obstacle::Merged | Obstacle::Changed | Obstacle::Handover);
        if !known || self.list.iter().any(|grasp| grasp.phase() != Phase::Grasped) {
            return false;
        }
        let (angle, _) = self.frozen.motion(sim);
        let (turned, steps) = &mut self.frozen.since_inertia;
        *turned += CARRIED * angle;
        *turned < self.frozen.tolerance && *steps < INERTIA_STEPS
    }

    /// Why the next step has to be a whole one, if it has.
    fn obstacle(&mut self, sim: &Simulation) -> Option<Obstacle> {
        let merged = self.latched().filter(|grasp| grasp.is_merged()).count();
        let alike = merged == 0 && self.settings.is_none() || merged == self.latched().count();
        if !alike || merged > 0 && !self.bounded_rows.can_resume() {
            return Some(Obstacle::Merged);
        }
        let resumes = |grasp: &Grasp| grasp.can_resume(sim.stamp());
        if self.frozen.stamp != Some(sim.stamp()) || !self.list.iter().all(resumes) {
            return Some(Obstacle::Changed);
        }
        if self.frozen.steps >= MAX_STEPS {
            return Some(Obstacle::Refresh);
        }
        if self.is_handed_over() {
            return Some(Obstacle::Handover);
        }
        let settled = self.latched().all(|grasp| grasp.steps_since_contacts_changed() >= SETTLED);
        if self.frozen.steps == 0 && !(settled && self.frozen.elapsed.is_some()) {
            return Some(Obstacle::Contacts);
        }
        if self.frozen.steps == 0 && self.frozen.pause > 0 {
            return Some(Obstacle::Swings);
        }
        let speed = self.list.iter().map(|grasp| grasp.slip_speed(sim)).fold(0.0, f64::max);
        self.frozen.slip += sim.model().timestep() * speed;
        let (angle, way) = self.frozen.motion(sim);
        let angle = self.counted_turn(angle);
        let frozen = &self.frozen;
        // written so that what is no number is an obstacle
        if !(angle < frozen.tolerance) {
            Some(Obstacle::Turned)
        } else if !(frozen.slip < LEVER * frozen.tolerance) {
            Some(Obstacle::Slid)
        } else if !self.detector.outlasts(way - 0.5 * LATE, |bodies| frozen.approach(sim, bodies) - LATE) {
            let pace = way / (frozen.steps + 1) as f64;
            self.detector.want(2.0 * pace * (MAX_STEPS + 1) as f64);
            Some(Obstacle::Near)
        } else {
            None
        }
    }
}

/// What a step has of an earlier one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kept {
    /// The inertia and its factors.
    Inertia,
    /// All that follows from positions.
    Geometry,
}

/// Why a step of a latched grasp is made whole although only the state is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Obstacle {
    Merged,
    Changed,
    Refresh,
    Contacts,
    Swings,
    Handover,
    Turned,
    Slid,
    Near,
}

impl Obstacle {
    const NAMES: [&'static str; 9] =
        ["merged", "changed", "refresh", "contacts", "swings", "handover", "turned", "slid", "near"];
}

impl Frozen {
    /// True in the midst of a frozen step.
    pub fn is_now(&self) -> bool {
        self.now == Some(Kept::Geometry)
    }

    /// True in the midst of a step with positions of its own, but not the inertia that follows from them.
    pub fn keeps_inertia(&self) -> bool {
        self.now == Some(Kept::Inertia)
    }

    /// True in the midst of either.
    pub fn wants_state_only(&self) -> bool {
        self.now.is_some()
    }

    /// Before a whole step.
    pub fn begin(&mut self, sim: &Simulation) {
        self.elapsed = (self.stamp == Some(sim.stamp())).then_some(self.steps + 1);
    }

    /// In a frozen step: how the contact forces have turned since the last whole one joins the passive forces.
    pub fn add_turn(&self, sim: &mut Simulation) {
        if self.is_now() {
            axpy((self.steps + 1) as f64, &self.turn, sim.qfrc_passive_mut());
        }
    }

    /// After a step: whether the target now goes back, by its momentum, from where it went when the last whole step was made.
    pub fn swings_back(&self, sim: &Simulation, hand: &Topology) -> bool {
        let dynamics = Dynamics::of(sim);
        let of_target = hand.leaf(hand.target()).into_iter().flat_map(|leaf| dynamics.with_ancestors(leaf));
        let (mut mass, mut energy, mut across) = (0.0, 0.0, 0.0);
        for dof in of_target {
            let (m, v) = (sim.model().dof_M0()[dof], sim.qvel()[dof]);
            mass += m;
            energy += m * v * v;
            across += m * v * self.velocity[dof];
        }
        across < 0.0 && energy > mass * REST * REST
    }

    /// After a whole step.
    pub fn refresh(&mut self, sim: &Simulation) {
        if self.steps > 0 {
            let swung = std::mem::take(&mut self.swung);
            self.swings = if swung { SWINGS.min(self.swings + 2) } else { self.swings.saturating_sub(1) };
            self.pause = if self.swings == SWINGS { PAUSE } else { 0 };
        } else {
            self.pause = self.pause.saturating_sub(1);
        }
        if !self.keeps_inertia() {
            self.since_inertia = (0.0, 0);
        }
        self.since_inertia.1 += 1;
        self.moved = None;
        self.velocity.clear();
        self.velocity.extend_from_slice(sim.qvel());
        self.steps = 0;
        self.slip = 0.0;
        self.stamp = Some(sim.stamp());
        self.travel.clear();
        self.travel.extend(sim.qvel().iter().map(|v| v * sim.model().timestep()));
    }

    /// After a frozen step.
    fn advance(&mut self, sim: &Simulation) {
        if self.stamp.is_none() {
            return;
        }
        self.steps += 1;
        self.since_inertia.1 += 1;
        self.moved = None;
        self.count += 1;
        self.stamp = Some(sim.stamp());
        let step = sim.model().timestep();
        self.travel.iter_mut().zip(sim.qvel()).for_each(|(travel, v)| *travel += step * v);
    }

    /// The next step is a whole one.
    pub fn forget(&mut self) {
        self.stamp = None;
        (self.swung, self.swings, self.pause) = (false, 0, 0);
    }
}
