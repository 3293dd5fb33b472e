//! How far to go along a Newton step: to where the cost is least, by the zero of its derivative, as MuJoCo's Newton does.
//!
//! Along a line the inertial cost is a parabola, and the others' derivative, `-f . slope`, grows in pieces: Newton's method on
//! it finds its zero in few evaluations of the costs, where halving a step finds no more than some descent. With many contacts
//! at the edges of their cones that saves half the steps.

use super::{Arrow, RootVector};
use crate::grasp::contact::cost::MAX_ROWS;
use crate::grasp::linalg;

/// Share of the derivative at the start at which another is zero.
const FLAT: f64 = 0.1;
/// Evaluations before the search settles for what is known to descend.
const MAX_TRIALS: usize = 20;

/// The end of a search.
pub(super) struct Found {
    pub cost: f64,
    /// The inertial part of the cost, and the root's part of its gradient.
    pub inertial: f64,
    pub momentum: RootVector,
    /// True if this is the minimum of the whole: the Newton step was taken as it is, on the affine pieces that it is of.
    pub exact: bool,
}

impl Arrow {
    /// Moves to where the cost along the Newton step is least; `decrease` is what it falls by per unit at the start.
    pub(super) fn search(&mut self, decrease: f64, step: &RootVector, z: &mut RootVector) -> Found {
        let inertial_start = self.force_along_step() - decrease;
        self.advance(1.0, step, z);
        let (mut costs, exact) = self.respond();
        let (mut momentum, mut inertial) = self.inertial_forces(z);
        let inertial_end = self.along_step(&momentum, step);
        let curvature = inertial_end - inertial_start;
        let mut derivative = inertial_end - self.force_along_step();
        if exact || derivative.abs() <= FLAT * decrease {
            return Found { cost: costs + inertial, inertial, momentum, exact };
        }
        let (mut low, mut high, mut length) = (0.0, f64::INFINITY, 1.0);
        for trial in 0.. {
            if derivative > 0.0 {
                high = length;
            } else {
                low = length;
            }
            let newton = length - derivative / (curvature + self.curvature_along_step());
            let next = if trial == MAX_TRIALS {
                low
            } else if newton > low && newton < high {
                newton
            } else if high.is_finite() {
                0.5 * (low + high)
            } else {
                2.0 * length
            };
            self.advance(next - length, step, z);
            length = next;
            (costs, _) = self.respond();
            derivative = inertial_start + length * curvature - self.force_along_step();
            if trial == MAX_TRIALS || derivative.abs() <= FLAT * decrease {
                break;
            }
        }
        (momentum, inertial) = self.inertial_forces(z);
        Found { cost: costs + inertial, inertial, momentum, exact: false }
    }

    /// `f . slope`
    fn force_along_step(&self) -> f64 {
        linalg::dot(&self.forces, &self.slope) + self.singles.iter().map(|s| s.force * s.slope).sum::<f64>()
    }

    /// Second derivative of the costs along the step.
    fn curvature_along_step(&self) -> f64 {
        let of_blocks = self.blocks[..self.used].iter().map(|b| {
            let slope = &self.slope[b.row0 + b.first_row()..b.row0 + b.rows];
            let rows = b.response.hessian.chunks_exact(MAX_ROWS);
            slope.iter().zip(rows).map(|(x, row)| x * linalg::dot(slope, &row[..slope.len()])).sum::<f64>()
        });
        of_blocks.sum::<f64>() + self.singles.iter().map(|s| s.slope * s.slope * s.curvature()).sum::<f64>()
    }
}
