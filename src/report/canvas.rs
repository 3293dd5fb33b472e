//! A drawing area with a scale and the program's own font, and saving as SVG or PNG.

use std::io::{Cursor, Write};
use std::path::Path;
use std::sync::OnceLock;

use image::RgbImage;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};

use super::ReportError;
use crate::whole_file::write_whole;

/// Pixels of a PNG for each unit of an SVG: figures are drawn at twice their nominal size, to stay sharp when enlarged.
const PNG_SCALE: u32 = 2;
/// The bitmap backend sets text too high by this part of its size.
pub(crate) const LOWER: f64 = 0.12;
/// Also what an SVG names: a viewer takes its own sans-serif there, the embedded font only measures.
const FAMILY: &str = "sans-serif";

/// Colours that stay distinct for colour-blind readers (Okabe and Ito 2008).
pub(crate) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(crate) const SKY: RGBColor = RGBColor(126, 192, 238);
pub(crate) const VERMILION: RGBColor = RGBColor(205, 70, 0);
pub(crate) const GREEN: RGBColor = RGBColor(0, 140, 100);
pub(crate) const PURPLE: RGBColor = RGBColor(170, 70, 140);
pub(crate) const ORANGE: RGBColor = RGBColor(230, 159, 0);
pub(crate) const GREY: RGBColor = RGBColor(110, 110, 110);
pub(crate) const INK: RGBColor = RGBColor(30, 30, 30);

/// Text centred on its point.
pub(crate) const MIDDLE: Pos = Pos { h_pos: HPos::Center, v_pos: VPos::Center };

/// A drawing area and the factor from nominal units to its pixels.
pub(crate) struct Canvas<B: DrawingBackend> {
    pub area: DrawingArea<B, Shift>,
    pub scale: f64,
    /// A bitmap, not an SVG.
    raster: bool,
}

impl<B: DrawingBackend> Canvas<B> {
    fn svg(area: DrawingArea<B, Shift>) -> Self {
        Self { area, scale: 1.0, raster: false }
    }

    fn png(area: DrawingArea<B, Shift>) -> Self {
        Self { area, scale: f64::from(PNG_SCALE), raster: true }
    }

    /// The same scale on a part of the area.
    pub fn part(&self, area: DrawingArea<B, Shift>) -> Self {
        Self { area, ..*self }
    }

    /// Nominal units to pixels.
    pub fn px(&self, units: f64) -> i32 {
        (units * self.scale).round() as i32
    }

    /// Width and height in nominal units.
    pub fn size(&self) -> (f64, f64) {
        let (width, height) = self.area.dim_in_pixel();
        (f64::from(width) / self.scale, f64::from(height) / self.scale)
    }

    /// A font of `size` nominal units.
    pub fn font(&self, size: f64, color: RGBColor) -> TextStyle<'static> {
        font(size * self.scale, color)
    }

    /// A filled rectangle between two corners, in nominal units.
    pub fn rectangle(&self, a: (f64, f64), b: (f64, f64), color: RGBColor) -> Result<(), ReportError> {
        let corner = |p: (f64, f64)| (self.px(p.0), self.px(p.1));
        Ok(self.area.draw(&Rectangle::new([corner(a), corner(b)], color.filled()))?)
    }

    /// Text with its left (centre, right) edge at `x` and its middle at `y`, in nominal units.
    pub fn text(&self, text: &str, at: (f64, f64), size: f64, color: RGBColor, align: HPos) -> Result<(), ReportError> {
        let style = self.font(size, color).pos(Pos::new(align, VPos::Center));
        let y = at.1 + if self.raster { LOWER * size } else { 0.0 };
        Ok(self.area.draw_text(text, &style, (self.px(at.0), self.px(y)))?)
    }
}

/// A font of `size` pixels, from the program itself.
pub(crate) fn font(size: f64, color: RGBColor) -> TextStyle<'static> {
    static REGISTERED: OnceLock<()> = OnceLock::new();
    // A failure here (impossible with the embedded bytes) comes back as a drawing error at the first text.
    REGISTERED.get_or_init(|| drop(register_font(FAMILY, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)));
    TextStyle { color: color.to_backend_color(), ..TextStyle::from((FAMILY, size).into_font()) }
}

/// Width of a text in the same units as the font's `size`.
pub(crate) fn text_width(text: &str, size: f64) -> f64 {
    // Measured large and scaled down: the layout box is in whole pixels.
    const LARGE: f64 = 200.0;
    let layout = font(LARGE, INK).font.layout_box(text);
    layout.map_or(0.0, |((left, _), (right, _))| f64::from(right - left)) * size / LARGE
}

/// A figure that can be drawn on any backend.
pub(crate) trait Figure {
    /// Checks the input before anything is drawn.
    fn check(&self) -> Result<(), ReportError>;
    /// Nominal width and height.
    fn size(&self) -> (u32, u32);
    fn draw<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> Result<(), ReportError>;

    fn to_svg(&self) -> Result<String, ReportError> {
        self.check()?;
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, self.size()).into_drawing_area();
            area.fill(&WHITE)?;
            self.draw(&Canvas::svg(area.clone()))?;
            area.present()?;
        }
        Ok(svg)
    }

    fn to_image(&self) -> Result<RgbImage, ReportError> {
        self.check()?;
        let (width, height) = self.size();
        let mut image = RgbImage::new(width * PNG_SCALE, height * PNG_SCALE);
        draw_on(&mut image, |area| {
            area.fill(&WHITE)?;
            self.draw(&Canvas::png(area))
        })?;
        Ok(image)
    }

    /// Saves as the file name's ending says.
    fn save_as(&self, path: &Path) -> Result<(), ReportError> {
        match extension(path).as_str() {
            "svg" => {
                let svg = self.to_svg()?;
                write_whole(path, |file| file.write_all(svg.as_bytes()))
                    .map_err(|source| ReportError::Write { path: path.to_owned(), source })
            }
            "png" => save_png(&self.to_image()?, path),
            _ => Err(ReportError::Format { path: path.to_owned(), wanted: ".svg or .png" }),
        }
    }
}

/// Draws on an image in place.
pub(crate) fn draw_on<F>(image: &mut RgbImage, draw: F) -> Result<(), ReportError>
where
    F: for<'a> FnOnce(DrawingArea<BitMapBackend<'a>, Shift>) -> Result<(), ReportError>,
{
    let size = image.dimensions();
    let area = BitMapBackend::with_buffer(image, size).into_drawing_area();
    draw(area.clone())?;
    Ok(area.present()?)
}

pub(crate) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

pub(crate) fn save_png(image: &RgbImage, path: &Path) -> Result<(), ReportError> {
    let mut png = Vec::new();
    image
        .write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png)
        .map_err(|source| ReportError::Encode { path: path.to_owned(), source })?;
    write_whole(path, |file| file.write_all(&png))
        .map_err(|source| ReportError::Write { path: path.to_owned(), source })
}
