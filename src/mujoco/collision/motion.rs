//! Where a body is, and bounds of how far its points have moved.

use crate::mujoco::simulation::Simulation;
use nalgebra::{Matrix3, Vector3};

/// A body's centre of mass, m, and its orientation (w, x, y, z).
#[derive(Debug, Clone, Copy)]
pub(super) struct Placement {
    position: Vector3<f64>,
    quaternion: [f64; 4],
}

impl Default for Placement {
    fn default() -> Self {
        Self { position: Vector3::zeros(), quaternion: [1.0, 0.0, 0.0, 0.0] }
    }
}

impl Placement {
    #[inline]
    pub fn of(sim: &Simulation, body: usize) -> Self {
        let quaternion = &sim.xquat()[4 * body..4 * body + 4];
        Self {
            position: Vector3::from_column_slice(&sim.xipos()[3 * body..3 * body + 3]),
            quaternion: std::array::from_fn(|i| quaternion[i]),
        }
    }

    /// Body `b` in the frame of body `a`.
    pub fn relative(sim: &Simulation, a: usize, b: usize) -> Self {
        let (from, to) = (Self::of(sim, a), Self::of(sim, b));
        let rotation = Matrix3::from_row_slice(&sim.xmat()[9 * a..9 * a + 9]);
        Self {
            position: rotation.tr_mul(&(to.position - from.position)),
            quaternion: product(&conjugate(&from.quaternion), &to.quaternion),
        }
    }

    /// No point within `radius` of the centre has moved farther than this from where it was, m: a rotation by an angle
    /// `a` moves it by `2 sin(a/2) radius`, and the quaternions differ by `2 sin(a/4)`.
    #[inline]
    pub fn moved(&self, before: &Self, radius: f64) -> f64 {
        let turned: f64 = (0..4).map(|i| (self.quaternion[i] - before.quaternion[i]).powi(2)).sum();
        let squares = [(self.position - before.position).norm_squared(), turned];
        // Both roots at once.
        let [shifted, turned] = squares.map(f64::sqrt);
        shifted + 2.0 * turned * radius
    }

    /// Of the centres, m.
    pub fn distance(&self, other: &Self) -> f64 {
        (self.position - other.position).norm()
    }

    /// The rigid motion that brought a body here from `before`.
    pub fn since(&self, before: &Self) -> Motion {
        let quaternion = product(&self.quaternion, &conjugate(&before.quaternion));
        Motion { from: before.position, to: self.position, rotation: rotation(&quaternion), quaternion }
    }
}

/// A rigid motion.
pub(super) struct Motion {
    from: Vector3<f64>,
    to: Vector3<f64>,
    rotation: Matrix3<f64>,
    quaternion: [f64; 4],
}

impl Motion {
    /// Where it takes a body.
    #[inline]
    pub fn carry(&self, body: &Placement) -> Placement {
        Placement {
            position: self.to + self.rotation * (body.position - self.from),
            quaternion: product(&self.quaternion, &body.quaternion),
        }
    }
}

fn conjugate([w, x, y, z]: &[f64; 4]) -> [f64; 4] {
    [*w, -x, -y, -z]
}

#[inline]
fn product(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
    let ([aw, ax, ay, az], [bw, bx, by, bz]) = (*a, *b);
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

/// Of a unit quaternion.
fn rotation([w, x, y, z]: &[f64; 4]) -> Matrix3<f64> {
    Matrix3::new(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )
}
