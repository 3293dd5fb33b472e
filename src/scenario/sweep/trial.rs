//! The test of one grasp: close, then bear one load after the other.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{Case, LoadEntry, Parameter, Sweep};
use crate::grasp::{self, Grasp, GraspId, Grasps, Phase};
use crate::mujoco::{BodyId, Simulation};
use crate::scenario::error::Error;
use crate::scenario::outcome::{LOSS_DISTANCE, Outcome, classify};
use crate::scenario::plan::Plan;
use crate::scenario::press::Press;
use crate::scenario::run::Options;
use crate::scenario::runner::{Mode, Runner};

/// Steps from one look at the grasp to the next; the last of them is a whole one.
const STEPS: u64 = 10;

/// What became of a grasp.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Not lost, and back within 2 mm or a tenth of the largest motion.
    Held,
    /// Neither held nor lost.
    Slid,
    /// It has moved 5 cm in the palm, or nothing of the hand touches it at the end.
    Lost,
    /// No finger pressed on the target when the loads were to begin.
    Missed,
    /// The simulation failed.
    Failed,
}

impl Verdict {
    /// All, from the best.
    pub const ALL: [Verdict; 5] = [Self::Held, Self::Slid, Self::Lost, Self::Missed, Self::Failed];

    /// As in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Held => "held",
            Self::Slid => "slid",
            Self::Lost => "lost",
            Self::Missed => "missed",
            Self::Failed => "failed",
        }
    }
}

/// What is known of one grasp after its test; a number that does not exist is `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Of the [`Case`].
    pub id: String,
    /// Held, or what else.
    pub verdict: Verdict,
    /// When it was lost for good, from the start of the scenario \[s\].
    pub lost_at_s: Option<f64>,
    /// The load that it was lost under, or in the rest after it.
    pub lost_in: Option<String>,
    /// Largest way of the target along a link, at a point where they touched when the loads began \[m\].
    pub max_slip_m: Option<f64>,
    /// Largest distance of the target's frame in the palm from where it was when the loads began \[m\].
    pub max_motion_m: Option<f64>,
    /// Largest turn in the palm \[rad\].
    pub max_rotation_rad: Option<f64>,
    /// That distance at the end \[m\].
    pub final_offset_m: Option<f64>,
    /// Sum of the normal forces when the loads began \[N\].
    pub normal_force_n: Option<f64>,
    /// First latch \[s\].
    pub latched_at_s: Option<f64>,
    /// Quality in the step that latched \[N\].
    pub quality_at_latch_n: Option<f64>,
    /// Of the steps under loads up to the last in which a finger pressed, those that were latched.
    pub latched_share: Option<f64>,
    /// Of those, the ones on frozen geometry.
    pub substructured_share: Option<f64>,
    /// Steps that were made.
    pub steps: u64,
    /// Why the simulation failed.
    pub error: Option<String>,
}

impl Row {
    fn new(case: &Case) -> Self {
        Self {
            id: case.id.clone(),
            verdict: Verdict::Failed,
            lost_at_s: None,
            lost_in: None,
            max_slip_m: None,
            max_motion_m: None,
            max_rotation_rad: None,
            final_offset_m: None,
            normal_force_n: None,
            latched_at_s: None,
            quality_at_latch_n: None,
            latched_share: None,
            substructured_share: None,
            steps: 0,
            error: None,
        }
    }
}

/// Tests one grasp.
///
/// # Errors
/// A scenario that cannot be set up, and [`Error::Interrupted`]. A simulation that fails on its way is a verdict.
pub(super) fn test(sweep: &Sweep, case: &Case, mode: Mode) -> Result<Row, Error> {
    let mut row = Row::new(case);
    match close_and_bear(sweep, case, mode, &mut row) {
        Ok(verdict) => row.verdict = verdict,
        // the verdict of a new row: failed
        Err(Error::Step { time, source, .. }) => row.error = Some(format!("at {time:.3} s: {source}")),
        Err(other) => return Err(other),
    }
    Ok(row)
}

fn close_and_bear(sweep: &Sweep, case: &Case, mode: Mode, row: &mut Row) -> Result<Verdict, Error> {
    let (sim, grasps) = close(sweep, case, mode, row)?;
    let mut trial = Trial::begin(mode, sim, grasps, row)?;
    if !trial.is_pressed() {
        return Ok(Verdict::Missed);
    }
    for (index, load) in sweep.spec.load.iter().enumerate() {
        trial.load = index;
        for (load, duration) in [(Some(load), load.duration), (None, sweep.spec.rest)] {
            sweep.plan.stop.check()?;
            trial.bear(load, duration)?;
        }
    }
    let (verdict, lost) = trial.judge();
    row.lost_at_s = lost.map(|(time, _)| time);
    row.lost_in = lost.map(|(_, load)| sweep.spec.load[load].name.clone());
    Ok(verdict)
}

