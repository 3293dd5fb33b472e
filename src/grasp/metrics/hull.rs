//! Convex hulls in wrench space: the Ferrari-Canny ball and the hull's volume.
//!
//! Quickhull (Barber, Dobkin, Huhdanpaa 1996) in six dimensions. The points are first whitened (an affine map keeps
//! facets facets), so that a wrench space that is thin along torsion is as well conditioned as any. Symmetric grasps
//! have many cohedral points: points within a tolerance of a facet count as inside, the finished hull is verified
//! (every point below every facet), and if rounding broke it the points are jogged, by a fixed sequence, a little more
//! in each of a few retries.

use nalgebra::{Matrix6, Vector6};
use thiserror::Error;

use crate::grasp::metrics::quickhull::{Broken, D, Facet, MAX_FACETS, Quickhull};

/// Points whose extent along some axis is below this fraction of the largest span no volume.
const FLAT: f64 = 1e-7;
/// Relative size of the jog in each attempt.
const JOGS: [f64; 4] = [0.0, 1e-8, 1e-7, 1e-6];
/// A hull that could not be formed.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum HullError {
    /// A coordinate that is NaN or infinite.
    #[error("point {point} of the hull has a coordinate that is not finite")]
    NotFinite {
        /// Its place in the list, from 0.
        point: usize,
    },
    /// Rounding defeated every attempt.
    #[error("the hull of {points} points did not close, even with its points jogged by 1e-6 of their spread")]
    NotClosed {
        /// Number of points.
        points: usize,
    },
    /// Too many facets.
    #[error("the hull of {points} points takes more than {limit} facets to form; give fewer points")]
    TooComplex {
        /// Number of points.
        points: usize,
        /// The most there may be.
        limit: usize,
    },
}

/// A facet's plane `normal . x = offset`, its unit normal pointing out of the hull.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacetPlane {
    /// Unit normal, out of the hull.
    pub normal: Vector6<f64>,
    /// Distance of the plane from the origin along the normal.
    pub offset: f64,
}

/// The convex hull of points in six dimensions.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexHull {
    facets: Vec<FacetPlane>,
    volume: f64,
}

impl ConvexHull {
    /// The hull of `points`. Fewer than seven, or points in a common hyperplane, give a flat hull: no facets, volume 0.
    ///
    /// # Errors
    /// A point that is not finite, more than two million facets formed on the way, or a hull that rounding kept from closing.
    pub fn new(points: &[Vector6<f64>]) -> Result<Self, HullError> {
        if let Some(point) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(HullError::NotFinite { point });
        }
        let flat = ConvexHull { facets: Vec::new(), volume: 0.0 };
        let Some(frame) = Whitening::new(points) else {
            return Ok(flat);
        };
        for jog in JOGS {
            let mut noise = Noise::new();
            let round: Vec<Vector6<f64>> = points.iter().map(|p| frame.map(p) + noise.vector() * jog).collect();
            match Quickhull::build(&round) {
                Ok(hull) if hull.contains_all(1e-9 + 10.0 * jog) => {
                    return Ok(ConvexHull {
                        facets: hull.live().map(|f| frame.unmap(f)).collect(),
                        volume: hull.volume() * frame.determinant,
                    });
                }
                Ok(_) | Err(Broken::Rounding) => {}
                Err(Broken::TooComplex) => {
                    return Err(HullError::TooComplex { points: points.len(), limit: MAX_FACETS });
                }
            }
        }
        Err(HullError::NotClosed { points: points.len() })
    }

    /// Planes of the facets; a facet with more than six vertices appears once per simplex of its triangulation.
    pub fn facets(&self) -> &[FacetPlane] {
        &self.facets
    }

    /// Six-dimensional volume, in the points' unit to the sixth power.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Radius of the largest ball about the origin within the hull: Ferrari and Canny's epsilon. 0 where the origin is
    /// outside or on the hull, and for a flat hull.
    pub fn inner_radius(&self) -> f64 {
        self.facets.iter().map(|f| f.offset).reduce(f64::min).map_or(0.0, |least| least.max(0.0))
    }
}

/// The affine map to coordinates of zero mean and unit covariance: `x = mean + factor * y`.
struct Whitening {
    mean: Vector6<f64>,
    inverse: Matrix6<f64>,
    determinant: f64,
}

impl Whitening {
    /// None where the points are flat.
    fn new(points: &[Vector6<f64>]) -> Option<Self> {
        if points.len() <= D {
            return None;
        }
        let count = points.len() as f64;
        let mean = points.iter().sum::<Vector6<f64>>() / count;
        // The triangular factor of the centred points (Householder), not the root of their covariance, whose rounding
        // would hide a spread below 1e-8 of the largest.
        let centred = nalgebra::OMatrix::<f64, nalgebra::Dyn, nalgebra::U6>::from_fn(points.len(), |i, j| {
            (points[i][j] - mean[j]) / count.sqrt()
        });
        let factor = centred.qr().r();
        let factor: Matrix6<f64> = factor.fixed_view::<D, D>(0, 0).transpose();
        let spread = factor.singular_values();
        if spread.max() <= 0.0 || spread.min() <= FLAT * spread.max() {
            return None;
        }
        Some(Whitening { mean, inverse: factor.try_inverse()?, determinant: factor.determinant().abs() })
    }

    fn map(&self, point: &Vector6<f64>) -> Vector6<f64> {
        self.inverse * (point - self.mean)
    }

    fn unmap(&self, facet: &Facet) -> FacetPlane {
        let normal = self.inverse.tr_mul(&facet.normal);
        let length = normal.norm();
        FacetPlane { normal: normal / length, offset: (facet.offset + normal.dot(&self.mean)) / length }
    }
}

/// Uniform numbers in \[-1, 1) from a fixed seed (splitmix64): the same input always gives the same hull.
struct Noise(u64);

impl Noise {
    fn new() -> Self {
        Noise(0x9e37_79b9_7f4a_7c15)
    }

    fn vector(&mut self) -> Vector6<f64> {
        Vector6::from_fn(|_, _| {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
    }
}
