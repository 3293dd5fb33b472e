//! One set of axes with curves: the panels of a motion plot.

use plotters::coord::ranged1d::{BoldPoints, Ranged};
use plotters::prelude::*;

use super::ReportError;
use super::canvas::{Canvas, GREY, INK};
use super::series::Run;

/// How a curve is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Pen {
    pub color: RGBColor,
    pub width: f64,
    /// Draw dashes instead of one stroke.
    pub dashed: bool,
}

/// Axes with curves over them. Both axes are given, so that panels can share them.
pub(crate) struct Panel<'a> {
    pub x_label: &'a str,
    pub y_label: &'a str,
    pub x: (f64, f64),
    pub y: (f64, f64),
    pub shaded: Vec<Shade>,
    pub verticals: Vec<(f64, Pen)>,
    pub horizontals: Vec<(f64, Pen)>,
    pub curves: Vec<(Vec<Run>, Pen)>,
    /// Written in the middle, for a panel without curves.
    pub note: Option<&'a str>,
}

/// A coloured ground under an interval of x, from the foot of the panel up to this part of its height.
pub(crate) struct Shade {
    pub x: (f64, f64),
    pub top: f64,
    pub color: RGBColor,
}

/// Ground under a push.
pub(crate) const SHADE: RGBColor = RGBColor(248, 236, 200);

/// At most so many labels on an axis.
const X_TICKS: usize = 8;
const Y_TICKS: usize = 5;

impl Panel<'_> {
    pub fn draw<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> Result<(), ReportError> {
        let (x0, x1) = self.x;
        let (y0, y1) = self.y;
        let mut chart = ChartBuilder::on(&canvas.area)
            .margin_top(canvas.px(8.0))
            .margin_left(canvas.px(12.0))
            .margin_right(canvas.px(16.0))
            .x_label_area_size(canvas.px(40.0))
            .y_label_area_size(canvas.px(68.0))
            .build_cartesian_2d(x0..x1, y0..y1)?;
        for shade in &self.shaded {
            let (start, end) = (shade.x.0.clamp(x0, x1), shade.x.1.clamp(x0, x1));
            let top = y0 + shade.top * (y1 - y0);
            chart.draw_series([Rectangle::new([(start, y0), (end, top)], shade.color.filled())])?;
        }
        chart
            .configure_mesh()
            .x_labels(X_TICKS)
            .y_labels(Y_TICKS)
            .x_desc(self.x_label)
            .y_desc(self.y_label)
            .axis_desc_style(canvas.font(15.0, INK))
            .label_style(canvas.font(14.0, INK))
            .x_label_formatter(&|v| tick(*v, label_step(x0, x1, X_TICKS)))
            .y_label_formatter(&|v| tick(*v, label_step(y0, y1, Y_TICKS)))
            .axis_style(GREY.stroke_width(canvas.px(1.0) as u32))
            .bold_line_style(RGBColor(222, 222, 222).stroke_width(canvas.px(1.0) as u32))
            .light_line_style(TRANSPARENT)
            .draw()?;
        for &(value, pen) in self.horizontals.iter().filter(|(v, _)| (y0..=y1).contains(v)) {
            line(&mut chart, canvas, &[(x0, value), (x1, value)], pen)?;
        }
        for &(value, pen) in self.verticals.iter().filter(|(v, _)| (x0..=x1).contains(v)) {
            line(&mut chart, canvas, &[(value, y0), (value, y1)], pen)?;
        }
        for (runs, pen) in &self.curves {
            for run in runs {
                line(&mut chart, canvas, run, *pen)?;
            }
        }
        if let Some(note) = self.note {
            let style = canvas.font(15.0, GREY).pos(super::canvas::MIDDLE);
            let middle = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
            chart.draw_series([Text::new(note.to_owned(), middle, style)])?;
        }
        Ok(())
    }
}

type Axes = plotters::coord::types::RangedCoordf64;
type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<Axes, Axes>>;

fn line<B: DrawingBackend>(
    chart: &mut Chart<'_, B>,
    canvas: &Canvas<B>,
    points: &[(f64, f64)],
    pen: Pen,
) -> Result<(), ReportError> {
    let stroke = pen.color.stroke_width(canvas.px(pen.width).max(1) as u32);
    if let [only] = points {
        // A sample between two gaps: a line would have no length.
        chart.draw_series([Circle::new(*only, canvas.px(pen.width), pen.color.filled())])?;
    } else if pen.dashed {
        let (dash, gap) = (canvas.px(6.0), canvas.px(4.0));
        chart.draw_series(DashedLineSeries::new(points.iter().copied(), dash, gap, stroke))?;
    } else {
        chart.draw_series([PathElement::new(points.to_vec(), stroke)])?;
    }
    Ok(())
}

/// The smallest of 1, 2, 5 times a power of ten that divides `span` into at most `ticks` intervals.
pub(crate) fn tick_step(span: f64, ticks: usize) -> f64 {
    let least = (span / ticks.max(1) as f64).max(f64::MIN_POSITIVE);
    let decade = 10f64.powf(least.log10().floor());
    let steps = [1.0, 2.0, 5.0].map(|m| m * decade);
    steps.into_iter().find(|s| *s >= least * (1.0 - 1e-9)).unwrap_or(10.0 * decade)
}

/// How far apart the labels of an axis are: plotters chooses them, and not always as [`tick_step`] would.
pub(crate) fn label_step(low: f64, high: f64, ticks: usize) -> f64 {
    match Axes::from(low..high).key_points(BoldPoints(ticks))[..] {
        [first, second, ..] => second - first,
        _ => tick_step(high - low, ticks),
    }
}

/// A tick's label, with the decimals that ticks `step` apart need.
pub(crate) fn tick(value: f64, step: f64) -> String {
    if value.abs() < 1e-6 * step {
        return "0".to_owned();
    }
    if !(1e-4..1e5).contains(&step) {
        return format!("{value:.1e}");
    }
    let decimals = (-(step * (1.0 + 1e-9)).log10().floor()).clamp(0.0, 4.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::{label_step, tick, tick_step};

    #[test]
    fn ticks_have_the_decimals_that_their_step_needs() {
        assert_eq!(tick(0.5, tick_step(4.0, 8)), "0.5");
        assert_eq!(tick(0.2, tick_step(0.4, 5)), "0.2");
        assert_eq!(tick(12.0, tick_step(50.0, 5)), "12");
        assert_eq!(tick(-1e-17, tick_step(1.0, 5)), "0");
        assert_eq!(tick(0.015, tick_step(0.02, 5)), "0.015");
        assert_eq!(tick(2e-6, tick_step(1e-5, 5)), "2.0e-6");
    }

    /// They were "0", "0", "1", "2", "2".
    #[test]
    fn labels_half_a_unit_apart_have_a_decimal() {
        assert_eq!([0.0, 0.5, 1.0].map(|v| tick(v, label_step(-0.33, 2.4, 5))), ["0", "0.5", "1.0"]);
    }

    #[test]
    fn steps_are_round_and_do_not_crowd_the_axis() {
        for (span, ticks, step) in [(10.0, 5, 2.0), (1.1, 5, 0.5), (380.0, 5, 100.0), (0.03, 8, 0.005)] {
            assert!((tick_step(span, ticks) - step).abs() < 1e-12, "{span}/{ticks}: {}", tick_step(span, ticks));
        }
    }
}
