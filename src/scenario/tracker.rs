//! Fingertips to their goals, then harder, until the grasp is good enough.
//!
//! 1. The tips move in a straight line from where the actuators' targets put them to the goal sites, all arriving
//!    together. The targets also carry the fingers' own weight, so that soft fingers come to the goals and not below.
//! 2. The goals move inwards, at [`PRESS_RATE`], for as long as the quality is below the latch quality, up to
//!    [`PRESS_LIMIT`]: the position actuators, which cannot follow, press.
//!    Two tips have no third one to hold them up: they press by *force* instead, `J^T f` along the line that joins the
//!    goals (a goal that moves inwards would push sideways too, as the fingers' joint springs are not equally stiff in
//!    all directions), and share the force that the pin bears.
//! 3. While the target is pinned, all goals together also move against the force that the pin has to bear, until the
//!    fingers bear it: a soft hand then neither drops nor throws the target when the pin goes.
//! 4. Once the target is free the goals stay where they are in the palm's frame (and still move inwards): goals that
//!    followed the target would give way to it.
//! 5. Once the grasp latches (in full mode: would latch) the targets stay what they are, and `[[control]]` goes on from
//!    there.

use nalgebra::{Isometry3, Vector3};

use super::actuator::PositionActuator;
use super::plan::Goal;
use crate::kinematics::{Error, InverseKinematics};
use crate::mujoco::{BodyId, Simulation, SiteId};

/// Speed of the tips on their way to the goals \[m/s\].
pub const APPROACH_SPEED: f64 = 0.1;
/// Speed at which the goals move into the target \[m/s\].
pub const PRESS_RATE: f64 = 0.010;
/// Rate at which two tips press harder \[N/s\], and their largest force \[N\].
pub const FORCE_RATE: f64 = 0.5;
/// See [`FORCE_RATE`].
pub const FORCE_LIMIT: f64 = 20.0;
/// Time in which two tips take over what the pin bears \[s\].
const TAKE_OVER: f64 = 0.2;
/// Farthest that they move \[m\].
pub const PRESS_LIMIT: f64 = 0.050;

/// The pin's load at which the goals move against it at the full rate, over the sum of normal forces.
const LOAD_SHARE: f64 = 0.2;
/// The same without contact \[N\].
const LOAD: f64 = 0.05;

/// What the fingers feel of the target.
#[derive(Clone, Copy, Debug)]
pub struct Feel {
    /// The quality is not reached yet.
    pub weak: bool,
    /// The target is pinned.
    pub pinned: bool,
    /// Sum of contact forces and weight on the target \[N\], world axes: what the pin has to bear.
    pub load: Vector3<f64>,
    /// Sum of the normal forces \[N\].
    pub squeeze: f64,
}

/// Inverse kinematics of the tips of one grasp.
#[derive(Clone, Debug)]
pub struct Tracker {
    /// Index of the grasp.
    pub grasp: usize,
    palm: BodyId,
    target: BodyId,
    tips: Vec<SiteId>,
    goals: Vec<SiteId>,
    start: f64,
    ik: InverseKinematics,
    /// One for each joint of `ik`, with its degree of freedom.
    actuators: Vec<(PositionActuator, usize)>,
    /// Torque of each of them that carries the fingers' own weight \[N m or N\].
    weight: Vec<f64>,
    state: State,
    /// In the target's frame: where each tip starts from, and the direction into the target at each goal.
    from: Vec<Vector3<f64>>,
    inward: Vec<Vector3<f64>>,
    farthest: f64,
    pressed: f64,
    /// Of a pair of tips: force of each along the line between the goals, and on the target as a whole \[N\].
    squeeze: f64,
    support: Vector3<f64>,
    jacobian: Vec<f64>,
    /// Of all goals together, against the pin's load, world axes \[m\].
    shift: Vector3<f64>,
    /// Where the target was in the palm's frame when it became free.
    freed_at: Option<Isometry3<f64>>,
    points: Vec<Vector3<f64>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Waiting,
    Tracking,
    Done,
}

