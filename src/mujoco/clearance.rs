//! Steps in which collision detection would find nothing, known from how little has moved since distances were measured.

use super::collider::PairCollider;
use super::error::{Error, check_length};
use super::pairs::detects;
use super::proximity::{Proximity, WORLD};
use super::simulation::Simulation;
use nalgebra::{Matrix3, Vector3};

/// Calls for which the answer stays "no" after something was found near.
const BACK_OFF: u32 = 20;

/// Certifies that no contact exists but those of a [`PairCollider`], so that [`Simulation::collision`] can be left out.
///
/// At a check, lower bounds of the distances of all other geom pairs are computed. No contact can appear while the
/// bodies have moved less than that: a point of a body within `r` of its centre of mass `x` has moved by no more than
/// `|x - x0| + 2 |q - q0| r`, as a rotation by an angle `a` moves it by `2 sin(a/2) r`, and the quaternions differ by
/// `2 sin(a/4)`. Body pairs that are far from each other share one clearance, and are checked again together; each of
/// the others has its own, for the motion of one body seen from the other, and is checked again by itself.
///
/// "Yes" is certain (the engine's own tolerances are allowed for); "no" means that something may touch, or was near
/// less than 20 calls ago.
#[derive(Debug, Clone)]
pub struct Clearance {
    proximity: Proximity,
    /// Where the moving parts were at the last check of everything, and how far each has moved since.
    placed: Vec<Placed>,
    moved: Vec<f64>,
    /// Clearance of all body pairs but the near ones at that check, m.
    far: f64,
    near: Vec<Near>,
    /// The group that did not pass last time.
    blocked: Option<usize>,
    /// Calls to answer with "no".
    rest: u32,
    ngeom: usize,
}

/// A body: its centre of mass and its orientation.
#[derive(Debug, Clone, Copy)]
struct Placed {
    position: Vector3<f64>,
    quaternion: [f64; 4],
}

/// A body pair with a small clearance.
#[derive(Debug, Clone)]
struct Near {
    group: usize,
    /// At the last check of everything, m.
    at_check: f64,
    /// When `relative` was the pose of the second part in the frame of the first, m.
    clearance: f64,
    relative: Placed,
}

impl Clearance {
    /// For all geom pairs that collision detection tests, but those of `collider`, which must be of the same model.
    pub fn new(sim: &Simulation, collider: &PairCollider) -> Self {
        let proximity = Proximity::new(sim, &collider.pairs);
        let parts = proximity.parts.len();
        Self {
            proximity,
            placed: vec![Placed::default(); parts],
            moved: vec![0.0; parts],
            far: f64::NEG_INFINITY,
            near: Vec::new(),
            blocked: None,
            rest: 0,
            ngeom: sim.model().ngeom(),
        }
    }

    /// Whether [`Simulation::collision`] would find no contact but the collider's, at the present poses (see
    /// [`Simulation::kinematics`]). `sim` must be a simulation of the model that this was made for, in any state.
    ///
    /// Fails if the model has another number of geoms.
    pub fn certifies(&mut self, sim: &Simulation) -> Result<bool, Error> {
        check_length("the model's list of geoms", self.ngeom, sim.model().ngeom())?;
        if !detects(sim) {
            return Ok(true);
        }
        if self.rest > 0 {
            self.rest -= 1;
            return Ok(false);
        }
        if let Some(group) = self.blocked {
            if !(self.proximity.clearance(sim, group) > 0.0) {
                return Ok(self.back_off(group));
            }
            self.blocked = None;
            self.check(sim);
        } else if !(self.far > self.measure(sim)) {
            self.check(sim);
        }
        for i in 0..self.near.len() {
            if !self.passes(sim, i) {
                return Ok(self.back_off(self.near[i].group));
            }
        }
        Ok(true)
    }

    fn back_off(&mut self, group: usize) -> bool {
        self.blocked = Some(group);
        self.rest = BACK_OFF;
        false
    }

