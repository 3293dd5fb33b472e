//! All constraint rows of a step with merged grasps, solved at once.
//!
//! MuJoCo's problem for rows without friction cones is
//!
//! ```text
//! M (a - a_smooth) = J^T f + g    f = clamp((aref - J a) / R, lower, upper)   row by row
//! ```
//!
//! with no bounds for an equality, one for a limit, two for friction and for the bounded rows of a weld; `g` are the
//! internal forces of the grasps. Once it is known which rows are at a bound, it is linear. Rows of one joint (limits,
//! friction losses) that are not at a bound then add an entry to M's diagonal, which its factor takes along the joint's
//! ancestors (`H`); the others, as a rule the six of a weld, are a small dense problem in `J H^-1 J^T + R`. Newton's method
//! on the set of rows at a bound: as a rule that of the last step is right. Where it is not, steps go as far as they lower
//! MuJoCo's cost, or they could go round in circles.

use super::tree_factor::TreeFactor;
use crate::grasp::error::Error;
use crate::grasp::linalg;
use crate::mujoco::{RowKind, RowState, Simulation};
use std::ops::Range;

/// More than it takes; rounding may keep a row from settling on either side of its bound.
const MOST_ITERATIONS: usize = 30;
/// Steps in which the least cost along a line is found, and how much of its slope may be left.
const SEARCH: (usize, f64) = (20, 1e-9);

/// The solver. Buffers are kept.
#[derive(Clone, Debug, Default)]
pub(in crate::grasp) struct BoundedRows {
    rows: Vec<Row>,
    /// The rows that move several joints, by their numbers, and `J` of each, one entry for each degree of freedom.
    dense: Vec<usize>,
    jacobian: Vec<f64>,
    mass: TreeFactor,
    /// Of `H`.
    factor: TreeFactor,
    /// `L^-T` of the dense rows' `J^T` and, next to them, of the known forces: a line for each degree of freedom.
    columns: Vec<f64>,
    /// `J H^-1 J^T + R` of the dense rows and its factor; next to it, `J H^-1` of the known forces.
    system: Vec<f64>,
    factored: Vec<f64>,
    /// Of the dense rows that are at no bound; zero for the others, which are among the known forces, and then a one for
    /// these.
    force: Vec<f64>,
    acceleration: Vec<f64>,
    /// Where a whole step of Newton's method leads, the step, and M times what is left of the smooth acceleration.
    next: Vec<f64>,
    step: Vec<f64>,
    inertial: Vec<f64>,
    /// Leaves everything to the engine.
    #[cfg(test)]
    pub idle: bool,
    /// Steps that it has solved.
    #[cfg(test)]
    pub solved: usize,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    entries: Entries,
    reference: f64,
    regularisation: f64,
    bounds: [f64; 2],
    at: At,
    force: f64,
    /// `J a`, and after a whole step of Newton's method.
    motion: f64,
    next: f64,
}

#[derive(Clone, Copy, Debug)]
enum Entries {
    /// Degree of freedom, and the entry.
    Single(usize, f64),
    /// Number among the dense rows.
    Dense(usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    Lower,
    Between,
    Upper,
}

impl Row {
    /// Takes the force at `J a = motion`.
    fn follow(&mut self, motion: f64) {
        (self.motion, self.at, self.force) = (motion, self.at(motion), self.force_at(motion));
    }

    fn at(&self, motion: f64) -> At {
        let force = (self.reference - motion) / self.regularisation;
        let [lower, upper] = self.bounds;
        match force {
            f if f <= lower => At::Lower,
            f if f >= upper => At::Upper,
            _ => At::Between,
        }
    }

    fn force_at(&self, motion: f64) -> f64 {
        ((self.reference - motion) / self.regularisation).max(self.bounds[0]).min(self.bounds[1])
    }

    fn is_free(&self) -> bool {
        self.at == At::Between
    }

