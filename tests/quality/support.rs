//! Contacts for the quality tests.

use mujoco_grasp::grasp::monitor::wrench::LoadedContact;
use nalgebra::{Rotation3, Vector3};

/// A contact at `position` pressing along `normal`, its force purely normal.
pub fn contact(
    position: Vector3<f64>,
    normal: Vector3<f64>,
    condim: usize,
    friction: [f64; 5],
    normal_force: f64,
) -> LoadedContact {
    let normal = normal.normalize();
    let least = normal.iamin();
    let mut axis = Vector3::zeros();
    axis[least] = 1.0;
    let t1 = normal.cross(&axis).normalize();
    LoadedContact {
        position,
        normal,
        tangents: [t1, normal.cross(&t1)],
        condim,
        friction,
        normal_force,
        force: normal * normal_force,
        torque: Vector3::zeros(),
    }
}

/// Contacts on a sphere of radius `a` about the origin in the given directions, all alike.
pub fn on_sphere(
    directions: &[Vector3<f64>],
    a: f64,
    condim: usize,
    friction: [f64; 5],
    normal_force: f64,
) -> Vec<LoadedContact> {
    directions.iter().map(|d| contact(d.normalize() * a, -d, condim, friction, normal_force)).collect()
}

/// `n` directions around the equator.
pub fn equator(n: usize) -> Vec<Vector3<f64>> {
    (0..n)
        .map(|k| {
            let angle = std::f64::consts::TAU * k as f64 / n as f64;
            Vector3::new(angle.cos(), angle.sin(), 0.0)
        })
        .collect()
}

pub fn tetrahedron() -> Vec<Vector3<f64>> {
    vec![
        Vector3::new(1.0, 1.0, 1.0),
        Vector3::new(1.0, -1.0, -1.0),
        Vector3::new(-1.0, 1.0, -1.0),
        Vector3::new(-1.0, -1.0, 1.0),
    ]
}

pub fn faces() -> Vec<Vector3<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    axes.iter().flat_map(|a| [*a, -*a]).collect()
}

/// Uniform numbers in [0, 1), the same in every run.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(seed)
    }

    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    pub fn direction(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal()).normalize()
    }

    /// A grasp of an uneven object: contacts anywhere, normals roughly inwards.
    pub fn grasp(&mut self, count: usize, condim: usize) -> Vec<LoadedContact> {
        (0..count)
            .map(|_| {
                let d = self.direction();
                let position = d * (0.02 + 0.03 * self.uniform());
                let normal = -d + self.direction() * 0.4;
                let friction = [0.3 + self.uniform(), 0.3 + self.uniform(), 0.02 * self.uniform(), 0.002, 0.003];
                let force = 0.2 + 3.0 * self.uniform();
                contact(position, normal, condim, friction, force)
            })
            .collect()
    }
}

/// The same scene turned and moved.
pub fn moved(c: &LoadedContact, turn: &Rotation3<f64>, shift: &Vector3<f64>) -> LoadedContact {
    LoadedContact {
        position: turn * c.position + shift,
        normal: turn * c.normal,
        tangents: c.tangents.map(|t| turn * t),
        force: turn * c.force,
        torque: turn * c.torque,
        ..*c
    }
}