/// The scenario of a grasp up to `measure_from`.
fn close(sweep: &Sweep, case: &Case, mode: Mode, row: &mut Row) -> Result<(Simulation, Grasps), Error> {
    let mut plan = sweep.plan.clone();
    if let Some(name) = &case.keyframe {
        plan.keyframe = Some(plan.model.keyframe(name)?);
    }
    let given = || sweep.parameters.iter().zip(&case.values).filter_map(|((_, p), value)| Some((*p, (*value)?)));
    if let Some((_, strength)) = given().find(|(parameter, _)| *parameter == Parameter::Strength) {
        plan = Press::of(&plan)?.apply(&plan, strength);
    }
    let geoms = geoms(&plan)?;
    let mut runner =
        Runner::starting(&plan, mode, |sim| given().for_each(|(parameter, value)| parameter.set(sim, &geoms, value)))?;
    Options { noslip: sweep.spec.noslip }.set_noslip(runner.sim_mut())?;
    let end = plan.timeline.measure_from() + 0.5 * plan.model.timestep();
    while runner.time() < end {
        let sample = runner.step()?;
        row.steps += 1;
        if sample.grasped && row.latched_at_s.is_none() {
            row.latched_at_s = Some(sample.time);
            row.quality_at_latch_n = Some(sample.quality);
        }
    }
    Ok(runner.into_parts())
}

/// Geoms of hands and targets.
fn geoms(plan: &Plan) -> Result<Vec<usize>, Error> {
    let mut bodies = Vec::new();
    for spec in &plan.grasps {
        bodies.extend(plan.model.subtree(spec.target)?);
        bodies.extend(plan.model.subtree(spec.palm.unwrap_or(spec.target))?);
    }
    let of_bodies = |geom: &usize| bodies.iter().any(|b| b.index() as i32 == plan.model.geom_bodyid()[*geom]);
    Ok((0..plan.model.ngeom()).filter(of_bodies).collect())
}

/// A closed hand under its loads, with the targets of its actuators as they were when it had closed.
struct Trial<'a> {
    mode: Mode,
    sim: Simulation,
    grasps: Grasps,
    gravity: Vector3<f64>,
    timestep: f64,
    palm: BodyId,
    target: BodyId,
    /// Pose of the target in the palm when the loads began.
    start: Isometry3<f64>,
    /// Where links and target touched then: the point in the link's frame and in the target's.
    touched: Vec<(BodyId, Point3<f64>, Point3<f64>)>,
    /// Index of the load.
    load: usize,
    /// Nothing of the hand has touched the target since this time \[s\] and load.
    untouched: Option<(f64, usize)>,
    /// When it had moved too far, and under which load.
    gone: Option<(f64, usize)>,
    /// Distance from the start in the last look \[m\].
    offset: f64,
    /// Steps under loads: all, and latched ones.
    steps: u64,
    latched: u64,
    /// Frozen steps when the loads began.
    frozen_before: u64,
    row: &'a mut Row,
}

impl<'a> Trial<'a> {
    /// Makes a whole step more, and has its start in what is found there.
    fn begin(mode: Mode, sim: Simulation, grasps: Grasps, row: &'a mut Row) -> Result<Self, Error> {
        let grasp = &grasps[GraspId::FIRST];
        let mut trial = Self {
            mode,
            gravity: sim.model().gravity(),
            timestep: sim.model().timestep(),
            palm: grasp.palm(),
            target: grasp.target(),
            start: Isometry3::identity(),
            touched: Vec::new(),
            load: 0,
            untouched: None,
            gone: None,
            offset: 0.0,
            steps: 0,
            latched: 0,
            frozen_before: grasps.frozen_steps(),
            sim,
            grasps,
            row,
        };
        trial.step(None, 0.0, true).map_err(|source| trial.failed(source))?;
        trial.start = trial.in_palm();
        let held = trial.sim.body_pose(trial.target);
        let touching = trial.grasp().contacts().iter().filter(|c| c.normal_force() > 0.0);
        trial.touched = touching
            .map(|c| {
                let at = Point3::from(c.position);
                let on_link = trial.sim.body_pose(c.link_id).inverse_transform_point(&at);
                (c.link_id, on_link, held.inverse_transform_point(&at))
            })
            .collect();
        let forces = trial.grasp().contacts().iter().map(|c| c.normal_force());
        trial.row.normal_force_n = Some(forces.fold(0.0, |sum, force| sum + force));
        Ok(trial)
    }

    fn failed(&self, source: grasp::Error) -> Error {
        Error::Step { what: self.row.id.clone(), time: self.time(), source }
    }

    fn grasp(&self) -> &Grasp {
        &self.grasps[GraspId::FIRST]
    }