fn site(sim: &Simulation, id: SiteId) -> Vector3<f64> {
    Vector3::from_column_slice(&sim.site_xpos()[3 * id.index()..3 * id.index() + 3])
}

impl Tracker {
    /// The tracker of grasp `index` between `palm` and `target`; `None` if no goal belongs to it.
    ///
    /// # Errors
    /// Tips that no position actuator can move.
    pub fn new(
        sim: &Simulation,
        goals: &[Goal],
        index: usize,
        palm: BodyId,
        target: BodyId,
    ) -> Result<Option<Self>, Error> {
        let own: Vec<&Goal> = goals.iter().filter(|g| g.grasp == index).collect();
        if own.is_empty() {
            return Ok(None);
        }
        let model = sim.model();
        let driven: Vec<_> = model.joints().filter(|&j| PositionActuator::of(model, j).is_some()).collect();
        let tips: Vec<SiteId> = own.iter().map(|g| g.tip).collect();
        let ik = InverseKinematics::new(sim, palm, &tips, &driven)?;
        let actuators: Vec<(PositionActuator, usize)> = ik
            .joints()
            .iter()
            .filter_map(|&j| {
                let dof = model.jnt_dofadr()[j.index()] as usize;
                PositionActuator::of(model, j).map(|a| (a, dof))
            })
            .collect();
        let n = own.len();
        Ok(Some(Self {
            grasp: index,
            palm,
            target,
            tips,
            goals: own.iter().map(|g| g.goal).collect(),
            start: own.iter().map(|g| g.start).fold(f64::INFINITY, f64::min),
            ik,
            weight: vec![0.0; actuators.len()],
            actuators,
            state: State::Waiting,
            from: vec![Vector3::zeros(); n],
            inward: vec![Vector3::zeros(); n],
            farthest: 0.0,
            pressed: 0.0,
            squeeze: 0.0,
            support: Vector3::zeros(),
            jacobian: vec![0.0; 6 * model.nv()],
            shift: Vector3::zeros(),
            freed_at: None,
            points: vec![Vector3::zeros(); n],
        }))
    }

    /// Writes the targets for a step of length `step` at `time` \[s\]. `ctrl` comes with the schedule's targets. Uses the
    /// poses and forces of the last step.
    ///
    /// # Errors
    /// None that a constructed tracker can meet.
    pub fn drive(
        &mut self,
        sim: &Simulation,
        time: f64,
        step: f64,
        feel: Feel,
        ctrl: &mut [f64],
    ) -> Result<(), crate::mujoco::Error> {
        // Half a step of tolerance: k * h is not a round number in binary.
        if self.state == State::Done || time < self.start - 0.5 * step {
            return Ok(());
        }
        for (weight, (_, dof)) in self.weight.iter_mut().zip(&self.actuators) {
            *weight = sim.qfrc_bias()[*dof];
        }
        if self.state == State::Waiting {
            self.begin(sim, ctrl);
            self.state = State::Tracking;
        }
        let gone = APPROACH_SPEED * (time - self.start).max(0.0);
        let share = if gone < self.farthest { gone / self.farthest } else { 1.0 };
        let (palm, mut target) = (sim.body_pose(self.palm), sim.body_pose(self.target));
        if share == 1.0 {
            if self.tips.len() == 2 {
                self.squeeze_pair(sim, &target, step, feel)?;
            } else {
                self.press(step, feel);
            }
            if !feel.pinned {
                target = palm * *self.freed_at.get_or_insert(palm.inv_mul(&target));
            }
        }
        let now = sim.body_pose(self.target);
        for (i, point) in self.points.iter_mut().enumerate() {
            let goal = now.inverse_transform_point(&site(sim, self.goals[i]).into()).coords;
            let local = self.from[i].lerp(&goal, share) + self.inward[i] * self.pressed;
            *point = target.transform_point(&local.into()).coords + self.shift;
        }
        self.ik.solve(&palm, &self.points)?;
        self.write(ctrl);
        Ok(())
    }

    /// Leaves the targets as they are from now on; true the first time after tracking began.
    pub fn finish(&mut self) -> bool {
        let was = std::mem::replace(&mut self.state, State::Done);
        was == State::Tracking
    }

