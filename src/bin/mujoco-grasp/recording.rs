//! `run --rerun`: scenes and time series of all runs, for the Rerun viewer.

use std::path::Path;

use mujoco_grasp::grasp::{Grasp, GraspId, Limits};
use mujoco_grasp::mujoco::{Camera, Simulation};
use mujoco_grasp::report::{Frame, Look, Recording, ReportError, TimeSeries, View};
use mujoco_grasp::scenario::moment::Moment;
use mujoco_grasp::scenario::outcome::Motion;
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::{Pair, Run};
use mujoco_grasp::scenario::runner::{Mode, Runner};
use mujoco_grasp::scenario::trajectory::Trajectory;
use nalgebra::Vector3;

use crate::artist::pose_at;
use crate::pictures::describe;
use crate::report::charts::{Facts, of_grasp};

/// Full's and grasp's, and thresholds' (Okabe and Ito 2008).
const COLOURS: [[u8; 3]; 2] = [[86, 180, 233], [230, 120, 40]];
const THRESHOLD: [u8; 3] = [150, 150, 150];

/// Writes a recording for each push, and returns the size of the file in bytes.
pub fn save(plan: &Plan, pairs: &[Pair], path: &Path) -> anyhow::Result<u64> {
    let runner = Runner::new(plan, Mode::Full, None)?;
    let grasps = runner.grasps().iter().enumerate();
    let facts: Vec<Facts> = grasps.map(|(index, grasp)| Facts::of(&plan.model, index, grasp)).collect();
    let several = facts.len() > 1;
    let prefix = |facts: &Facts| if several { format!("grasp{}/", facts.index) } else { String::new() };
    let mut sim = Simulation::new(&plan.model)?;
    let eye = eye(plan, pairs, &runner.grasps()[GraspId::FIRST], &mut sim)?;
    let views = views(pairs, facts.iter().map(prefix), eye);
    let mut recording = Recording::new(&format!("mujoco-grasp {}", plan.name), &views)?;
    for pair in pairs {
        let push = plan.pushes.iter().find(|p| p.name == pair.push);
        recording.begin(&format!("{}, {}", plan.name, describe(push)))?;
        for run in pair.runs() {
            let frames: Vec<Frame<'_>> = run.moments.iter().map(frame).collect();
            recording.scene(&format!("scene/{}", run.mode.name()), &mut sim, &frames)?;
        }
        for facts in &facts {
            let told = Told { plan, facts, pair, prefix: prefix(facts) };
            told.series(&mut recording)?;
            told.events(&mut recording, push)?;
        }
    }
    Ok(recording.save(path)?)
}

fn frame(moment: &Moment) -> Frame<'_> {
    let forces = moment.contacts.iter().map(|c| (c.position, c.force)).collect();
    Frame { time_s: moment.time, qpos: &moment.qpos, forces }
}

/// From where the pictures of a run are taken, and what is in their middle; `None` where there is nothing to see.
fn eye(plan: &Plan, pairs: &[Pair], grasp: &Grasp, sim: &mut Simulation) -> anyhow::Result<Option<[Vector3<f64>; 2]>> {
    let from = plan.timeline.measure_from();
    let first = pairs.iter().flat_map(Pair::runs).find_map(|run| pose_at(run, from).or(pose_at(run, 0.0)));
    let Some(qpos) = first else { return Ok(None) };
    sim.qpos_mut().copy_from_slice(qpos);
    sim.kinematics()?;
    let camera = Camera::for_grasp(sim, grasp.palm(), grasp.target())?.freed(sim, sim.body_com(grasp.target()))?;
    let Camera::Free { lookat, distance, azimuth_deg, elevation_deg } = camera else { return Ok(None) };
    let ((sin, cos), (up, level)) = (azimuth_deg.to_radians().sin_cos(), elevation_deg.to_radians().sin_cos());
    Ok(Some([lookat - distance * Vector3::new(level * cos, level * sin, up), lookat]))
}

/// A scene for each mode, and below them the plots of each grasp.
fn views(pairs: &[Pair], prefixes: impl Iterator<Item = String>, eye: Option<[Vector3<f64>; 2]>) -> Vec<View> {
    let there = |mode: &Mode| pairs.iter().flat_map(Pair::runs).any(|run| run.mode == *mode);
    let modes = [Mode::Full, Mode::Grasp].into_iter().filter(there).map(Mode::name);
    let scene = |mode: &str| {
        let colour = if mode == Mode::Full.name() { "blue" } else { "orange" };
        let name = format!("{mode}, {colour} in the plots; forces: 1 cm for 1 N");
        let scene = View::scene(&name, &format!("scene/{mode}"));
        match eye {
            Some([from, at]) => scene.seen_from(from.into(), at.into()),
            None => scene,
        }
    };
    let plot = |name: String, at: String| View::plot(&name, &at).without_legend();
    let mut views: Vec<View> = modes.map(scene).collect();
    for at in prefixes {
        views.extend([
            plot(format!("{at}motion of the target in the palm [mm]"), format!("{at}motion_mm")),
            plot(format!("{at}normal forces [N]"), format!("{at}normal_force_n")),
            plot(format!("{at}quality, Q_Th, Q_M [N]"), format!("{at}quality_n")),
            plot(format!("{at}friction over its limit [1]"), format!("{at}friction_over_limit")),
            plot(format!("{at}phase: 1 latched, 2 on frozen geometry"), format!("{at}phase")),
            View::texts(&format!("{at}events"), &format!("{at}events")),
        ]);
    }
    views
}

