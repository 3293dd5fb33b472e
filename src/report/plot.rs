//! The target's motion, contact forces and grasp quality over time, of all modes in the same panels.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::ReportError;
use super::canvas::{BLUE, Canvas, Figure, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION, text_width};
use super::legend::{self, Sample};
use super::panel::{Panel, Pen, SHADE, Shade};
use super::series::{clip, range, runs};
use super::trace::{Mark, Push, Threshold, Trace};

/// Panels of the target's motion over time: distance moved, the three coordinates, rotation, total normal force and
/// quality. The first trace is drawn as a wide pale band and the second as a thin line over it, so that both are seen
/// where they agree.
///
/// ```
/// use mujoco_grasp::report::{MotionPlot, Trace};
/// let trace = Trace {
///     label: "full".into(),
///     time_s: vec![0.0, 0.5, 1.0],
///     position_mm: vec![[0.0; 3], [0.0, -1.2, 0.1], [0.0, -0.1, 0.0]],
///     ..Trace::default()
/// };
/// let plot = MotionPlot { title: "clutch, fp1".into(), traces: vec![trace], ..MotionPlot::default() };
/// assert!(plot.svg()?.contains("distance moved [mm]"));
/// # Ok::<(), mujoco_grasp::report::ReportError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct MotionPlot {
    /// Above the figure.
    pub title: String,
    /// Shaded in every panel.
    pub push: Option<Push>,
    /// Vertical lines in every panel.
    pub marks: Vec<Mark>,
    /// Horizontal lines in the quality panel.
    pub thresholds: Vec<Threshold>,
    /// The modes, full first.
    pub traces: Vec<Trace>,
    /// Times shown, start and end \[s\]; all when absent. The value axes fit what is shown.
    pub window_s: Option<(f64, f64)>,
    /// Cuts the distance and position panels at this distance \[mm\], so that the fall of a lost target does not
    /// flatten what came before. No cut when absent.
    pub motion_limit_mm: Option<f64>,
}

const FIGURE: &str = "motion plot";
const SIZE: (u32, u32) = (1180, 1080);
const TITLE_HEIGHT: f64 = 44.0;
const TIME_LABEL: &str = "time [s]";

