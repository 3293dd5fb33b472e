//! Pictures of a run: the target's motion as a plot, and a strip of rendered frames, both modes one above the other.

use std::path::Path;

use image::RgbImage;
use mujoco_grasp::grasp::{GraspId, Grasps};
use mujoco_grasp::mujoco::{Arrow, Camera, Drawing, Renderer, Simulation};
use mujoco_grasp::report::{Mark, MotionPlot, Push as Shade, Row, Strip, Threshold, Trace};
use mujoco_grasp::scenario::outcome::Motion;
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::{Pair, Run};

use crate::output::{complain, message};
use crate::progress::Progress;

const FRAME: (u32, u32) = (400, 320);
/// Frames of a strip, one for each column.
const COLUMNS: usize = 6;
/// Length of the arrow that shows a push, whatever its size \[m\].
const ARROW: f64 = 0.07;
const ARROW_COLOUR: [f32; 4] = [1.0, 0.75, 0.0, 1.0];
/// Plots stop here: what is lost falls for metres \[mm\].
const PLOTTED_MOTION_MM: f64 = 60.0;

/// Writes `motion-PUSH.svg` and `strip-PUSH.png` for each push. Results are there without pictures: what fails is said
/// and left out.
pub fn save_all(plan: &Plan, pairs: &[Pair], out: &Path) {
    let progress = Progress::new(pairs.len() as u64, "drawing");
    let mut artist = match Artist::new(plan) {
        Ok(artist) => Some(artist),
        Err(e) => {
            complain("warning", &format!("no rendered frames: {}", message(&e)));
            None
        }
    };
    for pair in pairs.iter().filter(|p| p.runs().next().is_some()).take_while(|_| !plan.stop.is_asked()) {
        let push = plan.pushes.iter().find(|p| p.name == pair.push);
        if let Err(e) = motion(plan, pair, push, &out.join(format!("motion-{}.svg", pair.push))) {
            complain("warning", &format!("no plot of push {}: {}", pair.push, message(&e)));
        }
        if let Some(artist) = &mut artist
            && let Err(e) = artist.strip(plan, pair, push, &out.join(format!("strip-{}.png", pair.push)))
        {
            complain("warning", &format!("no frames of push {}: {}", pair.push, message(&e)));
        }
        progress.advance(1);
    }
    progress.finish();
}

fn describe(push: Option<&Push>) -> String {
    push.map_or_else(
        || "no push".to_owned(),
        |p| {
            let vector = |v: &nalgebra::Vector3<f64>| format!("({:.3}, {:.3}, {:.3})", v.x, v.y, v.z);
            let torque = if p.torque.norm() > 0.0 { format!(", {} N m", vector(&p.torque)) } else { String::new() };
            format!("{}: {} N{torque}", p.name, vector(&p.force))
        },
    )
}

fn motion(plan: &Plan, pair: &Pair, push: Option<&Push>, path: &Path) -> anyhow::Result<()> {
    let mut marks = Vec::new();
    let mut traces = Vec::new();
    let mut thresholds = Vec::new();
    for run in pair.runs() {
        let trajectory = &run.trajectory;
        let Some(first) = trajectory.index_at(plan.timeline.measure_from()) else { continue };
        let samples = trajectory.samples();
        let mut trace = Trace { label: run.mode.name().to_owned(), ..Trace::default() };
        for (i, sample) in samples.iter().enumerate() {
            let moved = Motion::between(&samples[first], sample);
            trace.time_s.push(sample.time);
            trace.position_mm.push((moved.offset * 1e3).into());
            trace.rotation_deg.push(moved.rotation.angle().to_degrees());
            trace.normal_force_n.push(trajectory.normal_forces(i).iter().sum());
            trace.quality_n.push(sample.quality);
        }
        traces.push(trace);
        let events = [("latched", run.summary.latched_at_s), ("released", run.summary.released_at_s)];
        marks.extend(
            events.into_iter().filter_map(|(label, at)| at.map(|time_s| Mark { time_s, label: label.to_owned() })),
        );
        thresholds = vec![Threshold { quality_n: run.latch_quality, label: "Q_Th".to_owned() }];
    }
    let end = plan.timeline.duration;
    MotionPlot {
        title: format!("{}, {}", plan.name, describe(push)),
        push: push.map(|p| Shade { start_s: p.start, end_s: p.end, label: describe(Some(p)) }),
        marks,
        thresholds,
        traces,
        window_s: Some((plan.timeline.pin_until.min(plan.timeline.measure_from()), end)),
        motion_limit_mm: Some(PLOTTED_MOTION_MM),
    }
    .save(path)?;
    Ok(())
}

