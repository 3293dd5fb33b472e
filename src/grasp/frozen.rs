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

use super::Grasps;
use super::controller::Grasp;
use super::error::Error;
use super::hand::topology::Topology;
use super::linalg::axpy;
use super::monitor::phase::Phase;
use crate::mujoco::{CompiledModel, JointKind, Simulation, Stamp};
use nalgebra::Vector3;

/// Most frozen steps in a row.
const MAX_STEPS: usize = 12;

/// Angle by which a hand and its target may turn against the palm between two whole steps, unless it is set otherwise \[rad\].
pub const TOLERANCE: f64 = 2e-3;

/// What turns in the world, as an arm that carries a grasp does, counts so much of what turns against the palm: no contact's
/// lever arms change, only the directions of weight and inertia in the grasp's frame. Not so where several grasps are latched:
/// hands that hold one target press on each other through their arms.
const CARRIED: f64 = 0.2;

/// So many whole steps in a row must have the same contacts, about where they were: one that bounces is found again in whole
/// steps only.
const SETTLED: usize = 3;

/// Where a contact slides, it may come as far as this lever times the tolerance between two whole steps \[m\].
const LEVER: f64 = 0.01;

/// A contact may be found so much too late \[m\]: some hundredths of what surfaces usually sink into each other.
const LATE: f64 = 2e-5;

/// What has happened since the last whole step.
#[derive(Clone, Debug)]
pub(super) struct Frozen {
    /// After the last step of these grasps.
    stamp: Option<Stamp>,
    /// This step is frozen.
    now: bool,
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
            now: false,
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
    /// and contact forces of the grasps: where that is good enough it is made on the geometry of the last whole step.
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
            return self.step(sim);
        }
        if self.frozen.steps == 0 {
            self.measure_turn(sim);
        }
        self.frozen.now = true;
        let made = sim.step_frozen(self);
        self.frozen.now = false;
        match made {
            Ok(()) => {
                self.frozen.advance(sim);
                self.list.iter_mut().for_each(|grasp| grasp.remember(sim.stamp()));
            }
            Err(_) => self.frozen.forget(),
        }
        made
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
    /// "handover" (a hand that may latch reaches for what another holds; see [`Grasp::allow_latch`]),
    /// "turned" and "slid" (further than the tolerance), "near" (something else may touch something).
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
        let speed = self.list.iter().map(|grasp| grasp.slip_speed(sim)).fold(0.0, f64::max);
        let frozen = &mut self.frozen;
        frozen.slip += sim.model().timestep() * speed;
        let (angle, way) = frozen.motion(sim);
        let mut held = self.list.iter().filter(|grasp| grasp.phase() == Phase::Grasped).map(Grasp::topology);
        let angle = match (held.next(), held.next()) {
            (Some(hand), None) => frozen.turn_in(hand).max(CARRIED * angle),
            _ => angle,
        };
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

/// Why a step of a latched grasp is made whole although only the state is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Obstacle {
    Merged,
    Changed,
    Refresh,
    Contacts,
    Handover,
    Turned,
    Slid,
    Near,
}

impl Obstacle {
    const NAMES: [&'static str; 8] = ["merged", "changed", "refresh", "contacts", "handover", "turned", "slid", "near"];
}

impl Frozen {
    /// True in the midst of a frozen step.
    pub fn is_now(&self) -> bool {
        self.now
    }

    /// Before a whole step.
    pub fn begin(&mut self, sim: &Simulation) {
        self.elapsed = (self.stamp == Some(sim.stamp())).then_some(self.steps + 1);
    }

    /// In a frozen step: how the contact forces have turned since the last whole one joins the passive forces.
    pub fn add_turn(&self, sim: &mut Simulation) {
        if self.now {
            axpy((self.steps + 1) as f64, &self.turn, sim.qfrc_passive_mut());
        }
    }

    /// After a whole step.
    pub fn refresh(&mut self, sim: &Simulation) {
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
        self.count += 1;
        self.stamp = Some(sim.stamp());
        let step = sim.model().timestep();
        self.travel.iter_mut().zip(sim.qvel()).for_each(|(travel, v)| *travel += step * v);
    }

    /// The next step is a whole one.
    pub fn forget(&mut self) {
        self.stamp = None;
    }

    /// The largest angle by which a part of a hand or its target has turned against the palm since then \[rad\]. After
    /// [`motion`](Self::motion), for finite ones.
    fn turn_in(&self, hand: &Topology) -> f64 {
        let rotation = |dof: Option<usize>| dof.map_or_else(Vector3::zeros, |dof| self.motion[dof].0);
        let palm = rotation(hand.leaf(hand.palm()));
        let dofs = hand.fingers().iter().flatten().copied().map(Some);
        dofs.chain([hand.leaf(hand.target())]).map(|dof| (rotation(dof) - palm).norm()).fold(0.0, f64::max)
    }

    /// How far points of two bodies may have come nearer to each other since the last whole step, at the most \[m\]: what moves
    /// both does not count. After [`motion`](Self::motion).
    fn approach(&self, sim: &Simulation, bodies: [usize; 2]) -> f64 {
        let model = sim.model();
        let way = |dof: Option<usize>| dof.map_or(0.0, |dof| self.motion[dof].1);
        let [mut a, mut b] = bodies.map(|body| mover(model, body));
        let both = way(a) + way(b);
        // parents come before their children
        while a != b {
            let deeper = if a > b { &mut a } else { &mut b };
            *deeper = deeper.and_then(|dof| usize::try_from(model.dof_parentid()[dof]).ok());
        }
        both - 2.0 * way(a)
    }

