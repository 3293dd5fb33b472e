//! Charts of one grasp in both modes, and their numbers.

use std::collections::BTreeMap;

use mujoco_grasp::grasp::{Grasp, Limits};
use mujoco_grasp::mujoco::{BodyId, CompiledModel};
use mujoco_grasp::report::{Series, Tier, TimeChart};
use mujoco_grasp::scenario::outcome::{Motion, Summary, lost_at, median, quantile};
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::{Pair, Run};
use mujoco_grasp::scenario::trajectory::{Sample, Trajectory};

use crate::pictures::{PLOTTED_MOTION_MM, plotted_from};

/// Grounds and costs are told of so long a time [s].
const BIN: f64 = 0.04;

/// What a run does not say of a grasp.
pub struct Facts {
    pub index: usize,
    pub target: String,
    pub palm: String,
    pub limits: Limits,
    pub latch_quality: f64,
    pub release_quality: f64,
    pub palm_id: BodyId,
    /// Of each link, in the order of a trajectory's forces, the first body of its finger.
    fingers: Vec<BodyId>,
}

impl Facts {
    pub fn of(model: &CompiledModel, index: usize, grasp: &Grasp) -> Self {
        let palm_id = grasp.palm();
        Self {
            index,
            target: name(model, grasp.target()),
            palm: name(model, palm_id),
            limits: grasp.limits(),
            latch_quality: grasp.latch_quality(),
            release_quality: grasp.release_quality(),
            palm_id,
            fingers: grasp.links().iter().map(|&link| finger(model, palm_id, link)).collect(),
        }
    }

    /// Each finger, with its name.
    pub fn fingers(&self, model: &CompiledModel) -> Vec<(BodyId, String)> {
        let mut fingers: Vec<BodyId> = Vec::new();
        for &finger in &self.fingers {
            if !fingers.contains(&finger) {
                fingers.push(finger);
            }
        }
        fingers.into_iter().map(|finger| (finger, name(model, finger))).collect()
    }

    /// The finger that a link belongs to.
    pub fn finger_of(&self, model: &CompiledModel, link: BodyId) -> BodyId {
        finger(model, self.palm_id, link)
    }

    /// All normal forces of a finger in a step [N].
    pub fn force_of(&self, finger: BodyId, trajectory: &Trajectory, step: usize) -> f64 {
        let forces = trajectory.normal_forces(step).iter().zip(&self.fingers);
        forces.filter(|(_, f)| **f == finger).map(|(force, _)| force).sum()
    }
}

/// As in tables.
pub fn name(model: &CompiledModel, body: BodyId) -> String {
    model.body_name(body).map_or_else(|| model.label(body), str::to_owned)
}

/// The body below the palm through which the link hangs on it; the palm itself for the palm.
fn finger(model: &CompiledModel, palm: BodyId, link: BodyId) -> BodyId {
    let parent = |body: BodyId| model.body_parentid()[body.index()] as usize;
    let mut body = link;
    while body != palm && parent(body) != palm.index() && parent(body) != 0 {
        body = BodyId::from_index(parent(body));
    }
    body
}

/// One grasp of a pair of runs.
pub struct Told<'a> {
    plan: &'a Plan,
    facts: &'a Facts,
    push: Option<&'a Push>,
    pair: &'a Pair,
    /// Name, trajectory.
    modes: Vec<(&'static str, &'a Trajectory)>,
    tiers: Vec<Tier>,
    /// From when on there is something to see [s].
    start: f64,
}

/// The trajectory and numbers of a grasp by its place in the scenario.
pub fn of_grasp(run: &Run, index: usize) -> (&Trajectory, &Summary) {
    match run.others.iter().find(|other| other.index == index) {
        Some(other) => (&other.trajectory, &other.summary),
        None => (&run.trajectory, &run.summary),
    }
}

impl<'a> Told<'a> {
    pub fn new(plan: &'a Plan, facts: &'a Facts, pair: &'a Pair, push: Option<&'a Push>) -> Self {
        let modes = pair.runs().map(|run| (run.mode.name(), of_grasp(run, facts.index).0)).collect();
        let grasp = pair.grasp.as_ref().map(|run| of_grasp(run, facts.index));
        let tiers = grasp.map(|(trajectory, _)| tiers(trajectory.samples())).unwrap_or_default();
        let start = plotted_from(plan, grasp.and_then(|(_, summary)| summary.latched_at_s));
        Self { plan, facts, push, pair, modes, tiers, start }
    }

    /// While it holds, where both modes lose the target in the end: how that falls is not what the axes are for.
    fn held(&self) -> Option<(f64, f64)> {
        let from = self.plan.timeline.measure_from();
        let lost = self.modes.iter().all(|(_, trajectory)| lost_at(trajectory, from).is_some());
        self.tiers.first().zip(self.tiers.last()).filter(|_| lost).map(|(first, last)| (first.start_s, last.end_s))
    }