/// One grasp of a pair of runs.
struct Told<'a> {
    plan: &'a Plan,
    facts: &'a Facts,
    pair: &'a Pair,
    /// Of its paths.
    prefix: String,
}

impl Told<'_> {
    fn series(&self, recording: &mut Recording) -> Result<(), ReportError> {
        let (facts, from) = (self.facts, self.plan.timeline.measure_from());
        type Part = fn(&Motion) -> f64;
        let motions: [(&str, Part); 5] = [
            ("motion_mm/distance", |m| m.offset.norm() * 1e3),
            ("motion_mm/x", |m| m.offset.x * 1e3),
            ("motion_mm/y", |m| m.offset.y * 1e3),
            ("motion_mm/z", |m| m.offset.z * 1e3),
            ("rotation_deg", |m| m.rotation.angle().to_degrees()),
        ];
        for (at, part) in motions {
            self.steps(recording, at, |t, i| {
                t.index_at(from).map(|first| part(&Motion::between(&t.samples()[first], &t.samples()[i])))
            })?;
        }
        self.steps(recording, "quality_n", |t, i| Some(t.samples()[i].quality))?;
        self.threshold(recording, "quality_n/Q_Th", facts.latch_quality)?;
        self.threshold(recording, "quality_n/Q_M", facts.release_quality)?;
        self.steps(recording, "phase", |t, i| Some(t.samples()[i].phase().into()))?;
        self.steps(recording, "normal_force_n/all", |t, i| Some(t.normal_forces(i).iter().sum()))?;
        if facts.limits == Limits::Cones {
            // What cones are let go by.
            self.threshold(recording, "normal_force_n/all/Q_M", facts.release_quality)?;
        }
        for (finger, name) in facts.fingers(&self.plan.model) {
            self.steps(recording, &format!("normal_force_n/{name}"), |t, i| Some(facts.force_of(finger, t, i)))?;
        }
        let palm = (facts.palm_id, facts.palm.clone());
        for (finger, name) in facts.fingers(&self.plan.model).into_iter().chain([palm]) {
            let shares = |run: &Run| {
                let own = |m: &Moment| {
                    let contacts = m.contacts.iter().filter(|c| c.grasp == facts.index);
                    let contacts = contacts.filter(|c| facts.finger_of(&self.plan.model, c.link) == finger);
                    (m.time, contacts.filter_map(|c| c.share).collect::<Vec<f64>>())
                };
                run.moments.iter().map(own).collect::<Vec<_>>()
            };
            if self.pair.runs().flat_map(shares).any(|(_, shares)| !shares.is_empty()) {
                self.both(recording, &format!("friction_over_limit/{name}"), Look::Dots, shares)?;
            }
        }
        Ok(())
    }

    /// A quantity of each step, in both modes.
    fn steps(
        &self,
        recording: &mut Recording,
        at: &str,
        value: impl Fn(&Trajectory, usize) -> Option<f64>,
    ) -> Result<(), ReportError> {
        self.both(recording, at, Look::Line, |run| {
            let trajectory = of_grasp(run, self.facts.index).0;
            let times = trajectory.samples().iter().map(|s| s.time).enumerate();
            times.filter_map(|(i, time)| Some((time, vec![value(trajectory, i)?]))).collect()
        })
    }

    fn both(
        &self,
        recording: &mut Recording,
        at: &str,
        look: Look,
        points: impl Fn(&Run) -> Vec<(f64, Vec<f64>)>,
    ) -> Result<(), ReportError> {
        for run in self.pair.runs() {
            let (mode, rgb) = (run.mode.name(), COLOURS[usize::from(run.mode == Mode::Grasp)]);
            let series = TimeSeries { name: format!("{at} {mode}"), rgb, look, points: points(run) };
            recording.series(&format!("{}{at}/{mode}", self.prefix), &series)?;
        }
        Ok(())
    }

    /// A level from start to end.
    fn threshold(&self, recording: &mut Recording, at: &str, value: f64) -> Result<(), ReportError> {
        let points = [0.0, self.plan.timeline.duration].map(|time| (time, vec![value])).to_vec();
        let series = TimeSeries { name: at.to_owned(), rgb: THRESHOLD, look: Look::Line, points };
        recording.series(&format!("{}{at}", self.prefix), &series)
    }

    /// The push, latches and releases.
    fn events(&self, recording: &mut Recording, push: Option<&Push>) -> Result<(), ReportError> {
        if let Some(push) = push.filter(|p| p.grasp == self.facts.index) {
            let at = format!("{}events/push", self.prefix);
            recording.text(&at, push.start, &format!("push {}", describe(Some(push))))?;
            recording.text(&at, push.end, "push ends")?;
        }
        for run in self.pair.runs() {
            for change in &of_grasp(run, self.facts.index).1.changes {
                let what = if change.phase == 0 { "released" } else { "latched" };
                recording.text(&format!("{}events/{}", self.prefix, run.mode.name()), change.time_s, what)?;
            }
        }
        Ok(())
    }
}
