//! Quickhull (Barber, Dobkin, Huhdanpaa 1996) in six dimensions, for points of about unit spread.

use nalgebra::Vector6;

/// Dimensions of a wrench.
pub(super) const D: usize = 6;

/// Forming more facets than this (a few hundred megabytes) is not worth their memory.
pub(super) const MAX_FACETS: usize = 2_000_000;
/// A point less than this above a facet is on it.
const ABOVE: f64 = 1e-11;

/// Why an attempt failed.
pub(super) enum Broken {
    Rounding,
    TooComplex,
}

/// A simplicial facet.
pub(super) struct Facet {
    vertices: [u32; D],
    /// `coupled[k]` shares all vertices but `vertices[k]`.
    coupled: [u32; D],
    pub(super) normal: Vector6<f64>,
    pub(super) offset: f64,
    /// Five times four times ... its 5-volume.
    parallelotope: f64,
    /// Points above it that no earlier facet claimed, and the height of the highest, which is the last.
    outside: Vec<u32>,
    height: f64,
    alive: bool,
}

/// The hull under construction.
pub(super) struct Quickhull<'a> {
    points: &'a [Vector6<f64>],
    facets: Vec<Facet>,
    inside: Vector6<f64>,
}

impl<'a> Quickhull<'a> {
    pub(super) fn build(points: &'a [Vector6<f64>]) -> Result<Self, Broken> {
        let corners = first_simplex(points).ok_or(Broken::Rounding)?;
        let inside = corners.iter().map(|&i| points[i as usize]).sum::<Vector6<f64>>() / (D + 1) as f64;
        let mut hull = Quickhull { points, facets: Vec::new(), inside };
        for left_out in 0..=D {
            // Facet k lacks corner k; across the ridge without corner j lies facet j.
            let mut others = (0..=D).filter(|&k| k != left_out);
            let slots: [usize; D] = std::array::from_fn(|_| others.next().unwrap_or(0));
            let facet = hull.facet(slots.map(|k| corners[k]))?;
            hull.facets.push(Facet { coupled: slots.map(|k| k as u32), ..facet });
        }
        let rest: Vec<u32> = (0..points.len() as u32).filter(|i| !corners.contains(i)).collect();
        hull.share_out(&rest, 0);
        let mut open: Vec<u32> = (0..=D as u32).collect();
        while let Some(at) = open.pop() {
            let facet = &mut hull.facets[at as usize];
            if !facet.alive {
                continue;
            }
            let Some(apex) = facet.outside.pop() else {
                continue;
            };
            let first = hull.facets.len() as u32;
            hull.raise(at, apex)?;
            open.extend(first..hull.facets.len() as u32);
        }
        Ok(hull)
    }

    /// Replaces all facets that `apex` sees by the cone from `apex` over their horizon.
    fn raise(&mut self, start: u32, apex: u32) -> Result<(), Broken> {
        let tip = self.points[apex as usize];
        let mut visible = vec![start];
        self.facets[start as usize].alive = false;
        let mut horizon = Vec::new();
        let mut next = 0;
        while next < visible.len() {
            let at = visible[next];
            next += 1;
            for slot in 0..D {
                let constraint = self.facets[at as usize].coupled[slot];
                let other = &mut self.facets[constraint as usize];
                if !other.alive {
                    continue;
                }
                if other.normal.dot(&tip) - other.offset > ABOVE {
                    other.alive = false;
                    visible.push(constraint);
                } else {
                    horizon.push((at, slot, constraint));
                }
            }
        }
        let first = self.facets.len();
        if first + horizon.len() > MAX_FACETS {
            return Err(Broken::TooComplex);
        }
        // Ridges that contain the apex, keyed by their other four vertices: each must join exactly two new facets.
        let mut ridges: Vec<([u32; D - 2], u32, u8)> = Vec::with_capacity(horizon.len() * (D - 1));
        for (at, slot, constraint) in horizon {
            let new = self.facets.len() as u32;
            let mut vertices = self.facets[at as usize].vertices;
            vertices[slot] = apex;
            let mut facet = self.facet(vertices)?;
            facet.coupled[slot] = constraint;
            let back = &mut self.facets[constraint as usize].coupled;
            let door = back.iter().position(|&n| n == at).ok_or(Broken::Rounding)?;
            back[door] = new;
            for lacking in (0..D).filter(|&k| k != slot) {
                let mut rest = (0..D).filter(|&k| k != slot && k != lacking);
                let mut key: [u32; D - 2] = std::array::from_fn(|_| rest.next().map_or(0, |k| vertices[k]));
                key.sort_unstable();
                ridges.push((key, new, lacking as u8));
            }
            self.facets.push(facet);
        }
        ridges.sort_unstable();
        for group in ridges.chunk_by(|a, b| a.0 == b.0) {
            let &[(_, a, i), (_, b, j)] = group else {
                return Err(Broken::Rounding);
            };
            self.facets[a as usize].coupled[i as usize] = b;
            self.facets[b as usize].coupled[j as usize] = a;
        }
        let mut orphans = Vec::new();
        for at in visible {
            orphans.append(&mut self.facets[at as usize].outside);
        }
        self.share_out(&orphans, first);
        Ok(())
    }

