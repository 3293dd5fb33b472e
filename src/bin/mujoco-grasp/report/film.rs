//! Frames of the page: films of both modes, and stills of the telling moments.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use image::codecs::jpeg::JpegEncoder;
use mujoco_grasp::mujoco::Camera;
use mujoco_grasp::report::{Film, Still};
use mujoco_grasp::scenario::moment::Moment;
use mujoco_grasp::scenario::outcome::{Motion, lost_at};
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::{Pair, Run};
use rayon::prelude::*;

use crate::artist::{Artist, pose_at, pushing};
use crate::output::{complain, message};
use crate::progress::Progress;

const FRAME: (u32, u32) = (400, 300);
const QUALITY: u8 = 80;
/// At most so many frames of films, for the page's size and the time that it takes. Where both modes are in the same state,
/// as before the latch, they share a frame.
const MOST: usize = 200;
/// Before a push [s].
const BEFORE: f64 = 0.04;

/// Films and stills of each push, in the order of the pairs, and the pictures that they number.
pub struct Shot {
    pub jpegs: Vec<Vec<u8>>,
    pub films: Vec<(Film, Vec<Still>)>,
}

/// What there is to render.
#[derive(Default)]
struct Poses<'a> {
    numbers: HashMap<(Vec<u64>, bool), usize>,
    poses: Vec<(&'a [f64], Option<&'a Push>)>,
}

impl<'a> Poses<'a> {
    fn number(&mut self, qpos: &'a [f64], push: Option<&'a Push>) -> usize {
        let key = (qpos.iter().map(|q| q.to_bits()).collect(), push.is_some());
        match self.numbers.entry(key) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                self.poses.push((qpos, push));
                *new.insert(self.poses.len() - 1)
            }
        }
    }
}

/// Renders all films and stills; the reason where that cannot be done, which is said, too.
pub fn shoot(plan: &Plan, pairs: &[Pair]) -> Result<Shot, String> {
    let stride = stride(plan, pairs);
    let mut poses = Poses::default();
    let shots = pairs.iter().map(|pair| (film(plan, pair, stride, &mut poses), stills(plan, pair, &mut poses)));
    let films = shots.collect();
    render(plan, pairs, &poses.poses).map(|jpegs| Shot { jpegs, films }).map_err(|e| {
        let why = format!("no rendered frames: {}", message(&e));
        complain("warning", &why);
        why
    })
}

/// Films have every so many-th moment: as many as there may be.
fn stride(plan: &Plan, pairs: &[Pair]) -> usize {
    let fits = |stride: &usize| {
        let mut poses = Poses::default();
        pairs.iter().for_each(|pair| drop(film(plan, pair, *stride, &mut poses)));
        poses.poses.len() <= MOST
    };
    (1..MOST).find(fits).unwrap_or(MOST)
}

fn render(plan: &Plan, pairs: &[Pair], poses: &[(&[f64], Option<&Push>)]) -> anyhow::Result<Vec<Vec<u8>>> {
    let from = plan.timeline.measure_from();
    let first = pairs.iter().flat_map(Pair::runs).find_map(|run| pose_at(run, from).or(pose_at(run, 0.0)));
    let Some(first) = first else { anyhow::bail!("the runs ended before there was anything to see") };
    let progress = Progress::new(poses.len() as u64, "drawing");
    let of_thread = |poses: &[(&[f64], Option<&Push>)]| -> anyhow::Result<Vec<Vec<u8>>> {
        // A renderer stays on its thread.
        let mut artist = Artist::new(plan, FRAME)?;
        let camera: Camera = artist.camera(plan, first)?;
        let mut jpegs = Vec::with_capacity(poses.len());
        for &(qpos, push) in poses {
            plan.stop.check()?;
            let mut jpeg = Vec::new();
            JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&artist.frame(qpos, camera, push)?)?;
            jpegs.push(jpeg);
            progress.advance(1);
        }
        Ok(jpegs)
    };
    let share = poses.len().div_ceil(rayon::current_num_threads()).max(1);
    let jpegs = poses.par_chunks(share).map(of_thread).collect::<anyhow::Result<Vec<_>>>();
    progress.finish();
    Ok(jpegs?.concat())
}

fn push_of<'a>(plan: &'a Plan, pair: &Pair) -> Option<&'a Push> {
    plan.pushes.iter().find(|p| p.name == pair.push)
}