    /// `J a`, for the dense rows' `jacobian`.
    fn motion_in(&self, acceleration: &[f64], jacobian: &[f64]) -> f64 {
        match self.entries {
            Entries::Single(dof, entry) => entry * acceleration[dof],
            Entries::Dense(k) => {
                let nv = acceleration.len();
                linalg::dot(&jacobian[k * nv..(k + 1) * nv], acceleration)
            }
        }
    }
}

impl BoundedRows {
    /// Solves all rows, those of welds being `welds`, beside the generalised forces `internal`, and ends the engine's solve
    /// with that. False, with nothing written, if it is for the engine's own solver: there are elliptic cones or a noslip
    /// pass.
    pub fn solve(&mut self, sim: &mut Simulation, welds: &Range<usize>, internal: &[f64]) -> Result<bool, Error> {
        #[cfg(test)]
        if self.idle {
            return Ok(false);
        }
        if !self.read(sim, welds)? {
            return Ok(false);
        }
        let mut settled = false;
        for _ in 0..MOST_ITERATIONS {
            self.solve_between(sim, internal);
            settled = self.rows.iter().all(|row| row.at(row.next) == row.at);
            let share = if settled { 1.0 } else { self.least_cost(sim, internal)? };
            for (a, next) in self.acceleration.iter_mut().zip(&self.next) {
                *a += share * (next - *a);
            }
            for row in &mut self.rows {
                row.follow(row.motion + share * (row.next - row.motion));
            }
            if settled {
                break;
            }
        }
        if settled {
            self.write(sim, internal);
            #[cfg(test)]
            {
                self.solved += 1;
            }
        }
        Ok(settled)
    }

    /// Reads the rows; each is at the bound where the last step's acceleration puts it.
    fn read(&mut self, sim: &Simulation, welds: &Range<usize>) -> Result<bool, Error> {
        let nv = sim.model().nv();
        self.rows.clear();
        self.dense.clear();
        self.jacobian.clear();
        for number in 0..sim.nefc() {
            let kind = sim.constraint_row(number)?.kind;
            let bounds = match kind {
                RowKind::ContactElliptic => return Ok(false),
                RowKind::Equality => [f64::NEG_INFINITY, f64::INFINITY],
                RowKind::FrictionDof | RowKind::FrictionTendon => {
                    let limit = sim.efc_frictionloss()[number];
                    [-limit, limit]
                }
                _ => [0.0, f64::INFINITY],
            };
            let is_weld = welds.contains(&number);
            let slips = matches!(kind, RowKind::FrictionDof | RowKind::FrictionTendon | RowKind::ContactPyramidal);
            if slips && !is_weld && sim.model().noslip_iterations() > 0 {
                return Ok(false);
            }
            let single = if is_weld { None } else { sim.row_single_entry(number)? };
            let entries = match single {
                Some((dof, entry)) => Entries::Single(dof, entry),
                None => {
                    let at = self.jacobian.len();
                    self.jacobian.resize(at + nv, 0.0);
                    sim.row_jacobian(number, &mut self.jacobian[at..])?;
                    self.dense.push(number);
                    Entries::Dense(self.dense.len() - 1)
                }
            };
            self.rows.push(Row {
                entries,
                reference: sim.efc_aref()[number],
                regularisation: sim.efc_R()[number],
                bounds,
                at: At::Between,
                force: 0.0,
                motion: 0.0,
                next: 0.0,
            });
        }
        self.acceleration.clear();
        self.acceleration.extend_from_slice(sim.qacc_warmstart());
        for row in &mut self.rows {
            row.follow(row.motion_in(&self.acceleration, &self.jacobian));
        }
        self.mass.load(sim);
        Ok(true)
    }

    /// The acceleration with the rows at a bound held there, and the others without bounds.
    fn solve_between(&mut self, sim: &Simulation, internal: &[f64]) {
        let n = self.dense.len();
        let width = self.width();
        let smooth = sim.qacc_smooth();
        self.factor.copy_from(&self.mass);
        self.columns.clear();
        self.columns.resize(smooth.len() * width, 0.0);
        for (line, force) in self.columns.chunks_exact_mut(width).zip(internal) {
            line[n] = *force;
        }
        for row in &self.rows {
            let Entries::Single(dof, entry) = row.entries else { continue };
            self.columns[dof * width + n] += if row.is_free() {
                let stiffness = entry / row.regularisation;
                self.factor.strengthen(dof, entry * stiffness);
                stiffness * (row.reference - entry * smooth[dof])
            } else {
                entry * row.force
            };
        }
        for (k, (jacobian, &number)) in self.jacobian.chunks_exact(smooth.len()).zip(&self.dense).enumerate() {
            let row = &self.rows[number];
            let (column, scale) = if row.is_free() { (k, 1.0) } else { (n, row.force) };
            for (line, entry) in self.columns.chunks_exact_mut(width).zip(jacobian) {
                line[column] += scale * entry;
            }
        }
        self.factor.forward(&mut self.columns, width);
        self.solve_dense(smooth);
        self.next.clear();
        self.next.extend(self.columns.chunks_exact(width).map(|line| linalg::dot_lanes(line, &self.force)));
        self.factor.backward(&mut self.next);
        linalg::axpy(1.0, smooth, &mut self.next);
        for row in &mut self.rows {
            row.next = row.motion_in(&self.next, &self.jacobian);
        }
    }

