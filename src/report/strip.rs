//! A strip of rendered frames: a row for each mode, a column for each time.

use std::path::Path;

use image::RgbImage;
use image::imageops::replace;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::ReportError;
use super::canvas::{INK, LOWER, draw_on, extension, font, save_png, text_width};

/// The frames of one mode.
#[derive(Debug, Clone)]
pub struct Row {
    /// The mode: "full", "grasp". Written at the left.
    pub label: String,
    /// Time \[s\] and picture of each frame, in the order of the columns.
    pub frames: Vec<(f64, RgbImage)>,
}

/// Frames in rows and columns with a title, the rows' labels and a time under each frame.
#[derive(Debug, Clone)]
pub struct Strip {
    title: String,
    rows: Vec<Row>,
}

const MARGIN: u32 = 16;
const GAP: u32 = 8;
const TITLE: f64 = 28.0;
const TITLE_LINE: u32 = 38;
const LABEL: f64 = 24.0;
const TIME: f64 = 20.0;
const TIME_LINE: u32 = 30;
/// Largest width and height, in pixels: what every viewer opens.
const LIMIT: u32 = 16_384;

/// Where things stand, in pixels.
struct Layout {
    width: u32,
    height: u32,
    frame: (u32, u32),
    left: u32,
    top: u32,
    title: Vec<String>,
}

impl Strip {
    /// A strip of `rows` from top to bottom, under a title that is broken into lines where it is too long.
    pub fn new(title: impl Into<String>, rows: Vec<Row>) -> Self {
        Self { title: title.into(), rows }
    }

    /// The picture.
    ///
    /// # Errors
    /// [`ReportError::Empty`] without a frame, [`ReportError::FrameSize`] when frames differ in size,
    /// [`ReportError::BadNumber`] for a time that is not finite, [`ReportError::TooLarge`] past 16384 pixels.
    pub fn image(&self) -> Result<RgbImage, ReportError> {
        let layout = self.layout()?;
        let mut image = RgbImage::from_pixel(layout.width, layout.height, image::Rgb([255; 3]));
        for (row, column, _, frame) in self.frames() {
            let (x, y) = layout.corner(row, column);
            replace(&mut image, frame, i64::from(x), i64::from(y));
        }
        draw_on(&mut image, |area| self.write_labels(&layout, &area))?;
        Ok(image)
    }

    /// Saves the picture as PNG.
    ///
    /// # Errors
    /// As [`image`](Self::image), a name that does not end in `.png`, and what writing the file brings.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        let path = path.as_ref();
        if extension(path) != "png" {
            return Err(ReportError::Format { path: path.to_owned(), wanted: ".png" });
        }
        save_png(&self.image()?, path)
    }

    /// All frames with row, column and time.
    fn frames(&self) -> impl Iterator<Item = (usize, usize, f64, &RgbImage)> {
        self.rows
            .iter()
            .enumerate()
            .flat_map(|(r, row)| row.frames.iter().enumerate().map(move |(c, (time, frame))| (r, c, *time, frame)))
    }

    fn layout(&self) -> Result<Layout, ReportError> {
        const FIGURE: &str = "strip of frames";
        let Some((_, _, _, first)) = self.frames().next() else {
            return Err(ReportError::Empty { figure: FIGURE, missing: "no row has a frame".to_owned() });
        };
        let frame = first.dimensions();
        for (r, index, time, picture) in self.frames() {
            let row = &self.rows[r].label;
            if picture.dimensions() != frame {
                let ((found_width, found_height), (width, height)) = (picture.dimensions(), frame);
                let row = row.clone();
                return Err(ReportError::FrameSize { row, index, found_width, found_height, width, height });
            }
            if !time.is_finite() {
                let what = format!("the time of frame {index} of row `{row}`");
                return Err(ReportError::BadNumber { figure: FIGURE, what, value: time, wanted: "finite, in seconds" });
            }
        }
        let columns = self.rows.iter().map(|r| r.frames.len()).max().unwrap_or(0) as u64;
        let label = self.rows.iter().map(|r| text_width(&r.label, LABEL)).fold(0.0, f64::max).ceil() as u32;
        let left = MARGIN + label + if label > 0 { MARGIN } else { 0 };
        let width = u64::from(left) + columns * u64::from(frame.0 + GAP) - u64::from(GAP) + u64::from(MARGIN);
        let title = wrap(&self.title, TITLE, width as f64 - 2.0 * f64::from(MARGIN));
        let top = MARGIN + title.len() as u32 * TITLE_LINE;
        let height = u64::from(top) + self.rows.len() as u64 * u64::from(frame.1 + TIME_LINE + GAP) + u64::from(GAP);
        if width > u64::from(LIMIT) || height > u64::from(LIMIT) {
            return Err(ReportError::TooLarge { width, height, limit: LIMIT });
        }
        Ok(Layout { width: width as u32, height: height as u32, frame, left, top, title })
    }

    fn write_labels<B: DrawingBackend>(
        &self,
        layout: &Layout,
        area: &DrawingArea<B, plotters::coord::Shift>,
    ) -> Result<(), ReportError> {
        let write = |text: &str, size: f64, align: HPos, x: u32, y: u32| -> Result<(), ReportError> {
            let style = font(size, INK).pos(Pos::new(align, VPos::Center));
            let y = f64::from(y) + LOWER * size;
            Ok(area.draw_text(text, &style, (x as i32, y.round() as i32))?)
        };
        for (i, line) in layout.title.iter().enumerate() {
            let y = MARGIN / 2 + TITLE_LINE * i as u32 + TITLE_LINE / 2;
            write(line, TITLE, HPos::Left, MARGIN, y)?;
        }
        let (width, height) = layout.frame;
        for (r, row) in self.rows.iter().enumerate() {
            write(&row.label, LABEL, HPos::Left, MARGIN, layout.corner(r, 0).1 + height / 2)?;
        }
        for (r, c, time, _) in self.frames() {
            let (x, y) = layout.corner(r, c);
            let text = format!("t = {time:.2} s");
            let size = TIME.min(TIME * f64::from(width) / text_width(&text, TIME).max(1.0));
            write(&text, size, HPos::Center, x + width / 2, y + height + TIME_LINE / 2)?;
        }
        Ok(())
    }
}

impl Layout {
    /// Upper left corner of a frame.
    fn corner(&self, row: usize, column: usize) -> (u32, u32) {
        let (width, height) = self.frame;
        (self.left + column as u32 * (width + GAP), self.top + row as u32 * (height + TIME_LINE + GAP))
    }
}

/// Breaks a text at spaces into lines that fit. A word wider than a line stays whole.
fn wrap(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::{text_width, wrap};

    #[test]
    fn titles_break_at_spaces_and_keep_every_word() {
        let title = "clutch, push fp1 (0, -9.5, 0) N from 4.5 s to 5.5 s";
        let lines = wrap(title, 28.0, 200.0);
        assert!(lines.len() > 2, "{lines:?}");
        assert!(lines.iter().all(|l| text_width(l, 28.0) <= 200.0), "{lines:?}");
        assert_eq!(lines.join(" "), title);
        assert_eq!(wrap("", 28.0, 200.0).len(), 0);
    }
}
