//! What a run leaves behind: one sample per step.

use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};

use super::error::Error;
use super::rows;

/// The state of a grasp in one step: poses, contacts and forces of the same instant, before the step integrates.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Simulation time \[s\].
    pub time: f64,
    /// Target's frame in the palm's frame \[m\].
    pub position: Vector3<f64>,
    /// Target's frame in the palm's frame.
    pub rotation: UnitQuaternion<f64>,
    /// Whether the grasp's constraint is in place.
    pub grasped: bool,
    /// Grasped, and the step was made on frozen geometry.
    pub frozen: bool,
    /// Grasp quality \[N\].
    pub quality: f64,
    /// Whether any geom of the palm or below it touches the target.
    pub touching: bool,
    /// Something below the palm presses on it.
    pub gripped: bool,
    /// Largest -dist between hand and target \[m\], 0 without contact.
    pub penetration: f64,
    /// Largest slip that any link has accumulated since `measure_from` \[m\]: the length of the integral of the tangential
    /// velocity of the target relative to the link, so that what slides back is not counted twice.
    pub slip: f64,
    /// Wall-clock time of the step \[ns\].
    pub step_ns: u64,
}

impl Sample {
    /// The phase as a number: 0 ungrasped, 1 grasped, 2 grasped and on frozen geometry.
    pub fn phase(&self) -> u8 {
        u8::from(self.grasped) + u8::from(self.frozen)
    }
}

/// The first columns of a trajectory's file; the links' normal forces follow.
pub const COLUMNS: [&str; 10] = ["time_s", "px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz", "phase", "quality_n"];

/// Samples of one run, in order of time.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    links: Vec<String>,
    samples: Vec<Sample>,
    /// samples x links, row by row \[N\]
    normal_forces: Vec<f64>,
}

impl Trajectory {
    /// `links`: names of the hand's links, for the normal forces. `steps`: room to take, so that [`Self::push`] allocates nothing.
    pub fn new(links: Vec<String>, steps: usize) -> Self {
        let normal_forces = Vec::with_capacity(steps * links.len());
        Self { links, samples: Vec::with_capacity(steps), normal_forces }
    }

    /// Appends a sample with the normal force of each link \[N\], in the order of [`Self::links`].
    pub fn push(&mut self, sample: Sample, normal_forces: &[f64]) {
        debug_assert_eq!(normal_forces.len(), self.links.len());
        self.samples.push(sample);
        self.normal_forces.extend(normal_forces.iter().take(self.links.len()));
        self.normal_forces.resize(self.samples.len() * self.links.len(), 0.0);
    }

    /// Names of the links.
    pub fn links(&self) -> &[String] {
        &self.links
    }

    /// All samples.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Normal force of each link in sample `index` \[N\]; empty past the end.
    pub fn normal_forces(&self, index: usize) -> &[f64] {
        let n = self.links.len();
        self.normal_forces.get(index * n..(index + 1) * n).unwrap_or(&[])
    }

    /// Index of the first sample at or after `time`, half a step of tolerance included; `None` when the run ended before.
    pub fn index_at(&self, time: f64) -> Option<usize> {
        let step = match self.samples.as_slice() {
            [a, b, ..] => b.time - a.time,
            _ => 0.0,
        };
        let index = self.samples.partition_point(|s| s.time < time - 0.5 * step);
        (index < self.samples.len()).then_some(index)
    }

    /// Writes the columns `time_s, px_m, py_m, pz_m, qw, qx, qy, qz, phase, quality_n, normal_force_n:LINK...`.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write_csv(&self, path: &Path) -> Result<(), Error> {
        let forces = self.links.iter().map(|link| format!("normal_force_n:{link}"));
        let head = COLUMNS.iter().map(|&s| s.to_owned()).chain(forces);
        let rows = self.samples.iter().enumerate().map(|(index, s)| {
            let (p, q) = (s.position, s.rotation);
            ((s.time, p.x, p.y, p.z, q.w, q.i, q.j, q.k, s.phase(), s.quality), self.normal_forces(index))
        });
        rows::write(path, head, rows)
    }
}