    /// Numbers of a line of columns: the dense rows and the known forces, in whole vectors.
    fn width(&self) -> usize {
        (self.dense.len() + 1).next_multiple_of(linalg::LANES)
    }

    fn solve_dense(&mut self, smooth: &[f64]) {
        let (n, width) = (self.dense.len(), self.width());
        self.system.clear();
        self.system.resize(n * width, 0.0);
        for (line, inverse) in self.columns.chunks_exact(width).zip(self.factor.inverse_diagonal()) {
            for (entry, sum) in line[..n].iter().zip(self.system.chunks_exact_mut(width)) {
                if *entry != 0.0 {
                    linalg::axpy_lanes(entry * inverse, line, sum);
                }
            }
        }
        self.factored.clear();
        self.force.clear();
        for (k, (line, jacobian)) in
            self.system.chunks_exact(width).zip(self.jacobian.chunks_exact(smooth.len().max(1))).enumerate()
        {
            let row = &self.rows[self.dense[k]];
            self.factored.extend_from_slice(&line[..n]);
            self.factored[k * n + k] += row.regularisation;
            let free = row.reference - linalg::dot(jacobian, smooth) - line[n];
            self.force.push(if row.is_free() { free } else { 0.0 });
        }
        linalg::cholesky(&mut self.factored, n);
        linalg::cholesky_backsolve(&self.factored, n, &mut self.force);
        self.force.push(1.0);
        self.force.resize(width, 0.0);
    }

    /// How much of the step to `next` has the least cost: where the slope of MuJoCo's cost along it is zero, at most all.
    fn least_cost(&mut self, sim: &Simulation, internal: &[f64]) -> Result<f64, Error> {
        let nv = internal.len();
        self.step.clear();
        self.step.extend(self.next.iter().zip(&self.acceleration).map(|(next, a)| next - a));
        self.inertial.clear();
        self.inertial.extend(self.acceleration.iter().zip(sim.qacc_smooth()).map(|(a, smooth)| a - smooth));
        self.inertial.resize(2 * nv, 0.0);
        let (away, product) = self.inertial.split_at_mut(nv);
        sim.mul_mass(&self.step, product)?;
        let start = linalg::dot(product, away) - linalg::dot(&self.step, internal);
        let rise = linalg::dot(product, &self.step);
        let slope = |share: f64| {
            self.rows.iter().fold((start + share * rise, rise), |(slope, rise), row| {
                let step = row.next - row.motion;
                let motion = row.motion + share * step;
                let stiffness = if row.at(motion) == At::Between { 1.0 / row.regularisation } else { 0.0 };
                (slope - step * row.force_at(motion), rise + stiffness * step * step)
            })
        };
        let tolerance = SEARCH.1 * slope(0.0).0.abs();
        let (mut below, mut above, mut share) = (0.0, 1.0, 1.0);
        for _ in 0..SEARCH.0 {
            let (slope, rise) = slope(share);
            if slope.abs() <= tolerance || share == 1.0 && slope < 0.0 {
                break;
            }
            *(if slope < 0.0 { &mut below } else { &mut above }) = share;
            let newton = share - slope / rise;
            share = if newton > below && newton < above { newton } else { 0.5 * (below + above) };
        }
        Ok(share)
    }

    /// Forces and states of the rows, the sum of all forces, and the acceleration.
    fn write(&self, sim: &mut Simulation, internal: &[f64]) {
        for (number, row) in self.rows.iter().enumerate() {
            sim.efc_force_mut()[number] = row.force;
            let one_sided = row.bounds == [0.0, f64::INFINITY];
            let state = match row.at {
                At::Between => RowState::Quadratic,
                At::Lower if one_sided => RowState::Satisfied,
                At::Lower => RowState::AtLowerLimit,
                At::Upper => RowState::AtUpperLimit,
            };
            sim.efc_state_mut()[number] = state.raw();
        }
        let total = sim.qfrc_constraint_mut();
        total.copy_from_slice(internal);
        let nv = total.len();
        for row in &self.rows {
            match row.entries {
                Entries::Single(dof, entry) => total[dof] += entry * row.force,
                Entries::Dense(k) => linalg::axpy(row.force, &self.jacobian[k * nv..(k + 1) * nv], total),
            }
        }
        sim.qacc_mut().copy_from_slice(&self.acceleration);
        sim.qacc_warmstart_mut().copy_from_slice(&self.acceleration);
    }
}

#[cfg(all(test, feature = "scenario"))]
mod tests;
