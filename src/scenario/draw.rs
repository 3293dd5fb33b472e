//! Random pushes: directions, sizes and durations, the same for a seed on every machine.
//!
//! ChaCha8 is a published stream cipher with test vectors, so that its numbers depend on no library's version, and it has
//! 2^64 streams: each trial has its own, and a trial is the same whatever their number, order or threads.

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;

/// Sizes are drawn from these shares of the onset, evenly: near it the smallest difference decides.
pub const SHARES: [(f64, f64); 2] = [(0.3, 0.9), (1.1, 1.6)];
/// Shortest and longest push \[s\].
pub const DURATIONS: (f64, f64) = (0.2, 1.0);

/// What a push is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Its size is in N.
    Force,
    /// Its size is in N m.
    Torque,
}

impl Kind {
    /// As in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Force => "force",
            Self::Torque => "torque",
        }
    }
}

/// A direction to push in, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Force or torque.
    pub kind: Kind,
    /// Of length 1.
    pub unit: Vector3<f64>,
}

impl Direction {
    /// Force and torque of this size.
    pub fn wrench(&self, size: f64) -> (Vector3<f64>, Vector3<f64>) {
        match self.kind {
            Kind::Force => (self.unit * size, Vector3::zeros()),
            Kind::Torque => (Vector3::zeros(), self.unit * size),
        }
    }
}

/// 26 directions of force, then 26 of torque: to the faces, edges and corners of a cube.
pub fn directions() -> Vec<Direction> {
    let signs = [-1.0, 0.0, 1.0];
    let mut all = Vec::with_capacity(52);
    for kind in [Kind::Force, Kind::Torque] {
        for x in signs {
            for y in signs {
                for z in signs {
                    if let Some(unit) = Vector3::new(x, y, z).try_normalize(0.5) {
                        all.push(Direction { kind, unit });
                    }
                }
            }
        }
    }
    all
}

/// One random push, before the onset of its direction gives it a size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw {
    /// Which of the directions to draw from.
    pub choice: usize,
    /// Size over the onset.
    pub share: f64,
    /// \[s\]
    pub duration: f64,
}

impl Draw {
    /// The push of trial `trial` among `choices` directions, 1 or more.
    pub fn new(seed: u64, trial: u64, choices: usize) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        let mut rng = ChaCha8Rng::from_seed(key);
        rng.set_stream(trial);
        // 53 bits: every number is exact, from 0 to below 1.
        let mut even = || (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let choice = ((even() * choices as f64) as usize).min(choices.saturating_sub(1));
        let share = share(even());
        let (shortest, longest) = DURATIONS;
        Self { choice, share, duration: shortest + even() * (longest - shortest) }
    }
}

/// From a number between 0 and 1 to the share that lies so far along [`SHARES`].
fn share(even: f64) -> f64 {
    let [(a, b), (c, d)] = SHARES;
    let along = even * ((b - a) + (d - c));
    if along < b - a { a + along } else { c + along - (b - a) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_has_26_directions() {
        let all = directions();
        assert_eq!(all.len(), 52);
        for (i, a) in all.iter().enumerate() {
            assert!((a.unit.norm() - 1.0).abs() < 1e-15);
            assert_eq!(a.kind, if i < 26 { Kind::Force } else { Kind::Torque });
            assert!(all[..i].iter().all(|b| b.kind != a.kind || (b.unit - a.unit).norm() > 0.4));
        }
    }

    #[test]
    fn draws_fill_their_ranges_evenly() {
        let n = 20_000;
        let draws: Vec<Draw> = (0..n).map(|trial| Draw::new(7, trial, 52)).collect();
        let part = |f: &dyn Fn(&Draw) -> bool| draws.iter().filter(|d| f(d)).count() as f64 / n as f64;
        assert!(draws.iter().all(|d| d.choice < 52 && (0.2..1.0).contains(&d.duration)));
        assert!(draws.iter().all(|d| (0.3..0.9).contains(&d.share) || (1.1..1.6).contains(&d.share)));
        assert!((part(&|d| d.share < 1.0) - 0.6 / 1.1).abs() < 0.02);
        assert!((part(&|d| d.share < 0.6) - 0.3 / 1.1).abs() < 0.02);
        assert!((part(&|d| d.duration < 0.6) - 0.5).abs() < 0.02);
        assert!((part(&|d| d.choice < 26) - 0.5).abs() < 0.02);
        for choice in 0..52 {
            assert!((part(&|d| d.choice == choice) - 1.0 / 52.0).abs() < 0.006);
        }
    }

    #[test]
    fn a_draw_depends_on_seed_and_trial_only() {
        assert_eq!(Draw::new(1, 5, 52), Draw::new(1, 5, 52));
        assert_ne!(Draw::new(1, 5, 52), Draw::new(1, 6, 52));
        assert_ne!(Draw::new(1, 5, 52), Draw::new(2, 5, 52));
        // ChaCha8 with a key and a stream of zeros begins with the bytes 3e 00 ef 2f 89 5f 40 d6 (its test vector).
        let mut rng = ChaCha8Rng::from_seed([0; 32]);
        assert_eq!(rng.next_u64().to_le_bytes(), [0x3e, 0x00, 0xef, 0x2f, 0x89, 0x5f, 0x40, 0xd6]);
    }
}
