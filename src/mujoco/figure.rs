//! A plot drawn into a window (mjvFigure).

use std::alloc::{Layout, alloc_zeroed, handle_alloc_error};
use std::ffi::c_char;

use super::ffi;
use super::painter::c_text;

/// A plot of lines over a common axis.
pub struct Figure {
    raw: Box<ffi::mjvFigure>,
}

/// One line of a plot.
#[derive(Debug, Clone)]
pub struct Line<'a> {
    /// Its name in the legend.
    pub name: &'a str,
    /// Red, green and blue, each from 0 to 1.
    pub rgb: [f32; 3],
    /// x and y; of more than [`Figure::POINTS`] the last ones are drawn.
    pub points: &'a [[f32; 2]],
}

impl Figure {
    /// Most points of a line (mjMAXLINEPNT).
    pub const POINTS: usize = ffi::mjMAXLINEPNT as usize;
    /// Most lines (mjMAXLINE).
    pub const LINES: usize = ffi::mjMAXLINE as usize;

    /// An empty plot with a title and a name of its x axis.
    pub fn new(title: &str, x_axis: &str) -> Self {
        let layout = Layout::new::<ffi::mjvFigure>();
        // Of nearly a megabyte: it is not to come by way of the stack.
        // SAFETY: the layout is not empty; the structure is one of plain numbers, for which zeros are valid, and its memory
        // comes from the allocator that a box gives it back to. The call writes the engine's defaults and cannot fault.
        let mut raw = unsafe {
            let place = alloc_zeroed(layout).cast::<ffi::mjvFigure>();
            if place.is_null() {
                handle_alloc_error(layout);
            }
            let mut raw = Box::from_raw(place);
            ffi::mjv_defaultFigure(&mut *raw);
            raw
        };
        write(&mut raw.title, title);
        write(&mut raw.xlabel, x_axis);
        write(&mut raw.xformat, "%.1f");
        raw.flg_legend = 1;
        raw.flg_ticklabel = [1, 1];
        raw.flg_extend = 1;
        raw.gridsize = [5, 4];
        raw.figurergba = [0.1, 0.1, 0.1, 0.6];
        raw.panergba = [0.1, 0.1, 0.1, 0.4];
        raw.legendrgba = [0.1, 0.1, 0.1, 0.3];
        Self { raw }
    }

    /// What is drawn from now on: lines (the first [`LINES`](Self::LINES)), the range of x, and what y reaches at least
    /// beside zero.
    pub fn set(&mut self, lines: &[Line<'_>], x: [f32; 2], y_at_least: f32) {
        let raw = &mut *self.raw;
        raw.linepnt = [0; Self::LINES];
        for (i, line) in lines.iter().take(Self::LINES).enumerate() {
            write(&mut raw.linename[i], line.name);
            raw.linergb[i] = line.rgb;
            let shown = &line.points[line.points.len().saturating_sub(Self::POINTS)..];
            raw.linepnt[i] = shown.len() as i32;
            for (place, value) in raw.linedata[i].iter_mut().zip(shown.iter().flatten()) {
                *place = *value;
            }
        }
        raw.range = [x, [0.0, y_at_least]];
    }

    pub(super) fn raw_mut(&mut self) -> &mut ffi::mjvFigure {
        &mut self.raw
    }
}

/// Writes a text into an array of the engine's.
fn write(place: &mut [c_char], text: &str) {
    let text = c_text(text, place.len());
    for (to, from) in place.iter_mut().zip(text.as_bytes_with_nul()) {
        *to = *from as c_char;
    }
}
