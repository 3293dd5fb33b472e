//! Text, lines and areas on an image.

use std::sync::Once;

use image::RgbImage;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};

pub const INK: RGBColor = RGBColor(30, 30, 30);
pub const GREY: RGBColor = RGBColor(150, 150, 150);
pub const PALE: RGBColor = RGBColor(225, 225, 225);
/// Distinct for the colour-blind (Okabe and Ito 2008), and in grey by their lightness.
pub const BLUE: RGBColor = RGBColor(0, 100, 160);
pub const SKY: RGBColor = RGBColor(140, 200, 240);
pub const ORANGE: RGBColor = RGBColor(230, 140, 0);

pub struct Paper {
    pub image: RgbImage,
}

impl Paper {
    pub fn white(width: u32, height: u32) -> Self {
        static FONT: Once = Once::new();
        FONT.call_once(|| drop(register_font("sans-serif", FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)));
        Self { image: RgbImage::from_pixel(width, height, image::Rgb([255; 3])) }
    }

    fn draw(&mut self, draw: impl FnOnce(&DrawingArea<BitMapBackend<'_>, plotters::coord::Shift>)) {
        let size = self.image.dimensions();
        let area = BitMapBackend::with_buffer(&mut self.image, size).into_drawing_area();
        draw(&area);
    }

    /// Pastes a picture.
    pub fn picture(&mut self, picture: &RgbImage, x: i32, y: i32) {
        image::imageops::replace(&mut self.image, picture, x.into(), y.into());
    }

    /// Text with its left, middle or right at `x` and its middle at `y`.
    pub fn text(&mut self, text: &str, (x, y): (i32, i32), size: f64, color: RGBColor, align: HPos) {
        let style = TextStyle::from(("sans-serif", size).into_font()).color(&color).pos(Pos::new(align, VPos::Center));
        // Drawn twice, a third of a pixel's worth bolder: the font is a light one. Set too high by an eighth of its size.
        self.draw(|area| {
            for _ in 0..2 {
                let _ = area.draw_text(text, &style, (x, y + (0.12 * size) as i32));
            }
        });
    }

    pub fn area(&mut self, a: (i32, i32), b: (i32, i32), color: RGBColor) {
        self.draw(|area| drop(area.draw(&Rectangle::new([a, b], color.filled()))));
    }

    pub fn line(&mut self, a: (i32, i32), b: (i32, i32), width: u32, color: RGBColor) {
        self.draw(|area| drop(area.draw(&PathElement::new(vec![a, b], color.stroke_width(width)))));
    }
}
