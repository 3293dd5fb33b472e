//! A certified lower bound of the distance between two convex shapes: Gilbert, Johnson and Keerthi (1988), of which
//! only the separating planes are believed.

use super::shape::{Pose, Shape};
use nalgebra::Vector3;

const ITERATIONS: usize = 32;
/// A bound is good enough at this fraction of the true clearance.
const ACCURACY: f64 = 0.9;

/// How far beyond `margin` two shapes are apart, m: a lower bound, good to a tenth, and not positive if they may be
/// closer than the margin.
///
/// Any direction `v` separates the shapes by `min v.(a - b) / |v|` over their points, which the supports give exactly:
/// the bound holds wherever the search for a good `v` goes. Of two half-spaces nothing is known: minus infinity.
pub(super) fn clearance(a: (&Shape, &Pose), b: (&Shape, &Pose), margin: f64) -> f64 {
    let thickness = a.0.rounding + b.0.rounding + margin;
    let normals = [a.0.half_space_normal(a.1), b.0.half_space_normal(b.1)];
    match normals {
        [None, None] => convex(a, b, thickness),
        [Some(normal), None] => height(&normal, a.1, b) - thickness,
        [None, Some(normal)] => height(&normal, b.1, a) - thickness,
        [Some(_), Some(_)] => f64::NEG_INFINITY,
    }
}

/// Height of a core above a plane.
fn height(normal: &Vector3<f64>, plane: &Pose, (shape, pose): (&Shape, &Pose)) -> f64 {
    normal.dot(&(shape.support(pose, &-normal) - plane.position))
}

/// Distance of two cores beyond `thickness`.
fn convex(a: (&Shape, &Pose), b: (&Shape, &Pose), thickness: f64) -> f64 {
    let mut v = a.1.position - b.1.position;
    let mut simplex = Simplex::default();
    let mut bound = f64::NEG_INFINITY;
    for _ in 0..ITERATIONS {
        let length = v.norm();
        if length.is_nan() || length < f64::MIN_POSITIVE {
            break;
        }
        let nearest = a.0.support(a.1, &-v) - b.0.support(b.1, &v);
        bound = bound.max(v.dot(&nearest) / length - thickness);
        // From the first point on, `v` is a point of the difference, so it is not shorter than the distance.
        let most = length - thickness;
        if simplex.count > 0 && (bound >= ACCURACY * most || most <= 0.0) {
            break;
        }
        v = simplex.add(nearest);
    }
    bound
}

/// Up to four points of the difference of two shapes, of which no fewer span the point nearest to the origin.
#[derive(Default)]
struct Simplex {
    points: [Vector3<f64>; 4],
    count: usize,
}

impl Simplex {
    /// Adds a point; returns the hull's point nearest to the origin, and keeps the points that span it.
    fn add(&mut self, point: Vector3<f64>) -> Vector3<f64> {
        if self.count == 4 {
            // The origin was inside.
            return Vector3::zeros();
        }
        self.points[self.count] = point;
        self.count += 1;
        let [p, q, r, s] = self.points;
        let nearest = match self.count {
            1 => Nearest::new(p, &[p]),
            2 => on_segment(p, q),
            3 => on_triangle(p, q, r),
            _ => on_tetrahedron(p, q, r, s),
        };
        (self.points, self.count) = (nearest.points, nearest.count);
        nearest.at
    }
}

/// The point nearest to the origin, and the corners that span it.
struct Nearest {
    at: Vector3<f64>,
    points: [Vector3<f64>; 4],
    count: usize,
}

impl Nearest {
    fn new(at: Vector3<f64>, corners: &[Vector3<f64>]) -> Self {
        let mut points = [Vector3::zeros(); 4];
        points[..corners.len()].copy_from_slice(corners);
        Self { at, points, count: corners.len() }
    }
}

fn on_segment(p: Vector3<f64>, q: Vector3<f64>) -> Nearest {
    let edge = q - p;
    let (along, square) = (-p.dot(&edge), edge.norm_squared());
    if along <= 0.0 {
        Nearest::new(p, &[p])
    } else if along >= square {
        Nearest::new(q, &[q])
    } else {
        Nearest::new(p + edge * (along / square), &[p, q])
    }
}

fn on_triangle(p: Vector3<f64>, q: Vector3<f64>, r: Vector3<f64>) -> Nearest {
    let normal = (q - p).cross(&(r - p));
    // The origin is beyond an edge if it is on the outer side of the edge's own plane along the normal.
    let beyond = |a: &Vector3<f64>, b: &Vector3<f64>| (b - a).cross(&normal).dot(a) <= 0.0;
    let edges = [(p, q), (q, r), (r, p)];
    if let Some(nearest) = nearest_of(edges.iter().filter(|(a, b)| beyond(a, b)).map(|&(a, b)| on_segment(a, b))) {
        return nearest;
    }
    Nearest::new(normal * (normal.dot(&p) / normal.norm_squared()), &[p, q, r])
}

fn on_tetrahedron(p: Vector3<f64>, q: Vector3<f64>, r: Vector3<f64>, s: Vector3<f64>) -> Nearest {
    let faces = [[p, q, r, s], [p, q, s, r], [p, r, s, q], [q, r, s, p]];
    // The origin is beyond a face if it is not on the side of the fourth corner.
    let beyond = |[a, b, c, opposite]: &[Vector3<f64>; 4]| {
        let normal = (b - a).cross(&(c - a));
        -normal.dot(a) * normal.dot(&(opposite - a)) <= 0.0
    };
    nearest_of(faces.iter().filter(|face| beyond(face)).map(|&[a, b, c, _]| on_triangle(a, b, c)))
        .unwrap_or_else(|| Nearest::new(Vector3::zeros(), &[p, q, r, s]))
}

fn nearest_of(candidates: impl Iterator<Item = Nearest>) -> Option<Nearest> {
    candidates.min_by(|a, b| a.at.norm_squared().total_cmp(&b.at.norm_squared()))
}