    fn chart(&self, y_label: impl Into<String>, series: Vec<Series>) -> TimeChart {
        TimeChart {
            y_label: y_label.into(),
            series,
            tiers: self.tiers.clone(),
            push_s: self.push.map(|p| (p.start, p.end)),
            window_s: Some((self.start, self.plan.timeline.duration)),
            ..TimeChart::default()
        }
    }

    /// A quantity of each step in each mode, from the start of the window on.
    fn series(&self, value: impl Fn(&Trajectory, usize) -> f64) -> Vec<Series> {
        let of_mode = |(mode, trajectory): &(&str, &Trajectory)| {
            let first = trajectory.index_at(self.start).unwrap_or(trajectory.samples().len());
            let point = |i: usize| (trajectory.samples()[i].time, value(trajectory, i));
            Series { label: (*mode).to_owned(), points: (first..trajectory.samples().len()).map(point).collect() }
        };
        self.modes.iter().map(of_mode).collect()
    }

    /// The target's motion in both modes, and how far these are apart.
    pub fn motion(&self) -> Vec<TimeChart> {
        let from = self.plan.timeline.measure_from();
        let moved = |trajectory: &Trajectory, i: usize| {
            let samples = trajectory.samples();
            trajectory.index_at(from).map(|first| Motion::between(&samples[first], &samples[i]))
        };
        let motion = |label: &str, value: fn(&Motion) -> f64| {
            let series = self.series(|t, i| moved(t, i).map_or(f64::NAN, |m| value(&m)));
            let fit_s = self.held();
            TimeChart { limit: Some(PLOTTED_MOTION_MM), fit_s, least_span: 0.01, ..self.chart(label, series) }
        };
        let mut charts = vec![
            motion("distance moved [mm]", |m| m.offset.norm() * 1e3),
            motion("x in palm [mm]", |m| m.offset.x * 1e3),
            motion("y in palm [mm]", |m| m.offset.y * 1e3),
            motion("z in palm [mm]", |m| m.offset.z * 1e3),
            TimeChart { limit: None, ..motion("rotation [deg]", |m| m.rotation.angle().to_degrees()) },
        ];
        charts.extend(self.apart("positions apart [um]", |a, b| (a.offset - b.offset).norm() * 1e6));
        charts.extend(self.apart("attitudes apart [mrad]", |a, b| a.rotation.angle_to(&b.rotation) * 1e3));
        charts
    }

    /// The difference of both modes, until either has lost the target.
    fn apart(&self, label: &str, difference: fn(&Motion, &Motion) -> f64) -> Option<TimeChart> {
        let from = self.plan.timeline.measure_from();
        let [(_, full), (_, grasp)] = self.modes[..] else { return None };
        let (a0, b0) = (full.index_at(from)?, grasp.index_at(from)?);
        let (a, b) = (full.samples(), grasp.samples());
        let until = |trajectory: &Trajectory, first: usize| {
            lost_at(trajectory, from).unwrap_or(trajectory.samples().len()).saturating_sub(first)
        };
        let point = |k: usize| {
            let motions = [Motion::between(&a[a0], &a[a0 + k]), Motion::between(&b[b0], &b[b0 + k])];
            (a[a0 + k].time, difference(&motions[0], &motions[1]))
        };
        let points = (0..until(full, a0).min(until(grasp, b0))).map(point).collect();
        Some(self.chart(label, vec![Series { label: "grasp against full".to_owned(), points }]))
    }

    /// Quality with Q_Th and Q_M, all normal forces, those of each finger, and what a step costs.
    pub fn forces(&self) -> Vec<TimeChart> {
        let facts = self.facts;
        let levels = vec![facts.latch_quality, facts.release_quality];
        let quality = self.series(|t, i| t.samples()[i].quality);
        let all = self.series(|t, i| t.normal_forces(i).iter().sum());
        let released_by_force = facts.limits == Limits::Cones;
        let mut charts = vec![
            TimeChart {
                title: "quality Q, with Q_Th and Q_M [N]".into(),
                levels,
                least_span: 0.01,
                ..self.chart("quality Q [N]", quality)
            },
            TimeChart {
                levels: if released_by_force { vec![facts.release_quality] } else { Vec::new() },
                least_span: 0.1,
                title: if released_by_force { "all normal forces, with Q_M [N]".into() } else { String::new() },
                ..self.chart("all normal forces [N]", all)
            },
        ];
        for (finger, label) in facts.fingers(&self.plan.model) {
            let series = self.series(|t, i| facts.force_of(finger, t, i));
            if series.iter().flat_map(|s| &s.points).any(|p| p.1 > 0.0) {
                let title = format!("{label}: normal force [N]");
                charts.push(TimeChart { title, least_span: 0.1, ..self.chart("normal force [N]", series) });
            }
        }
        charts
    }