/// Every `stride`-th moment in both modes.
fn film<'a>(plan: &'a Plan, pair: &'a Pair, stride: usize, poses: &mut Poses<'a>) -> Film {
    let push = push_of(plan, pair);
    let longest = pair.runs().map(|run| run.moments.as_slice()).max_by_key(|m| m.len()).unwrap_or_default();
    let shown: Vec<usize> = (0..longest.len()).step_by(stride).collect();
    let times_s: Vec<f64> = shown.iter().map(|&i| longest[i].time).collect();
    let mut row = |run: &'a Run| {
        // A run that failed stands still.
        let moment = |&i: &usize| -> Option<&'a Moment> { run.moments.get(i).or(run.moments.last()) };
        let frames = shown.iter().filter_map(moment).map(|m| poses.number(&m.qpos, pushing(push, m.time)));
        (run.mode.name().to_owned(), frames.collect::<Vec<_>>())
    };
    let rows = pair.runs().map(&mut row).filter(|(_, frames)| !frames.is_empty()).collect();
    let start = push.map_or(plan.timeline.measure_from(), |p| p.start);
    Film {
        about: about(plan, pair),
        notes: times_s.iter().map(|&time| note(pair, push, time)).collect(),
        first: times_s.iter().position(|t| *t >= start).unwrap_or(0),
        times_s,
        rows,
    }
}

/// For those who do not see it.
pub fn about(plan: &Plan, pair: &Pair) -> String {
    match push_of(plan, pair) {
        Some(push) => format!("{}, push {}", plan.name, push.name),
        None => format!("{}, without push", plan.name),
    }
}

fn note(pair: &Pair, push: Option<&Push>, time: f64) -> &'static str {
    let trajectory = pair.grasp.as_ref().map(|run| &run.trajectory);
    let latched = trajectory.and_then(|t| t.index_at(time).map(|i| t.samples()[i].grasped)).unwrap_or(false);
    match (latched, pushing(push, time).is_some()) {
        (true, true) => "pushed, grasp latched",
        (true, false) => "grasp latched",
        (false, true) => "pushed, grasp not latched",
        (false, false) => "",
    }
}

/// Before, latched, push, peak, slip, let go, end: those that there are.
fn stills<'a>(plan: &'a Plan, pair: &'a Pair, poses: &mut Poses<'a>) -> Vec<Still> {
    let push = push_of(plan, pair);
    let mut stills: Vec<Still> = Vec::new();
    for (label, time) in telling(plan, pair, push) {
        let rows = |poses: &mut Poses<'a>| {
            let frame = |run: &'a Run| {
                let qpos = pose_at(run, time).or(run.moments.last().map(|m| m.qpos.as_slice()))?;
                Some((run.mode.name().to_owned(), poses.number(qpos, pushing(push, time))))
            };
            pair.runs().filter_map(frame).collect::<Vec<_>>()
        };
        let rows = rows(poses);
        match stills.last_mut() {
            // The same frames: one moment with two names.
            Some(last) if last.rows == rows => last.label = format!("{}, {label}", last.label),
            _ => stills.push(Still { label: label.to_owned(), time_s: time, rows }),
        }
    }
    stills
}

fn telling(plan: &Plan, pair: &Pair, push: Option<&Push>) -> Vec<(&'static str, f64)> {
    let from = plan.timeline.measure_from();
    let end = pair.runs().filter_map(|run| run.moments.last()).map(|m| m.time).fold(0.0, f64::max);
    let latch = pair.grasp.as_ref().map(|run| &run.summary);
    let lost_of = |run: &Run| lost_at(&run.trajectory, from).map(|i| run.trajectory.samples()[i].time);
    let lost = pair.runs().filter_map(lost_of).reduce(f64::min);
    let slip = pair.runs().filter_map(|run| run.summary.slip_onset_s).reduce(f64::min);
    let mut moments: Vec<(&str, Option<f64>)> = vec![
        ("latched", latch.and_then(|s| s.latched_at_s)),
        ("before", Some(push.map_or(from, |p| (p.start - BEFORE).max(from)))),
        // Half of it, or of what it takes of it to lose the target.
        ("push", push.map(|p| 0.5 * (p.start + p.end.min(lost.unwrap_or(p.end)).max(p.start)))),
        ("peak", pair.runs().next().and_then(|run| peak(run, from))),
        ("slip", slip),
        ("let go", latch.and_then(|s| s.released_at_s)),
        ("end", Some(end)),
    ];
    moments.retain(|(_, time)| time.is_some_and(|t| t <= end));
    moments.sort_by(|a, b| a.1.partial_cmp(&b.1).unwrap_or(std::cmp::Ordering::Equal));
    moments.into_iter().filter_map(|(label, time)| Some((label, time?))).collect()
}

/// When the target is farthest away, or lost.
fn peak(run: &Run, from: f64) -> Option<f64> {
    let samples = run.trajectory.samples();
    let first = run.trajectory.index_at(from)?;
    let end = lost_at(&run.trajectory, from).map_or(samples.len(), |i| i + 1);
    let offset = |i: &usize| Motion::between(&samples[first], &samples[*i]).offset.norm();
    (first..end).max_by(|a, b| offset(a).total_cmp(&offset(b))).map(|i| samples[i].time)
}