    /// How far any two parts have come closer since the check at most; not a number if a pose is not.
    fn measure(&mut self, sim: &Simulation) -> f64 {
        let (mut first, mut second, mut sum) = (0.0, 0.0, 0.0);
        let parts = &self.proximity.parts;
        for i in WORLD + 1..parts.len() {
            let moved = Placed::of(sim, parts[i].body).moved(&self.placed[i], parts[i].radius);
            self.moved[i] = moved;
            sum += moved;
            if moved > first {
                (first, second) = (moved, first);
            } else if moved > second {
                second = moved;
            }
        }
        if f64::is_finite(sum) { first + second } else { f64::NAN }
    }

    /// Measures all distances anew.
    fn check(&mut self, sim: &Simulation) {
        for (placed, part) in self.placed.iter_mut().zip(&self.proximity.parts) {
            *placed = Placed::of(sim, part.body);
        }
        self.moved.fill(0.0);
        self.near.clear();
        self.far = f64::INFINITY;
        for group in 0..self.proximity.groups.len() {
            let clearance = self.proximity.rough_clearance(sim, group);
            if clearance >= self.proximity.reach {
                self.far = self.far.min(clearance);
            } else {
                self.near.push(Near { group, at_check: clearance, clearance, relative: self.relative(sim, group) });
            }
        }
    }

    /// Whether a near pair is apart for certain; measures its distance anew if need be.
    fn passes(&mut self, sim: &Simulation, i: usize) -> bool {
        let near = &self.near[i];
        let group = near.group;
        let [a, b] = self.proximity.groups[group].parts;
        if near.at_check > self.moved[a] + self.moved[b] {
            return true;
        }
        let relative = self.relative(sim, group);
        if near.clearance > relative.moved(&near.relative, self.proximity.parts[b].radius) {
            return true;
        }
        let clearance = self.proximity.clearance(sim, group);
        let near = &mut self.near[i];
        (near.clearance, near.relative) = (clearance, relative);
        clearance > 0.0
    }

    /// Pose of a group's second part in the frame of its first.
    fn relative(&self, sim: &Simulation, group: usize) -> Placed {
        let parts = self.proximity.groups[group].parts;
        let [a, b] = parts.map(|part| self.proximity.parts[part].body);
        let (from, to) = (Placed::of(sim, a), Placed::of(sim, b));
        let rotation = Matrix3::from_row_slice(&sim.xmat()[9 * a..9 * a + 9]);
        Placed {
            position: rotation.tr_mul(&(to.position - from.position)),
            quaternion: conjugate_product(&from.quaternion, &to.quaternion),
        }
    }
}

impl Default for Placed {
    fn default() -> Self {
        Self { position: Vector3::zeros(), quaternion: [1.0, 0.0, 0.0, 0.0] }
    }
}

impl Placed {
    #[inline]
    fn of(sim: &Simulation, body: usize) -> Self {
        let quaternion = &sim.xquat()[4 * body..4 * body + 4];
        Self {
            position: Vector3::from_column_slice(&sim.xipos()[3 * body..3 * body + 3]),
            quaternion: std::array::from_fn(|i| quaternion[i]),
        }
    }

    /// No point within `radius` has moved farther than this from where it was.
    #[inline]
    fn moved(&self, before: &Self, radius: f64) -> f64 {
        let turned: f64 = (0..4).map(|i| (self.quaternion[i] - before.quaternion[i]).powi(2)).sum();
        (self.position - before.position).norm() + 2.0 * turned.sqrt() * radius
    }
}

/// The rotation `b` seen from `a`.
fn conjugate_product(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
    let [w, x, y, z] = *a;
    let [bw, bx, by, bz] = *b;
    [
        w * bw + x * bx + y * by + z * bz,
        w * bx - x * bw - y * bz + z * by,
        w * by - y * bw - z * bx + x * bz,
        w * bz - z * bw - x * by + y * bx,
    ]
}

impl Simulation {
    /// The collision stage for a step without contacts: the previous contacts and constraint rows are dropped. To be
    /// called in the place of [`collision`](Self::collision) when a [`Clearance`] certifies that it would find nothing,
    /// or nothing but the contacts that a [`PairCollider`] finds.
    pub fn skip_collision(&mut self) {
        self.forget_contacts();
    }
}