    /// What a step costs.
    pub fn cost(&self) -> TimeChart {
        let mut series = self.series(|t, i| t.samples()[i].step_ns as f64 * 1e-3);
        for series in &mut series {
            let bins = series.points.chunk_by(|a, b| bin(a.0) == bin(b.0));
            let middle =
                |bin: &[(f64, f64)]| median(bin.iter().map(|p| p.1).collect()).map(|v| (bin[bin.len() / 2].0, v));
            series.points = bins.filter_map(middle).collect();
        }
        let most = quantile(series.iter().flat_map(|s| &s.points).map(|p| p.1).collect(), 0.99);
        TimeChart {
            title: "time per step, medians of 40 ms [us]".into(),
            limit: most,
            least_span: 1.0,
            ..self.chart("time per step [us]", series)
        }
    }

    /// Friction over its limit, each contact a dot.
    pub fn friction(&self) -> Vec<TimeChart> {
        let mut charts = Vec::new();
        let palm = (self.facts.palm_id, self.facts.palm.clone());
        for (finger, label) in self.facts.fingers(&self.plan.model).into_iter().chain([palm]) {
            let of_run = |run: &Run| {
                let mut points = Vec::new();
                for moment in &run.moments {
                    let own = moment.contacts.iter().filter(|c| c.grasp == self.facts.index);
                    let own = own.filter(|c| self.facts.finger_of(&self.plan.model, c.link) == finger);
                    points.extend(own.filter_map(|c| Some((moment.time, c.share?))));
                }
                Series { label: run.mode.name().to_owned(), points }
            };
            let series: Vec<Series> = self.pair.runs().map(of_run).collect();
            if series.iter().any(|s| !s.points.is_empty()) {
                let title = format!("{label}: friction over its limit [1]");
                let chart = TimeChart { title, ..self.chart("friction / limit [1]", series) };
                charts.push(TimeChart { dots: true, levels: vec![1.0, 0.0], limit: Some(1.2), ..chart });
            }
        }
        charts
    }
}

fn bin(time: f64) -> i64 {
    (time / BIN + 1e-6).floor() as i64
}

/// Latched times, and in which of them most steps were made on frozen geometry.
fn tiers(samples: &[Sample]) -> Vec<Tier> {
    let mut tiers: Vec<Tier> = Vec::new();
    let step = samples.windows(2).next().map_or(0.0, |w| w[1].time - w[0].time);
    for bin in samples.chunk_by(|a, b| bin(a.time) == bin(b.time) && a.grasped == b.grasped) {
        let (Some(first), Some(last)) = (bin.first().filter(|s| s.grasped), bin.last()) else { continue };
        let merged = 2 * bin.iter().filter(|s| s.frozen).count() > bin.len();
        let (start_s, end_s) = (first.time, last.time + step);
        match tiers.last_mut() {
            Some(tier) if tier.merged == merged && tier.end_s > start_s - 0.5 * step => tier.end_s = end_s,
            _ => tiers.push(Tier { start_s, end_s, merged }),
        }
    }
    tiers
}

/// The numbers of charts that are lines: a row for each time, a column for each of their series.
pub fn numbers(charts: &[TimeChart]) -> Result<String, csv::Error> {
    let columns: Vec<(String, &Series)> = charts
        .iter()
        .flat_map(|chart| chart.series.iter().map(move |s| (format!("{}: {}", s.label, chart.name()), s)))
        .collect();
    // Times are not negative: their bits are in their order.
    let mut rows: BTreeMap<u64, Vec<String>> = BTreeMap::new();
    for (c, (_, series)) in columns.iter().enumerate() {
        for (time, value) in series.points.iter().filter(|p| p.1.is_finite()) {
            rows.entry(time.to_bits()).or_insert_with(|| vec![String::new(); columns.len()])[c] =
                format!("{value:.4e}");
        }
    }
    let head = ["time_s".to_owned()].into_iter().chain(columns.into_iter().map(|(label, _)| label));
    let rows = rows.into_iter().map(|(time, row)| [f64::from_bits(time).to_string()].into_iter().chain(row).collect());
    table(head.collect(), rows)
}

/// The numbers of the charts of friction.
pub fn contacts(plan: &Plan, pair: &Pair) -> Result<String, csv::Error> {
    let head = ["time_s", "mode", "grasp", "link", "normal_force_n", "friction_n", "friction_over_limit"];
    let rows = pair.runs().flat_map(|run| {
        run.moments.iter().flat_map(move |moment| {
            moment.contacts.iter().map(move |c| {
                let share = c.share.map_or_else(String::new, |s| format!("{s:.4e}"));
                let (normal, friction) = (format!("{:.4e}", c.normal_force), format!("{:.4e}", c.friction));
                let link = name(&plan.model, c.link);
                vec![
                    moment.time.to_string(),
                    run.mode.name().into(),
                    c.grasp.to_string(),
                    link,
                    normal,
                    friction,
                    share,
                ]
            })
        })
    });
    table(head.map(str::to_owned).to_vec(), rows)
}

fn table(head: Vec<String>, rows: impl Iterator<Item = Vec<String>>) -> Result<String, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(head)?;
    rows.into_iter().try_for_each(|row| writer.write_record(row))?;
    let bytes = writer.into_inner().map_err(|e| e.into_error())?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