/// Renders frames of one scenario.
struct Artist {
    renderer: Renderer,
    sim: Simulation,
}

impl Artist {
    fn new(plan: &Plan) -> anyhow::Result<Self> {
        let sim = Simulation::new(&plan.model)?;
        Ok(Self { renderer: Renderer::new(&plan.model, FRAME.0, FRAME.1)?, sim })
    }

    fn strip(&mut self, plan: &Plan, pair: &Pair, push: Option<&Push>, path: &Path) -> anyhow::Result<()> {
        let times = times(plan, push);
        let Some(first) = pair.runs().find_map(|run| pose_at(run, times[0])) else {
            anyhow::bail!("the run ended before there was anything to see");
        };
        let camera = self.camera(plan, first)?;
        let mut rows = Vec::new();
        for run in pair.runs() {
            let mut frames = Vec::new();
            for &time in &times {
                if let Some(pose) = pose_at(run, time) {
                    frames.push((time, self.frame(pose, camera, push.filter(|p| p.start <= time && time < p.end))?));
                }
            }
            rows.push(Row { label: run.mode.name().to_owned(), frames });
        }
        Strip::new(format!("{}, {}", plan.name, describe(push)), rows).save(path)?;
        Ok(())
    }

    fn pose(&mut self, qpos: &[f64]) -> anyhow::Result<()> {
        self.sim.qpos_mut().copy_from_slice(qpos);
        Ok(self.sim.kinematics()?)
    }

    /// The scene's own camera named `grasp`, else one that has hand and target in view at the first pose.
    fn camera(&mut self, plan: &Plan, first: &[f64]) -> anyhow::Result<Camera> {
        if let Ok(camera) = Camera::named(&plan.model, "grasp") {
            return Ok(camera);
        }
        self.pose(first)?;
        let grasps = Grasps::of(&self.sim, &plan.grasps[0])?;
        let grasp = &grasps[GraspId::FIRST];
        Ok(Camera::on_grasp(&self.sim, grasp.palm(), grasp.target())?)
    }

    fn frame(&mut self, qpos: &[f64], camera: Camera, push: Option<&Push>) -> anyhow::Result<RgbImage> {
        self.pose(qpos)?;
        let mut drawing = Drawing { hide_sites: false, ..Drawing::default() };
        if let Some(push) = push.filter(|p| p.force.norm() > 0.0) {
            let at = self.sim.body_com(push.body);
            drawing.arrows.push(Arrow::to_point(at, push.force, ARROW / push.force.norm(), ARROW_COLOUR));
        }
        Ok(self.renderer.draw(&self.sim, camera, &drawing)?)
    }
}

/// The pose nearest to a time; `None` if the run was over by then.
fn pose_at(run: &Run, time: f64) -> Option<&[f64]> {
    let next = run.poses.iter().position(|(t, _)| *t >= time - 1e-9)?;
    Some(&run.poses[next].1)
}

/// Just before the push, during it, and a little after; without a push all of the measured time.
fn times(plan: &Plan, push: Option<&Push>) -> Vec<f64> {
    let end = plan.timeline.duration - 0.05;
    let (from, to) = push.map_or((plan.timeline.measure_from(), end), |p| {
        ((p.start - 0.1).max(plan.timeline.measure_from()), (p.end + 0.4).min(end))
    });
    (0..COLUMNS).map(|i| from + (to - from) * i as f64 / (COLUMNS - 1) as f64).collect()
}