impl MotionPlot {
    /// Saves as SVG or PNG (at twice the size in pixels), as the name's ending says.
    ///
    /// # Errors
    /// [`ReportError::BadNumber`] for an event or limit that is not finite, [`ReportError::Empty`] without a finite sample, [`ReportError::Length`] when a column's length is neither 0
    /// nor that of `time_s`, and what writing the file brings.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        self.save_as(path.as_ref())
    }

    /// The figure as an SVG document.
    ///
    /// # Errors
    /// As [`save`](Self::save), but for the file's.
    pub fn svg(&self) -> Result<String, ReportError> {
        self.to_svg()
    }

    /// The window that is shown: the given one, or all times.
    fn window(&self) -> Option<(f64, f64)> {
        let times = || self.traces.iter().flat_map(|t| &t.time_s).copied().filter(|t| t.is_finite());
        let all = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
        let (start, end) = self.window_s.unwrap_or(all);
        (start < end && start.is_finite() && end.is_finite()).then_some((start, end))
    }

    fn check_events(&self) -> Result<(), ReportError> {
        let limit = self.motion_limit_mm.iter().map(|l| ("motion_limit_mm".to_owned(), *l));
        let push = self.push.iter().flat_map(|p| [("start_s", p.start_s), ("end_s", p.end_s)]);
        let push = push.map(|(field, value)| (format!("the push's {field}"), value));
        let mark = |m: &Mark| (format!("time_s of mark `{}`", m.label), m.time_s);
        let level = |t: &Threshold| (format!("quality_n of threshold `{}`", t.label), t.quality_n);
        let marks = self.marks.iter().map(mark).chain(self.thresholds.iter().map(level));
        match limit.chain(push).chain(marks).find(|(_, value)| !value.is_finite()) {
            Some((what, value)) => {
                let wanted = "finite (leave out what did not happen)";
                Err(ReportError::BadNumber { figure: FIGURE, what, value, wanted })
            }
            None => Ok(()),
        }
    }

    fn quantities(&self) -> Vec<Quantity<'_>> {
        let axis = |label, i: usize| Quantity::new(self, label, Scale::Motion, |t| coordinate(t, i));
        vec![
            Quantity::new(self, "distance moved [mm]", Scale::Motion, distance),
            Quantity::new(self, "rotation [deg]", Scale::Least(0.01), |t| t.rotation_deg.clone()),
            axis("x in palm [mm]", 0),
            Quantity::new(self, "normal force [N]", Scale::Least(0.1), |t| t.normal_force_n.clone()),
            axis("y in palm [mm]", 1),
            Quantity::new(self, "quality Q [N]", Scale::Quality, |t| t.quality_n.clone()),
            axis("z in palm [mm]", 2),
        ]
    }

    fn legend(&self) -> Vec<(Sample, String)> {
        let mut entries: Vec<_> =
            self.traces.iter().enumerate().map(|(i, t)| (Sample::Line(trace_pen(i)), t.label.clone())).collect();
        if let Some(push) = &self.push {
            let label = format!("push {}, {} s to {} s", push.label, decimal(push.start_s), decimal(push.end_s));
            entries.push((Sample::Area(SHADE), label));
        }
        for (i, mark) in self.marks.iter().enumerate() {
            entries.push((Sample::Line(mark_pen(i)), format!("{} at {} s", mark.label, decimal(mark.time_s))));
        }
        for (i, level) in self.thresholds.iter().enumerate() {
            let label = format!("{} = {} N", level.label, decimal(level.quality_n));
            entries.push((Sample::Line(threshold_pen(i)), label));
        }
        entries
    }
}

/// How the value axis of a panel is chosen.
#[derive(Clone, Copy, PartialEq)]
enum Scale {
    /// Fits the values, cut at the motion limit.
    Motion,
    /// Fits the values and the thresholds.
    Quality,
    /// Fits the values, spanning at least this much.
    Least(f64),
}

/// One panel's quantity, of all traces.
struct Quantity<'a> {
    plot: &'a MotionPlot,
    label: &'static str,
    scale: Scale,
    columns: Vec<Vec<f64>>,
}

impl<'a> Quantity<'a> {
    fn new(plot: &'a MotionPlot, label: &'static str, scale: Scale, column: impl Fn(&Trace) -> Vec<f64>) -> Self {
        Self { plot, label, scale, columns: plot.traces.iter().map(column).collect() }
    }

    fn values(&self, (start, end): (f64, f64)) -> impl Iterator<Item = f64> {
        let of_trace = move |(trace, column): (&'a Trace, &Vec<f64>)| {
            let shown = trace.time_s.iter().zip(column).filter(|(t, _)| (start..=end).contains(*t));
            shown.map(|(_, v)| *v).collect::<Vec<_>>()
        };
        self.plot.traces.iter().zip(&self.columns).flat_map(of_trace).collect::<Vec<_>>().into_iter()
    }

    fn range(&self, window: (f64, f64)) -> Option<(f64, f64)> {
        let values = self.values(window);
        match self.scale {
            Scale::Least(span) => range(values, span),
            Scale::Motion => {
                let limit = self.plot.motion_limit_mm.unwrap_or(f64::INFINITY).abs();
                range(values.map(|v| v.clamp(-limit, limit)), 0.01)
            }
            Scale::Quality => range(values.chain(self.plot.thresholds.iter().map(|t| t.quality_n)), 0.01),
        }
    }