    /// Gives each point to the first facet from `first` on that it is above; points above none are inside the hull.
    fn share_out(&mut self, points: &[u32], first: usize) {
        for &i in points {
            let point = &self.points[i as usize];
            for facet in &mut self.facets[first..] {
                let height = facet.normal.dot(point) - facet.offset;
                if height > ABOVE {
                    facet.outside.push(i);
                    if height > facet.height {
                        facet.height = height;
                    } else {
                        let last = facet.outside.len() - 1;
                        facet.outside.swap(last, last - 1);
                    }
                    break;
                }
            }
        }
    }

    /// The facet through six vertices, facing away from the inside.
    fn facet(&self, vertices: [u32; D]) -> Result<Facet, Broken> {
        let corner = |k: usize| &self.points[vertices[k] as usize];
        let mut edges: [Vector6<f64>; D - 1] = std::array::from_fn(|k| corner(k + 1) - corner(0));
        // Gram-Schmidt, the longest remainder first and each projection twice, then what is left of the way out.
        let mut parallelotope = 1.0;
        for k in 0..D - 1 {
            let mut longest = k;
            for j in k + 1..D - 1 {
                if edges[j].norm_squared() > edges[longest].norm_squared() {
                    longest = j;
                }
            }
            edges.swap(k, longest);
            for j in 0..k {
                let along = edges[j] * edges[j].dot(&edges[k]);
                edges[k] -= along;
            }
            let length = edges[k].norm();
            if length < 1e-13 {
                return Err(Broken::Rounding);
            }
            parallelotope *= length;
            edges[k] /= length;
            for j in k + 1..D - 1 {
                let along = edges[k] * edges[k].dot(&edges[j]);
                edges[j] -= along;
            }
        }
        let mut normal = corner(0) - self.inside;
        for _ in 0..2 {
            for edge in &edges {
                normal -= edge * edge.dot(&normal);
            }
        }
        let length = normal.norm();
        if length < 1e-9 {
            return Err(Broken::Rounding);
        }
        normal /= length;
        Ok(Facet {
            vertices,
            coupled: [0; D],
            normal,
            offset: normal.dot(corner(0)),
            parallelotope,
            outside: Vec::new(),
            height: 0.0,
            alive: true,
        })
    }

    pub(super) fn live(&self) -> impl Iterator<Item = &Facet> {
        self.facets.iter().filter(|f| f.alive)
    }

    /// No point lies more than `tolerance` above a facet: all facets support the hull, and as they close, are the hull.
    pub(super) fn contains_all(&self, tolerance: f64) -> bool {
        self.live().all(|f| self.points.iter().all(|p| f.normal.dot(p) - f.offset <= tolerance))
    }

    /// Sum of the simplices from the inside to each facet.
    pub(super) fn volume(&self) -> f64 {
        let factorial = 720.0;
        self.live().map(|f| (f.offset - f.normal.dot(&self.inside)) * f.parallelotope).sum::<f64>() / factorial
    }
}

/// Seven points far apart: two extremes, then always the one farthest from the span of those chosen.
fn first_simplex(points: &[Vector6<f64>]) -> Option<[u32; D + 1]> {
    let mut left: Vec<Vector6<f64>> = points.to_vec();
    let farthest = |left: &[Vector6<f64>]| {
        (0..left.len()).max_by(|&a, &b| left[a].norm_squared().total_cmp(&left[b].norm_squared()))
    };
    let first = farthest(&left)?;
    let mut corners = [first as u32; D + 1];
    let origin = left[first];
    left.iter_mut().for_each(|p| *p -= origin);
    for corner in &mut corners[1..] {
        let at = farthest(&left)?;
        let axis = left[at].try_normalize(1e-9)?;
        *corner = at as u32;
        for p in &mut left {
            let along = axis * axis.dot(p);
            *p -= along;
        }
    }
    Some(corners)
}