    /// Since the start of the scenario \[s\], without the noise of many additions.
    fn time(&self) -> f64 {
        (self.row.steps as f64 * self.timestep * 1e9).round() / 1e9
    }

    /// Pose of the target in the palm.
    fn in_palm(&self) -> Isometry3<f64> {
        self.sim.body_pose(self.palm).inv_mul(&self.sim.body_pose(self.target))
    }

    /// Whether a finger presses on the target.
    fn is_pressed(&self) -> bool {
        self.grasp().contacts().iter().any(|c| c.link_id != self.palm && c.normal_force() > 0.0)
    }

    /// Bears a load for `duration` seconds, or until the target is gone.
    fn bear(&mut self, load: Option<&LoadEntry>, duration: f64) -> Result<(), Error> {
        let steps = (duration / self.timestep).round() as u64;
        for k in 0..steps {
            if self.gone.is_some() {
                break;
            }
            let look = (k + 1) % STEPS == 0 || k + 1 == steps;
            self.step(load, k as f64 * self.timestep, look).map_err(|source| self.failed(source))?;
            if look {
                self.look();
            }
        }
        Ok(())
    }

    /// One step, `time` seconds after the start of the load; a `whole` one leaves contacts and poses to be read.
    fn step(&mut self, load: Option<&LoadEntry>, time: f64, whole: bool) -> Result<(), grasp::Error> {
        self.apply(load, time)?;
        match (self.mode, whole) {
            (Mode::Full, _) => self.sim.step()?,
            (Mode::Grasp, true) => self.grasps.step(&mut self.sim)?,
            (Mode::Grasp, false) => self.grasps.substep(&mut self.sim)?,
        }
        if self.mode == Mode::Full && whole {
            self.grasps.monitor(&self.sim)?;
        }
        self.row.steps += 1;
        self.steps += 1;
        if self.grasp().phase() == Phase::Grasped {
            self.latched += 1;
            if self.row.latched_at_s.is_none() {
                self.row.latched_at_s = Some(self.time());
                self.row.quality_at_latch_n = Some(self.grasp().quality());
            }
        }
        Ok(())
    }

    /// That the hand's base is accelerated is felt as gravity the other way.
    fn apply(&mut self, load: Option<&LoadEntry>, time: f64) -> Result<(), grasp::Error> {
        let share = load.map_or(0.0, |load| load.share(time));
        let of =
            |part: fn(&LoadEntry) -> [f64; 3]| load.map_or(Vector3::zeros(), |load| Vector3::from(part(load)) * share);
        self.sim.set_gravity(self.gravity - of(|load| load.acceleration))?;
        let wrench = &mut self.sim.xfrc_applied_mut()[6 * self.target.index()..6 * self.target.index() + 6];
        wrench[..3].copy_from_slice(of(|load| load.force).as_slice());
        wrench[3..].copy_from_slice(of(|load| load.torque).as_slice());
        Ok(())
    }

    /// After a whole step: how far has the target come?
    fn look(&mut self) {
        let now = self.in_palm();
        self.offset = (now.translation.vector - self.start.translation.vector).norm();
        let held = self.sim.body_pose(self.target);
        let slips = self.touched.iter().map(|(link, on_link, on_target)| {
            (self.sim.body_pose(*link).transform_point(on_link) - held.transform_point(on_target)).norm()
        });
        let slip = slips.fold(0.0, f64::max);
        let most = |known: &mut Option<f64>, value: f64| *known = Some(known.map_or(value, |known| known.max(value)));
        most(&mut self.row.max_slip_m, slip);
        most(&mut self.row.max_motion_m, self.offset);
        most(&mut self.row.max_rotation_rad, self.start.rotation.angle_to(&now.rotation));
        let here = (self.time(), self.load);
        self.untouched = if self.grasp().contacts().is_empty() { self.untouched.or(Some(here)) } else { None };
        if self.offset >= LOSS_DISTANCE {
            self.gone = self.untouched.or(Some(here));
        }
        if self.mode == Mode::Grasp && self.is_pressed() {
            self.row.latched_share = Some(self.latched as f64 / self.steps as f64);
            let frozen = self.grasps.frozen_steps() - self.frozen_before;
            self.row.substructured_share = (self.latched > 0).then(|| frozen as f64 / self.latched as f64);
        }
    }

    /// Once all loads are borne: the verdict, and since when and under which load it was lost.
    fn judge(self) -> (Verdict, Option<(f64, usize)>) {
        let lost = self.gone.or(self.untouched);
        self.row.final_offset_m = Some(self.offset);
        let verdict = match classify(lost.is_some(), self.row.max_motion_m.unwrap_or(0.0), self.offset) {
            Outcome::Held => Verdict::Held,
            Outcome::Slid => Verdict::Slid,
            Outcome::Lost => Verdict::Lost,
        };
        (verdict, lost)
    }
}