    fn panel(&self, window: (f64, f64)) -> Panel<'a> {
        const COLUMNS: usize = 1000;
        let has_data = self.values(window).any(f64::is_finite);
        let y = self.range(window).unwrap_or((0.0, 1.0));
        let curve = |(i, (trace, column)): (usize, (&Trace, &Vec<f64>))| {
            (clip(&runs(&trace.time_s, column, window, COLUMNS), y), trace_pen(i))
        };
        let levels = self.plot.thresholds.iter().enumerate().map(|(i, t)| (t.quality_n, threshold_pen(i)));
        Panel {
            x_label: TIME_LABEL,
            y_label: self.label,
            x: window,
            y,
            shaded: self.plot.push.iter().map(|p| Shade { x: (p.start_s, p.end_s), top: 1.0, color: SHADE }).collect(),
            verticals: self.plot.marks.iter().enumerate().map(|(i, m)| (m.time_s, mark_pen(i))).collect(),
            horizontals: levels.filter(|_| self.scale == Scale::Quality).collect(),
            curves: self.plot.traces.iter().zip(&self.columns).enumerate().map(curve).collect(),
            note: (!has_data).then_some("not recorded"),
        }
    }
}

fn distance(trace: &Trace) -> Vec<f64> {
    trace.position_mm.iter().map(|p| p.iter().map(|x| x * x).sum::<f64>().sqrt()).collect()
}

fn coordinate(trace: &Trace, i: usize) -> Vec<f64> {
    trace.position_mm.iter().map(|p| p[i]).collect()
}

fn trace_pen(i: usize) -> Pen {
    let pen = |color, width| Pen { color, width, dashed: false };
    match i {
        0 => pen(SKY, 4.5),
        _ => pen([VERMILION, BLUE, PURPLE, GREEN][(i - 1) % 4], 1.5),
    }
}

fn mark_pen(i: usize) -> Pen {
    Pen { color: [GREEN, PURPLE, BLUE, INK][i % 4], width: 1.5, dashed: true }
}

fn threshold_pen(i: usize) -> Pen {
    Pen { color: [ORANGE, GREY][i % 2], width: 1.5, dashed: true }
}

/// At most three decimals, none that say nothing.
fn decimal(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl Figure for MotionPlot {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn check(&self) -> Result<(), ReportError> {
        for trace in &self.traces {
            let expected = trace.time_s.len();
            for (field, found) in [
                ("position_mm", trace.position_mm.len()),
                ("rotation_deg", trace.rotation_deg.len()),
                ("normal_force_n", trace.normal_force_n.len()),
                ("quality_n", trace.quality_n.len()),
            ] {
                if found != 0 && found != expected {
                    let series = trace.label.clone();
                    return Err(ReportError::Length { figure: FIGURE, series, field, found, expected });
                }
            }
        }
        self.check_events()?;
        let empty = |missing: &str| ReportError::Empty { figure: FIGURE, missing: missing.to_owned() };
        let window = self.window().ok_or_else(|| empty("it needs at least two times, the first before the last"))?;
        let any = self.quantities().iter().any(|q| q.values(window).any(f64::is_finite));
        any.then_some(()).ok_or_else(|| empty("no trace has a finite value in the time window"))
    }

    fn draw<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> Result<(), ReportError> {
        let Some(window) = self.window() else {
            return Ok(());
        };
        let (width, _) = canvas.size();
        let size = 22f64.min(22.0 * (width - 40.0) / text_width(&self.title, 22.0).max(1.0));
        canvas.text(&self.title, (0.5 * width, 0.5 * TITLE_HEIGHT), size, INK, HPos::Center)?;
        let (_, body) = canvas.area.split_vertically(canvas.px(TITLE_HEIGHT));
        let cells = body.split_evenly((4, 2));
        for (quantity, cell) in self.quantities().iter().zip(&cells) {
            quantity.panel(window).draw(&canvas.part(cell.clone()))?;
        }
        // Seven panels leave the eighth cell for the legend.
        match cells.last() {
            Some(cell) => legend::draw(&canvas.part(cell.clone()), &self.legend()),
            None => Ok(()),
        }
    }
}
