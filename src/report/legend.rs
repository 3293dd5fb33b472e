//! A legend as a list of samples and labels in a place of its own, where it covers no data.

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::ReportError;
use super::canvas::{Canvas, INK, text_width};
use super::panel::Pen;

/// What stands before a legend's label.
pub(crate) enum Sample {
    Line(Pen),
    Area(RGBColor),
    Dot(RGBColor),
    Cross(RGBColor),
}

/// Draws the entries from top to bottom, with less space between them where they are many.
pub(crate) fn draw<B: DrawingBackend>(canvas: &Canvas<B>, entries: &[(Sample, String)]) -> Result<(), ReportError> {
    const LEFT: f64 = 68.0;
    const SAMPLE: f64 = 34.0;
    let (width, height) = canvas.size();
    let line = (height / (entries.len() as f64 + 1.0)).min(24.0);
    let text_left = LEFT + SAMPLE + 10.0;
    for (i, (sample, label)) in entries.iter().enumerate() {
        let y = line * (i as f64 + 1.0);
        let (left, right) = (canvas.px(LEFT), canvas.px(LEFT + SAMPLE));
        let middle = canvas.px(y);
        match sample {
            Sample::Line(pen) => {
                let stroke = pen.color.stroke_width(canvas.px(pen.width).max(1) as u32);
                let ends = [(left, middle), (right, middle)];
                if pen.dashed {
                    for start in (left..right).step_by(canvas.px(10.0).max(1) as usize) {
                        let end = right.min(start + canvas.px(6.0));
                        canvas.area.draw(&PathElement::new([(start, middle), (end, middle)], stroke))?;
                    }
                } else {
                    canvas.area.draw(&PathElement::new(ends, stroke))?;
                }
            }
            Sample::Area(color) => {
                let half = canvas.px(0.3 * line);
                let corners = [(left, middle - half), (right, middle + half)];
                canvas.area.draw(&Rectangle::new(corners, color.filled()))?;
            }
            Sample::Cross(color) => {
                let stroke = color.stroke_width(canvas.px(2.0).max(1) as u32);
                canvas.area.draw(&Cross::new(((left + right) / 2, middle), canvas.px(5.0), stroke))?;
            }
            Sample::Dot(color) => {
                let centre = ((left + right) / 2, middle);
                canvas.area.draw(&Circle::new(centre, canvas.px(4.0), color.filled()))?;
            }
        }
        // Long labels get a smaller font rather than a cut end.
        let size = 15f64.min(line * 0.85).min(15.0 * (width - text_left) / text_width(label, 15.0).max(1.0));
        canvas.text(label, (text_left, y), size, INK, HPos::Left)?;
    }
    Ok(())
}
