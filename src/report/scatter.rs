//! A quantity in one mode against the same quantity in the other.

use std::path::Path;

use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::ReportError;
use super::canvas::{BLUE, Canvas, Figure, GREEN, GREY, INK, ORANGE, PURPLE, VERMILION, text_width};
use super::legend::{self, Sample};
use super::panel::{label_step, tick};

/// Points of one kind: held, slid.
#[derive(Debug, Clone, Default)]
pub struct PointSet {
    /// As the legend names it; it adds the number of points.
    pub label: String,
    /// x and y of each point, in the axes' unit.
    pub points: Vec<(f64, f64)>,
    /// One for each point, written beside it, or none at all. Points with names are drawn as crosses: they are to be found.
    pub names: Vec<String>,
}

/// A scatter plot with the identity line: x from full mode, y from grasp mode. Both axes have the same range.
#[derive(Debug, Clone, Default)]
pub struct Scatter {
    /// Above the figure.
    pub title: String,
    /// With unit: "full: peak motion \[mm\]".
    pub x_label: String,
    /// With unit: "grasp: peak motion \[mm\]".
    pub y_label: String,
    /// The points, by kind.
    pub sets: Vec<PointSet>,
    /// Logarithmic axes. Points with a coordinate that is not positive cannot be shown; the figure says how many.
    pub log: bool,
}

const FIGURE: &str = "scatter plot";
const SIZE: (u32, u32) = (480, 600);
const TITLE_HEIGHT: f64 = 44.0;
/// At most so many labels on an axis.
const TICKS: usize = 8;

impl Scatter {
    /// Saves as SVG or PNG (at twice the size in pixels), as the name's ending says.
    ///
    /// # Errors
    /// [`ReportError::Empty`] when no point can be shown, and what writing the file brings.
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

    fn shown(&self, &(x, y): &(f64, f64)) -> bool {
        x.is_finite() && y.is_finite() && (!self.log || (x > 0.0 && y > 0.0))
    }

    fn left_out(&self) -> usize {
        self.sets.iter().flat_map(|s| &s.points).filter(|p| !self.shown(p)).count()
    }

    /// The common range of both axes, with a margin.
    fn range(&self) -> Option<(f64, f64)> {
        let shown = self.sets.iter().flat_map(|s| &s.points).filter(|p| self.shown(p));
        let (low, high) = shown
            .flat_map(|&(x, y)| [x, y])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return None;
        }
        if self.log {
            return Some((low / 1.5, high * 1.5));
        }
        let margin = 0.06 * (high - low).max(1e-9 * high.abs()).max(1e-12);
        // Positive quantities start at zero, so that the identity line starts in the corner.
        Some((if low >= 0.0 { 0.0 } else { low - margin }, high + margin))
    }

    fn legend(&self) -> Vec<(Sample, String)> {
        let mut entries: Vec<_> = (self.sets.iter().enumerate())
            .map(|(i, set)| {
                let shown = set.points.iter().filter(|p| self.shown(p)).count();
                let sample = if set.names.is_empty() { Sample::Dot(color(i)) } else { Sample::Cross(color(i)) };
                (sample, format!("{} ({shown})", set.label))
            })
            .collect();
        let pen = super::panel::Pen { color: GREY, width: 1.2, dashed: true };
        entries.push((Sample::Line(pen), "equal in both".to_owned()));
        entries
    }

    fn draw_axes<B, X, Y>(&self, canvas: &Canvas<B>, x: X, y: Y, (low, high): (f64, f64)) -> Result<(), ReportError>
    where
        B: DrawingBackend,
        X: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let label = |v: &f64| {
            if self.log { log_tick(*v) } else { tick(*v, label_step(low, high, TICKS)) }
        };
        let mut chart = ChartBuilder::on(&canvas.area)
            .margin_top(canvas.px(8.0))
            .margin_left(canvas.px(12.0))
            .margin_right(canvas.px(24.0))
            .x_label_area_size(canvas.px(50.0))
            .y_label_area_size(canvas.px(76.0))
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .x_labels(TICKS)
            .y_labels(TICKS)
            .axis_desc_style(canvas.font(17.0, INK))
            .label_style(canvas.font(15.0, INK))
            .x_label_formatter(&label)
            .y_label_formatter(&label)
            .axis_style(GREY.stroke_width(canvas.px(1.0) as u32))
            .bold_line_style(RGBColor(222, 222, 222).stroke_width(canvas.px(1.0) as u32))
            .light_line_style(TRANSPARENT)
            .draw()?;
        let stroke = GREY.stroke_width(canvas.px(1.2).max(1) as u32);
        let identity = [(low, low), (high, high)];
        chart.draw_series(DashedLineSeries::new(identity, canvas.px(6.0), canvas.px(4.0), stroke))?;
        for (i, set) in self.sets.iter().enumerate() {
            if set.names.is_empty() {
                let style = color(i).mix(0.75).filled();
                let shown = set.points.iter().filter(|p| self.shown(p));
                chart.draw_series(shown.map(|&point| Circle::new(point, canvas.px(4.0), style)))?;
                continue;
            }
            let style = color(i).stroke_width(canvas.px(2.0).max(1) as u32);
            let shown = set.points.iter().zip(&set.names).filter(|(p, _)| self.shown(p));
            chart.draw_series(shown.enumerate().map(|(k, (&point, name))| {
                // To the right and to the left by turns, for those that lie close together.
                let left = canvas.px(12.0 + text_width(name, 13.0));
                let beside = (if k % 2 == 0 { canvas.px(8.0) } else { -left }, -canvas.px(7.0));
                EmptyElement::at(point)
                    + Cross::new((0, 0), canvas.px(5.0), style)
                    + Text::new(name.clone(), beside, canvas.font(13.0, INK))
            }))?;
        }
        Ok(())
    }
}

