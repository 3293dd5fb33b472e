//! What a step costs in each mode: the thesis's Table 5.1 and ours, as text and as bars.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::ReportError;
use super::canvas::{Canvas, Figure, GREY, INK, ORANGE, SKY, text_width};
use super::panel::{tick, tick_step};

/// Medians over the steps of one mode \[microseconds\].
#[derive(Debug, Clone, Copy, Default)]
pub struct Timing {
    /// The whole step.
    pub step_us: f64,
    /// The part of it that is spent because of contacts or the grasp; `None` where it cannot be told from the rest.
    pub contact_us: Option<f64>,
}

/// One line of the bench: a scenario in one phase.
#[derive(Debug, Clone, Default)]
pub struct BenchRow {
    /// "clutch, pushed".
    pub label: String,
    /// One inverse-kinematics solve \[microseconds\]; `None` when the scenario has no goals.
    pub ik_us: Option<f64>,
    /// MuJoCo's own contact solve with the scene's options.
    pub full: Timing,
    /// The same with 10 noslip iterations.
    pub full_noslip: Timing,
    /// The grasp constraint.
    pub grasp: Timing,
    /// The same with every step whole, where `grasp` has steps on frozen geometry: its contact part can be told.
    pub exact: Option<Timing>,
    /// Collision, contacts and grasp off.
    pub floor: Timing,
}

/// Guerroudj 2022, Table 5.1 (a 2.70 GHz i7-6820HK): name, inverse kinematics, contact part of the full simulation,
/// contact part of the grasp \[microseconds\].
const THESIS: [(&str, f64, f64, f64); 2] =
    [("thesis, experiment 1", 4306.0, 94.0, 12.0), ("thesis, experiment 2", 2261.0, 39.0, 5.0)];

/// The thesis's Table 5.1 with ours beside it.
#[derive(Debug, Clone, Default)]
pub struct BenchTable {
    /// Above the figure.
    pub title: String,
    /// From top to bottom.
    pub rows: Vec<BenchRow>,
}

const FIGURE: &str = "bench table";
const WIDTH: u32 = 1000;
const TITLE_HEIGHT: f64 = 48.0;
const LEGEND_HEIGHT: f64 = 34.0;
const BAR: f64 = 24.0;
const GROUP_GAP: f64 = 22.0;
const AXIS_HEIGHT: f64 = 50.0;
const LABEL_WIDTH: f64 = 250.0;
/// Right of the longest bar, for its numbers.
const NUMBER_WIDTH: f64 = 150.0;

impl BenchTable {
    /// The table as aligned text, times in microseconds. The thesis has no times of whole steps: "-". The two ratios
    /// are those of the contact parts, full to grasp and full_noslip to grasp; the grasp's is that of whole steps.
    pub fn text(&self) -> String {
        aligned(&self.cells())
    }

    /// The same as cells, the first line its heads.
    pub fn cells(&self) -> Vec<Vec<String>> {
        let head = [
            "[us]",
            "IK",
            "contact full",
            "contact noslip",
            "contact grasp",
            "ratio",
            "ratio noslip",
            "step full",
            "step noslip",
            "step grasp",
            "step floor",
        ];
        let mut lines = vec![head.map(str::to_owned).to_vec()];
        for (name, ik, full, grasp) in THESIS {
            let none = || "-".to_owned();
            let cells = [number(ik), number(full), none(), number(grasp), ratio(full, grasp)];
            let mut line = vec![name.to_owned()];
            line.extend(cells.into_iter().chain(std::iter::repeat_with(none)).take(head.len() - 1));
            lines.push(line);
        }
        for row in &self.rows {
            let modes = [row.full, row.full_noslip, row.grasp];
            let parts = [row.full, row.full_noslip, row.exact.unwrap_or(row.grasp)];
            let mut line = vec![row.label.clone(), row.ik_us.map_or("-".to_owned(), number)];
            line.extend(parts.map(|t| t.contact_us.map_or("-".to_owned(), number)));
            let contact = |t: Timing| t.contact_us.unwrap_or(f64::NAN);
            line.extend([row.full, row.full_noslip].map(|t| ratio(contact(t), contact(parts[2]))));
            line.extend(modes.map(|t| number(t.step_us)));
            line.push(number(row.floor.step_us));
            lines.push(line);
        }
        lines
    }

    /// Saves the bars as SVG or PNG (at twice the size in pixels), as the name's ending says.
    ///
    /// # Errors
    /// [`ReportError::Empty`] without a row, [`ReportError::BadNumber`] for a time that is negative or not finite,
    /// or a contact part larger than its step, and what writing the file brings.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        self.save_as(path.as_ref())
    }

    /// The bars as an SVG document.
    ///
    /// # Errors
    /// As [`save`](Self::save), but for the file's.
    pub fn svg(&self) -> Result<String, ReportError> {
        self.to_svg()
    }

    fn longest(&self) -> f64 {
        self.rows.iter().flat_map(BenchRow::modes).map(|(_, t)| t.step_us).fold(0.0, f64::max)
    }
}

impl BenchRow {
    fn modes(&self) -> impl Iterator<Item = (&'static str, Timing)> {
        let exact = self.exact.map(|timing| ("grasp, whole steps", timing));
        let full = [("full", self.full), ("full, noslip 10", self.full_noslip)];
        full.into_iter().chain(exact).chain([("grasp", self.grasp), ("no contacts", self.floor)])
    }
}

fn number(us: f64) -> String {
    if us.abs() < 9.95 { format!("{us:.1}") } else { format!("{us:.0}") }
}

fn ratio(of: f64, to: f64) -> String {
    let ratio = of / to;
    if ratio.is_finite() { format!("{ratio:.1}x") } else { "-".to_owned() }
}

