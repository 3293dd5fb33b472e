//! Lines and discs drawn into a picture: what marks contacts and their friction cones.

use nalgebra::Vector3;

use super::arrow::connect;
use super::error::{Error, check_value};
use super::ffi;

/// A straight piece in the world: a line, or a cylinder, which is a disc where it is short.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Both ends, world frame \[m\].
    pub ends: [Vector3<f64>; 2],
    /// Radius of the cylinder \[m\]; `None`: a line, [`LINE_WIDTH`](Self::LINE_WIDTH) pixels wide.
    pub radius: Option<f64>,
    /// Red, green, blue and opacity, each from 0 to 1.
    pub rgba: [f32; 4],
}

impl Segment {
    /// Width of a line \[px\].
    pub const LINE_WIDTH: f64 = 2.0;

    /// A line between two points (world frame, m).
    pub fn line(from: Vector3<f64>, to: Vector3<f64>, rgba: [f32; 4]) -> Self {
        Self { ends: [from, to], radius: None, rgba }
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        for value in self.ends.iter().flat_map(Vector3::iter) {
            check_value("a coordinate of a segment", *value, "finite", |_| true)?;
        }
        check_value("a segment's radius", self.radius.unwrap_or(1.0), "positive", |r| r > 0.0)?;
        for channel in self.rgba {
            check_value("a colour of a segment", channel.into(), "between 0 and 1", |c| (0.0..=1.0).contains(&c))?;
        }
        Ok(())
    }

    /// Fills a geom of the scene. To be called under the guard.
    pub(super) fn write(&self, geom: &mut ffi::mjvGeom) {
        match self.radius {
            Some(radius) => connect(geom, ffi::mjGEOM_CYLINDER, radius, self.ends, &self.rgba),
            None => connect(geom, ffi::mjGEOM_LINE, Self::LINE_WIDTH, self.ends, &self.rgba),
        }
    }
}