fn color(i: usize) -> RGBColor {
    [BLUE, VERMILION, GREEN, PURPLE, ORANGE][i % 5]
}

fn log_tick(value: f64) -> String {
    if (1e-3..1e5).contains(&value) {
        format!("{value:.3}").trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.0e}")
    }
}

impl Figure for Scatter {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn check(&self) -> Result<(), ReportError> {
        if let Some(set) = self.sets.iter().find(|s| !s.names.is_empty() && s.names.len() != s.points.len()) {
            let (found, expected) = (set.names.len(), set.points.len());
            let (series, field) = (set.label.clone(), "names");
            return Err(ReportError::Length { figure: FIGURE, series, field, found, expected });
        }
        let missing = match self.log {
            true => "no point has two positive finite coordinates (logarithmic axes show no others)",
            false => "no point has two finite coordinates",
        };
        self.range().map(drop).ok_or_else(|| ReportError::Empty { figure: FIGURE, missing: missing.to_owned() })
    }

    fn draw<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> Result<(), ReportError> {
        let Some((low, high)) = self.range() else {
            return Ok(());
        };
        let (width, height) = canvas.size();
        let size = 20f64.min(20.0 * (width - 30.0) / text_width(&self.title, 20.0).max(1.0));
        canvas.text(&self.title, (0.5 * width, 0.5 * TITLE_HEIGHT), size, INK, HPos::Center)?;
        let (_, body) = canvas.area.split_vertically(canvas.px(TITLE_HEIGHT));
        let entries = self.legend();
        let legend_height = 24.0 * (entries.len() as f64 + 1.0) + if self.left_out() > 0 { 24.0 } else { 0.0 };
        let (square, below) = body.split_vertically(canvas.px(height - TITLE_HEIGHT - legend_height));
        let square = canvas.part(square);
        let axis = || low..high;
        if self.log {
            self.draw_axes(&square, axis().log_scale(), axis().log_scale(), (low, high))?;
        } else {
            self.draw_axes(&square, axis(), axis(), (low, high))?;
        }
        let below = canvas.part(below);
        legend::draw(&below, &entries)?;
        match self.left_out() {
            0 => Ok(()),
            n => {
                let why = if self.log { "not positive or not finite" } else { "not finite" };
                let note = format!("points left out: {n} ({why})");
                below.text(&note, (68.0, legend_height - 24.0), 14.0, GREY, HPos::Left)
            }
        }
    }
}