/// A Markdown table that is also aligned as plain text: names to the left, numbers to the right.
fn aligned(lines: &[Vec<String>]) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let cell_width = |c: usize| lines.iter().filter_map(|l| l.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(cell_width).collect();
    let mut text = String::new();
    for (l, line) in lines.iter().enumerate() {
        for (c, (cell, &width)) in line.iter().zip(&widths).enumerate() {
            text.push_str(&if c == 0 { format!("| {cell:<width$} |") } else { format!(" {cell:>width$} |") });
        }
        text.push('\n');
        if l == 0 {
            let rule = |(c, &width): (usize, &usize)| match c {
                0 => format!("|{}|", "-".repeat(width + 2)),
                _ => format!("{}:|", "-".repeat(width + 1)),
            };
            text.extend(widths.iter().enumerate().map(rule));
            text.push('\n');
        }
    }
    text
}

impl Figure for BenchTable {
    fn size(&self) -> (u32, u32) {
        let bars = |row: &BenchRow| row.modes().count() as f64 * BAR + GROUP_GAP;
        let height = TITLE_HEIGHT + LEGEND_HEIGHT + self.rows.iter().map(bars).sum::<f64>() + AXIS_HEIGHT;
        (WIDTH, height.ceil() as u32)
    }

    fn check(&self) -> Result<(), ReportError> {
        if self.rows.is_empty() {
            return Err(ReportError::Empty { figure: FIGURE, missing: "it has no rows".to_owned() });
        }
        for row in &self.rows {
            for (mode, Timing { step_us, contact_us }) in row.modes() {
                let bad = |field, value, wanted| {
                    let what = format!("{field} of mode `{mode}` in row `{}`", row.label);
                    ReportError::BadNumber { figure: FIGURE, what, value, wanted }
                };
                if !(step_us.is_finite() && step_us > 0.0) {
                    return Err(bad("step_us", step_us, "finite and positive"));
                }
                if let Some(contact_us) = contact_us.filter(|us| !(0.0..=step_us).contains(us)) {
                    return Err(bad("contact_us", contact_us, "between 0 and the row's step_us"));
                }
            }
        }
        Ok(())
    }

    fn draw<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> Result<(), ReportError> {
        let (width, height) = canvas.size();
        let size = 22f64.min(22.0 * (width - 40.0) / text_width(&self.title, 22.0).max(1.0));
        canvas.text(&self.title, (0.5 * width, 0.5 * TITLE_HEIGHT), size, INK, HPos::Center)?;
        let swatches = [(ORANGE, "contact part"), (SKY, "rest of the step"), (INK, "whole step (contact part)")];
        let mut x = LABEL_WIDTH;
        for (i, (color, label)) in swatches.into_iter().enumerate() {
            let y = TITLE_HEIGHT + 0.4 * LEGEND_HEIGHT;
            if i < 2 {
                canvas.rectangle((x, y - 7.0), (x + 20.0, y + 7.0), color)?;
            } else {
                canvas.text("123", (x + 10.0, y), 14.0, color, HPos::Center)?;
            }
            canvas.text(label, (x + 28.0, y), 15.0, INK, HPos::Left)?;
            x += 28.0 + text_width(label, 15.0) + 36.0;
        }
        let scale = (width - LABEL_WIDTH - NUMBER_WIDTH) / self.longest();
        let bottom = height - AXIS_HEIGHT;
        self.draw_ticks(canvas, scale, bottom)?;
        let mut y = TITLE_HEIGHT + LEGEND_HEIGHT;
        for row in &self.rows {
            // The row's name above its four modes' would cost a line each: it stands at the left of the second.
            let name_size = 16f64.min(16.0 * 128.0 / text_width(&row.label, 16.0).max(1.0));
            canvas.text(&row.label, (12.0, y + 2.0 * BAR), name_size, INK, HPos::Left)?;
            for (mode, timing) in row.modes() {
                let (top, low, middle) = (y + 2.0, y + BAR - 2.0, y + 0.5 * BAR);
                let contact = LABEL_WIDTH + scale * timing.contact_us.unwrap_or(0.0);
                let end = LABEL_WIDTH + scale * timing.step_us;
                canvas.rectangle((LABEL_WIDTH, top), (contact, low), ORANGE)?;
                canvas.rectangle((contact, top), (end, low), SKY)?;
                canvas.text(mode, (LABEL_WIDTH - 8.0, middle), 14.0, INK, HPos::Right)?;
                let part = timing.contact_us.map_or_else(String::new, |us| format!(" ({})", number(us)));
                let numbers = format!("{} \u{b5}s{part}", number(timing.step_us));
                canvas.text(&numbers, (end + 8.0, middle), 14.0, INK, HPos::Left)?;
                y += BAR;
            }
            y += GROUP_GAP;
        }
        Ok(())
    }
}

impl BenchTable {
    fn draw_ticks<B: DrawingBackend>(&self, canvas: &Canvas<B>, scale: f64, bottom: f64) -> Result<(), ReportError> {
        let longest = self.longest();
        let step = tick_step(longest, 5);
        let top = TITLE_HEIGHT + LEGEND_HEIGHT - 4.0;
        for i in 0..=(longest / step).floor() as u32 {
            let value = f64::from(i) * step;
            let x = LABEL_WIDTH + scale * value;
            let color = if i == 0 { GREY } else { RGBColor(222, 222, 222) };
            canvas.rectangle((x - 0.5, top), (x + 0.5, bottom), color)?;
            canvas.text(&tick(value, step), (x, bottom + 10.0), 14.0, INK, HPos::Center)?;
        }
        let middle = LABEL_WIDTH + 0.5 * scale * longest;
        canvas.text("time per step, median [\u{b5}s]", (middle, bottom + 34.0), 16.0, INK, HPos::Center)
    }
}
