//! Quantities against another: costs against the size of a model.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::ReportError;
use super::canvas::{BLUE, Canvas, Figure, GREEN, GREY, INK, ORANGE, PURPLE, VERMILION, text_width};
use super::legend::{self, Sample};
use super::panel::{Panel, Pen};
use super::series::{Run, clip};

/// One curve: its points are joined by lines, and marked.
#[derive(Debug, Clone, Default)]
pub struct Curve {
    /// As the legend names it.
    pub label: String,
    /// x and y of each point, in the axes' unit, in the order in which they are joined.
    pub points: Vec<(f64, f64)>,
}

/// Curves over one pair of axes, both from zero, so that lengths compare as numbers do.
///
/// ```
/// use mujoco_grasp::report::{Curve, Curves};
/// let curves = Curves {
///     title: "A grasped step is a straight line".into(),
///     x_label: "contacts".into(),
///     y_label: "time per step, median [us]".into(),
///     curves: vec![Curve { label: "grasp".into(), points: vec![(5.0, 30.0), (80.0, 160.0)] }],
///     y_limit: None,
/// };
/// assert!(curves.svg()?.contains("time per step, median [us]"));
/// # Ok::<(), mujoco_grasp::report::ReportError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Curves {
    /// Above the figure.
    pub title: String,
    /// With unit.
    pub x_label: String,
    /// With unit.
    pub y_label: String,
    /// In the order of the legend.
    pub curves: Vec<Curve>,
    /// Curves are cut at this height, so that one that is far above the others does not flatten them. No cut when absent.
    pub y_limit: Option<f64>,
}

const FIGURE: &str = "curves";
const SIZE: (u32, u32) = (860, 640);
const TITLE_HEIGHT: f64 = 44.0;
const LEGEND_LINE: f64 = 24.0;
/// Room above the highest point, and to the right of the last.
const MARGIN: f64 = 1.05;

impl Curves {
    /// Saves as SVG or PNG (at twice the size in pixels), as the name's ending says.
    ///
    /// # Errors
    /// [`ReportError::Empty`] when no curve has a point, [`ReportError::BadNumber`] for a coordinate that is negative or not
    /// finite, and what writing the file brings.
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

    /// Where the axes end.
    fn extent(&self) -> (f64, f64) {
        let top = |highest: f64| if highest > 0.0 { MARGIN * highest } else { 1.0 };
        let limit = self.y_limit.unwrap_or(f64::INFINITY);
        (top(self.highest(|p| p.0)), top(self.highest(|p| p.1)).min(limit))
    }

    fn highest(&self, coordinate: impl Fn(&(f64, f64)) -> f64) -> f64 {
        self.curves.iter().flat_map(|c| &c.points).map(coordinate).fold(0.0, f64::max)
    }

    /// Each curve as one line, and each of its points as a dot of its own.
    fn drawn(&self, top: f64) -> Vec<(Vec<Run>, Pen)> {
        let of_curve = |(i, curve): (usize, &Curve)| {
            let dots: Vec<Run> = curve.points.iter().map(|&point| vec![point]).collect();
            let line = clip(std::slice::from_ref(&curve.points), (0.0, top));
            [(line, pen(i)), (clip(&dots, (0.0, top)), Pen { width: 4.5, ..pen(i) })]
        };
        self.curves.iter().enumerate().flat_map(of_curve).collect()
    }
}

fn pen(i: usize) -> Pen {
    Pen { color: [VERMILION, BLUE, GREEN, GREY, PURPLE, ORANGE][i % 6], width: 2.0, dashed: false }
}

impl Figure for Curves {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn check(&self) -> Result<(), ReportError> {
        if self.curves.iter().all(|c| c.points.is_empty()) {
            return Err(ReportError::Empty { figure: FIGURE, missing: "no curve has a point".to_owned() });
        }
        if let Some(value) = self.y_limit.filter(|limit| !(limit.is_finite() && *limit > 0.0)) {
            let (what, wanted) = ("y_limit".to_owned(), "finite and positive");
            return Err(ReportError::BadNumber { figure: FIGURE, what, value, wanted });
        }
        let bad = |v: f64| !(v.is_finite() && v >= 0.0);
        for curve in &self.curves {
            if let Some(value) = curve.points.iter().flat_map(|&(x, y)| [x, y]).find(|&v| bad(v)) {
                let what = format!("a coordinate of curve `{}`", curve.label);
                return Err(ReportError::BadNumber { figure: FIGURE, what, value, wanted: "finite and not negative" });
            }
        }
        Ok(())
    }

    fn draw<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> Result<(), ReportError> {
        let (width, height) = canvas.size();
        let size = 20f64.min(20.0 * (width - 30.0) / text_width(&self.title, 20.0).max(1.0));
        canvas.text(&self.title, (0.5 * width, 0.5 * TITLE_HEIGHT), size, INK, HPos::Center)?;
        let (_, body) = canvas.area.split_vertically(canvas.px(TITLE_HEIGHT));
        let legend_height = LEGEND_LINE * (self.curves.len() as f64 + 1.0);
        let (axes, below) = body.split_vertically(canvas.px(height - TITLE_HEIGHT - legend_height));
        let (right, top) = self.extent();
        let panel = Panel {
            x_label: &self.x_label,
            y_label: &self.y_label,
            x: (0.0, right),
            y: (0.0, top),
            shaded: Vec::new(),
            verticals: Vec::new(),
            horizontals: Vec::new(),
            curves: self.drawn(top),
            note: None,
        };
        panel.draw(&canvas.part(axes))?;
        let entry = |(i, curve): (usize, &Curve)| (Sample::Line(pen(i)), curve.label.clone());
        legend::draw(&canvas.part(below), &self.curves.iter().enumerate().map(entry).collect::<Vec<_>>())
    }
}