    /// (index into ctrl, target) of each joint in the last solution.
    pub fn targets(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.actuators
            .iter()
            .zip(self.ik.values())
            .zip(&self.weight)
            .map(|(((a, _), q), weight)| (a.index, a.scale * q + a.offset + a.compliance * weight))
    }

    /// The solver, for timing it.
    pub fn solver(&self) -> &InverseKinematics {
        &self.ik
    }

    /// The palm's pose in the world and the goals of the last step, for timing the solver.
    pub fn problem(&self, sim: &Simulation) -> (Isometry3<f64>, Vec<Vector3<f64>>) {
        (sim.body_pose(self.palm), self.points.clone())
    }

    fn press(&mut self, step: f64, feel: Feel) {
        let reach = PRESS_RATE * step;
        if feel.weak {
            self.pressed = (self.pressed + reach).min(PRESS_LIMIT);
        }
        if feel.pinned {
            let load = feel.load / (LOAD + LOAD_SHARE * feel.squeeze);
            self.shift = (self.shift - load.cap_magnitude(1.0) * reach).cap_magnitude(PRESS_LIMIT);
        }
    }

    /// Two tips: torques `J^T f` of forces towards each other and against the pin's load, on top of the fingers' weight.
    fn squeeze_pair(
        &mut self,
        sim: &Simulation,
        target: &Isometry3<f64>,
        step: f64,
        feel: Feel,
    ) -> Result<(), crate::mujoco::Error> {
        if feel.weak {
            self.squeeze = (self.squeeze + FORCE_RATE * step).min(FORCE_LIMIT);
        }
        if feel.pinned && feel.squeeze > 0.0 {
            self.support = (self.support - feel.load * (step / TAKE_OVER)).cap_magnitude(FORCE_LIMIT);
        }
        let nv = sim.model().nv();
        for (i, &tip) in self.tips.iter().enumerate() {
            sim.jac_site(tip, &mut self.jacobian)?;
            let force = target.rotation * self.inward[i] * self.squeeze + 0.5 * self.support;
            for (weight, (_, dof)) in self.weight.iter_mut().zip(&self.actuators) {
                *weight += (0..3).map(|k| self.jacobian[k * nv + dof] * force[k]).sum::<f64>();
            }
        }
        Ok(())
    }

    /// The tips start where the actuators' present targets put them, so that nothing jumps.
    fn begin(&mut self, sim: &Simulation, ctrl: &[f64]) {
        self.ik.start_from(sim);
        let joints = self.ik.joints().to_vec();
        self.ik.start_at(|joint| {
            let i = joints.iter().position(|&j| j == joint);
            i.map_or(0.0, |i| {
                let (a, weight) = (self.actuators[i].0, self.weight[i]);
                let ctrl = ctrl.get(a.index).copied().unwrap_or(0.0);
                (ctrl - a.offset - a.compliance * weight) / a.scale
            })
        });
        self.ik.tips(&mut self.from);
        let (palm, target) = (sim.body_pose(self.palm), sim.body_pose(self.target));
        let body = self.target.index();
        let ipos = &sim.model().body_ipos()[3 * body..3 * body + 3];
        let centre = Vector3::from_column_slice(ipos);
        let goals: Vec<Vector3<f64>> =
            self.goals.iter().map(|&g| target.inverse_transform_point(&site(sim, g).into()).coords).collect();
        self.farthest = 0.0;
        for (i, goal) in goals.iter().enumerate() {
            let tip = palm.transform_point(&self.from[i].into());
            self.from[i] = target.inverse_transform_point(&tip).coords;
            self.farthest = self.farthest.max((goal - self.from[i]).norm());
            // Two tips can only squeeze along the line that joins them; more squeeze towards the centre of mass.
            let towards = if let [a, b] = goals.as_slice() { 0.5 * (a + b) } else { centre };
            self.inward[i] = (towards - goal).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        }
    }

    fn write(&self, ctrl: &mut [f64]) {
        for (index, value) in self.targets() {
            if let Some(ctrl) = ctrl.get_mut(index) {
                *ctrl = value;
            }
        }
    }
}
