//! Arrows drawn into a picture: forces that the engine does not draw itself.

use nalgebra::Vector3;

use super::compat;
use super::error::{Error, check_value};
use super::ffi;

/// An arrow in the world: a push, or the force of a contact that is not in the engine's solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrow {
    /// Where it starts, world frame \[m\].
    pub from: Vector3<f64>,
    /// From its start to its tip, world axes \[m\]. One shorter than a micrometre is not drawn.
    pub vector: Vector3<f64>,
    /// Radius of its shaft \[m\].
    pub width: f64,
    /// Red, green, blue and opacity, each from 0 to 1.
    pub rgba: [f32; 4],
}

const SHORTEST: f64 = 1e-6;

impl Arrow {
    /// A force \[N\] that pulls away from a point (world frame, m), drawn with `scale` metres per newton.
    pub fn from_point(point: Vector3<f64>, force: Vector3<f64>, scale: f64, rgba: [f32; 4]) -> Self {
        Self { from: point, vector: scale * force, width: 0.003, rgba }
    }

    /// The same with its tip at the point: a force that presses on what is there.
    pub fn to_point(point: Vector3<f64>, force: Vector3<f64>, scale: f64, rgba: [f32; 4]) -> Self {
        Self { from: point - scale * force, ..Self::from_point(point, force, scale, rgba) }
    }

    /// The same with another radius of the shaft \[m\].
    pub fn with_width(self, width: f64) -> Self {
        Self { width, ..self }
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        for value in self.from.iter().chain(self.vector.iter()) {
            check_value("a coordinate of an arrow", *value, "finite", |_| true)?;
        }
        check_value("an arrow's width", self.width, "positive", |w| w > 0.0)?;
        for channel in self.rgba {
            check_value("a colour of an arrow", channel.into(), "between 0 and 1", |c| (0.0..=1.0).contains(&c))?;
        }
        Ok(())
    }

    pub(super) fn is_drawn(&self) -> bool {
        self.vector.norm() >= SHORTEST
    }

    /// Fills a geom of the scene. To be called under the guard.
    pub(super) fn write(&self, geom: &mut ffi::mjvGeom) {
        // The renderer draws an arrow half as long as its geom says.
        connect(geom, ffi::mjGEOM_ARROW, self.width, [self.from, self.from + 2.0 * self.vector], &self.rgba);
    }
}

/// Makes a geom of the scene reach from one point to another. To be called under the guard.
pub(super) fn connect(geom: &mut ffi::mjvGeom, kind: u32, width: f64, ends: [Vector3<f64>; 2], rgba: &[f32; 4]) {
    let (none, kind, [from, to]) = (std::ptr::null(), kind as i32, ends);
    // SAFETY: the geom is exclusive; null stands for the engine's defaults; the colour has four numbers.
    unsafe {
        ffi::mjv_initGeom(geom, kind, none, none, none, rgba.as_ptr());
        compat::connect(geom, kind, width, from, to);
    }
    geom.category = ffi::mjCAT_DECOR as i32;
    geom.objtype = ffi::mjOBJ_UNKNOWN as i32;
    geom.objid = -1;
    geom.segid = -1;
    // Forces are to be read, not lit.
    geom.emission = 0.5;
}
