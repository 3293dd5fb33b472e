//! One row: what it moves, its law, and where on that it stands.

use crate::grasp::linalg;

#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub entries: Entries,
    pub reference: f64,
    pub regularisation: f64,
    pub bounds: [f64; 2],
    /// With which stiffness it is in the factors, zero at a bound; `None` before there are any.
    pub factored: Option<f64>,
    pub at: At,
    pub force: f64,
    /// `J a`, and after a whole step of Newton's method.
    pub motion: f64,
    pub next: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Entries {
    /// Degree of freedom, and the entry.
    Single(usize, f64),
    /// Number among the dense rows.
    Dense(usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum At {
    Lower,
    Between,
    Upper,
}

impl Row {
    /// Takes the force at `J a = motion`.
    pub fn follow(&mut self, motion: f64) {
        (self.motion, self.at, self.force) = (motion, self.at(motion), self.force_at(motion));
    }

    pub fn at(&self, motion: f64) -> At {
        let force = (self.reference - motion) / self.regularisation;
        let [lower, upper] = self.bounds;
        match force {
            f if f <= lower => At::Lower,
            f if f >= upper => At::Upper,
            _ => At::Between,
        }
    }

    pub fn force_at(&self, motion: f64) -> f64 {
        ((self.reference - motion) / self.regularisation).max(self.bounds[0]).min(self.bounds[1])
    }

    pub fn is_free(&self) -> bool {
        self.at == At::Between
    }

    /// `1 / R` between its bounds, and 0 at one.
    pub fn stiffness(&self) -> f64 {
        if self.is_free() { 1.0 / self.regularisation } else { 0.0 }
    }

    /// `J a`, for the dense rows' `jacobian`.
    pub fn motion_in(&self, acceleration: &[f64], jacobian: &[f64]) -> f64 {
        match self.entries {
            Entries::Single(dof, entry) => entry * acceleration[dof],
            Entries::Dense(k) => {
                let nv = acceleration.len();
                linalg::dot(&jacobian[k * nv..(k + 1) * nv], acceleration)
            }
        }
    }
}