    /// The largest angle and the longest way of anything since the last whole step \[rad, m\]; infinite if one is no number.
    fn motion(&mut self, sim: &Simulation) -> (f64, f64) {
        let model = sim.model();
        if self.origin != Some(model.origin()) {
            self.reach = reach(model);
            self.origin = Some(model.origin());
        }
        self.motion.clear();
        let mut largest = (0.0f64, 0.0f64);
        let mut sum = 0.0; // the largest does not see what is no number
        for (dof, (&parent, axis)) in model.dof_parentid().iter().zip(sim.cdof().chunks_exact(6)).enumerate() {
            let parent = usize::try_from(parent).ok().map(|parent| self.motion[parent]);
            let (mut rotation, mut way) = parent.unwrap_or_default();
            rotation += Vector3::new(axis[0], axis[1], axis[2]) * self.travel[dof];
            way += self.travel[dof].abs() * self.reach[dof];
            let angle = rotation.norm();
            largest = (largest.0.max(angle), largest.1.max(way));
            sum += angle + way;
            self.motion.push((rotation, way));
        }
        if sum.is_finite() { largest } else { (f64::INFINITY, f64::INFINITY) }
    }
}

/// The degree of freedom nearest to a body on the way to the world, which moves it.
fn mover(model: &CompiledModel, body: usize) -> Option<usize> {
    let body = model.body_weldid()[body] as usize;
    (model.body_dofnum()[body] > 0).then(|| (model.body_dofadr()[body] + model.body_dofnum()[body] - 1) as usize)
}

/// For each degree of freedom how far the farthest point that it carries is from its axis, at the most; 1 for one that slides.
fn reach(model: &CompiledModel) -> Vec<f64> {
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    // of all that hangs on a body and can touch anything, about its origin; negative without such a thing
    let mut radius = vec![f64::NEG_INFINITY; model.nbody()];
    let paired = |geom: usize| model.pair_geom1().iter().chain(model.pair_geom2()).any(|&of| of as usize == geom);
    let touches = |geom: usize| model.geom_contype()[geom] | model.geom_conaffinity()[geom] != 0 || paired(geom);
    for geom in (0..model.ngeom()).filter(|&geom| touches(geom)) {
        let body = model.geom_bodyid()[geom] as usize;
        radius[body] = radius[body].max(norm(&model.geom_pos()[3 * geom..3 * geom + 3]) + model.geom_rbound()[geom]);
    }
    for body in (1..model.nbody()).rev() {
        let parent = model.body_parentid()[body] as usize;
        let mut offset = norm(&model.body_pos()[3 * body..3 * body + 3]);
        let first = model.body_jntadr()[body].max(0) as usize;
        for joint in first..first + model.body_jntnum()[body] as usize {
            offset += 2.0 * norm(&model.jnt_pos()[3 * joint..3 * joint + 3]);
            if model.jnt_type()[joint] == JointKind::Slide.raw() {
                offset += model.jnt_range()[2 * joint..2 * joint + 2].iter().map(|x| x.abs()).fold(0.0, f64::max);
            }
        }
        radius[parent] = radius[parent].max(offset + radius[body]);
    }
    let of = |dof: usize| {
        let joint = model.dof_jntid()[dof] as usize;
        let kind = model.jnt_type()[joint];
        let slides = kind == JointKind::Slide.raw()
            || kind == JointKind::Free.raw() && dof < model.jnt_dofadr()[joint] as usize + 3;
        let body = model.dof_bodyid()[dof] as usize;
        if radius[body] < 0.0 {
            0.0
        } else if slides {
            1.0
        } else {
            radius[body] + norm(&model.jnt_pos()[3 * joint..3 * joint + 3])
        }
    };
    (0..model.nv()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mujoco::Model;

    #[test]
    fn what_moves_two_bodies_alike_brings_them_no_nearer() {
        let xml = r#"<mujoco><worldbody><body name="arm"><joint axis="0 0 1"/><geom size=".1" pos=".4 0 0"/>
          <body name="a" pos=".5 .1 0"><joint axis="0 0 1"/><geom size=".02"/>
            <body name="nail" pos=".03 0 0"><geom size=".01"/></body></body>
          <body name="b" pos=".5 -.1 0"><joint type="slide"/><geom size=".02"/></body></body></worldbody></mujoco>"#;
        let mut sim = Simulation::new(&Model::from_xml_string(xml).unwrap()).unwrap();
        sim.kinematics().unwrap();
        let mut frozen = Frozen { travel: vec![0.1, 0.02, -0.003], ..Frozen::default() };
        let (angle, way) = frozen.motion(&sim);
        let [arm, a, nail, b] = ["arm", "a", "nail", "b"].map(|name| sim.model().body(name).unwrap().index());
        // the nail's far end is 4 cm from the axis of its finger
        let close = |x: f64, y: f64| (x - y).abs() < 1e-12;
        assert!(close(angle, 0.12) && way > 0.1 * 0.5, "{angle} {way}");
        assert!(close(frozen.approach(&sim, [a, b]), 0.02 * 0.04 + 0.003), "{}", frozen.approach(&sim, [a, b]));
        assert!(close(frozen.approach(&sim, [b, nail]), frozen.approach(&sim, [a, b])));
        assert!(close(frozen.approach(&sim, [arm, nail]), 0.02 * 0.04));
        assert_eq!(frozen.approach(&sim, [a, nail]), 0.0);
        assert!(close(frozen.approach(&sim, [0, a]), way) || close(frozen.approach(&sim, [0, b]), way));
        frozen.travel[1] = f64::NAN;
        assert_eq!(frozen.motion(&sim), (f64::INFINITY, f64::INFINITY));
        assert!(frozen.approach(&sim, [a, b]).is_nan());
    }
}
