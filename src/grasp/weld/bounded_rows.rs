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

mod row;

use row::{At, Entries, Row};

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
    /// `L^-T` of the dense rows' `J^T`, zero of those at a bound: a line for each degree of freedom.
    columns: Vec<f64>,
    /// `J H^-1 J^T + R` of the dense rows, and its factor.
    system: Vec<f64>,
    factored: Vec<f64>,
    /// Generalised forces that are known, and `L^-T` of them.
    known: Vec<f64>,
    /// `J H^-1` of the known forces.
    answer: Vec<f64>,
    /// Of the dense rows that are at no bound; zero for the others, which are among the known forces.
    force: Vec<f64>,
    acceleration: Vec<f64>,
    /// Where a whole step of Newton's method leads, the step, and M times what is left of the smooth acceleration.
    next: Vec<f64>,
    step: Vec<f64>,
    inertial: Vec<f64>,
    /// All rows of the last step were solved.
    complete: bool,
    /// Leaves everything to the engine.
    #[cfg(test)]
    pub idle: bool,
    /// Steps that it has solved.
    #[cfg(test)]
    pub solved: usize,
}

impl BoundedRows {
    /// Solves all rows, those of welds being `welds`, beside the generalised forces `internal`, and ends the engine's solve
    /// with that. False, with nothing written, if it is for the engine's own solver: there are elliptic cones or a noslip
    /// pass.
    pub fn solve(&mut self, sim: &mut Simulation, welds: &Range<usize>, internal: &[f64]) -> Result<bool, Error> {
        self.complete = false;
        #[cfg(test)]
        if self.idle {
            return Ok(false);
        }
        Ok(self.read(sim, welds)? && self.iterate(sim, internal)?)
    }

    /// As [`solve`](Self::solve), one step on frozen geometry later: the same rows, with other references and bounds.
    pub fn resume(&mut self, sim: &mut Simulation, internal: &[f64]) -> Result<bool, Error> {
        self.complete = false;
        self.acceleration.copy_from_slice(sim.qacc_warmstart());
        for (number, row) in self.rows.iter_mut().enumerate() {
            (row.reference, row.regularisation) = (sim.efc_aref()[number], sim.efc_R()[number]);
            if row.bounds[0].is_finite() && row.bounds[1].is_finite() {
                let limit = sim.efc_frictionloss()[number];
                row.bounds = [-limit, limit];
            }
            row.follow(row.motion_in(&self.acceleration, &self.jacobian));
        }
        self.iterate(sim, internal)
    }

    /// Whether the last step's rows can be solved again where nothing but time has passed.
    pub fn can_resume(&self) -> bool {
        self.complete
    }

    /// The rows that it has are of an earlier step.
    pub fn forget(&mut self) {
        self.complete = false;
    }

    /// Newton's method on the set of rows at a bound.
    fn iterate(&mut self, sim: &mut Simulation, internal: &[f64]) -> Result<bool, Error> {
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
        self.complete = settled;
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
                factored: None,
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
        if !self.rows.iter().all(|row| row.factored == Some(row.stiffness())) {
            self.factorise(sim.model().nv());
        }
        let smooth = sim.qacc_smooth();
        self.push_known(smooth, internal);
        self.solve_dense(smooth);
        self.next.clear();
        let width = self.width();
        let lines = self.columns.chunks_exact(width.max(1));
        self.next.extend_from_slice(&self.known);
        self.next.iter_mut().zip(lines).for_each(|(next, line)| *next += linalg::dot_lanes(line, &self.force));
        self.factor.backward(&mut self.next);
        linalg::axpy(1.0, smooth, &mut self.next);
        for row in &mut self.rows {
            row.next = row.motion_in(&self.next, &self.jacobian);
        }
    }

    /// Numbers of a line of columns: the dense rows, in whole vectors.
    fn width(&self) -> usize {
        self.dense.len().next_multiple_of(linalg::LANES)
    }

    /// Factors for the rows that are at no bound.
    fn factorise(&mut self, nv: usize) {
        let (n, width) = (self.dense.len(), self.width());
        self.factor.copy_from(&self.mass);
        self.columns.clear();
        self.columns.resize(nv * width, 0.0);
        for row in &mut self.rows {
            let stiffness = row.stiffness();
            row.factored = Some(stiffness);
            match row.entries {
                Entries::Single(dof, entry) if stiffness > 0.0 => {
                    self.factor.strengthen(dof, entry * entry * stiffness);
                }
                Entries::Dense(k) if stiffness > 0.0 => {
                    let jacobian = &self.jacobian[k * nv..(k + 1) * nv];
                    self.columns.chunks_exact_mut(width).zip(jacobian).for_each(|(line, entry)| line[k] = *entry);
                }
                _ => {}
            }
        }
        self.factor.forward(&mut self.columns, width);
        self.system.clear();
        self.system.resize(n * width, 0.0);
        for (line, inverse) in self.columns.chunks_exact(width.max(1)).zip(self.factor.inverse_diagonal()) {
            for (entry, sum) in line[..n].iter().zip(self.system.chunks_exact_mut(width)) {
                if *entry != 0.0 {
                    linalg::axpy_lanes(entry * inverse, line, sum);
                }
            }
        }
        self.factored.clear();
        for (k, (line, &number)) in self.system.chunks_exact(width.max(1)).zip(&self.dense).enumerate() {
            self.factored.extend_from_slice(&line[..n]);
            self.factored[k * n + k] += self.rows[number].regularisation;
        }
        linalg::cholesky(&mut self.factored, n);
    }

    /// `known <- L^-T` of the known forces: `internal`, those of rows at a bound, and of the others' single joints what they
    /// resist to the smooth acceleration.
    fn push_known(&mut self, smooth: &[f64], internal: &[f64]) {
        self.known.clear();
        self.known.extend_from_slice(internal);
        for row in &self.rows {
            match row.entries {
                Entries::Single(dof, entry) => {
                    let force =
                        if row.is_free() { row.stiffness() * (row.reference - entry * smooth[dof]) } else { row.force };
                    self.known[dof] += entry * force;
                }
                Entries::Dense(k) if !row.is_free() => {
                    let nv = smooth.len();
                    linalg::axpy(row.force, &self.jacobian[k * nv..(k + 1) * nv], &mut self.known);
                }
                Entries::Dense(_) => {}
            }
        }
        self.factor.forward_one(&mut self.known);
    }

    fn solve_dense(&mut self, smooth: &[f64]) {
        let (n, width) = (self.dense.len(), self.width());
        self.answer.clear();
        self.answer.resize(width, 0.0);
        let lines = self.columns.chunks_exact(width.max(1));
        for ((line, inverse), known) in lines.zip(self.factor.inverse_diagonal()).zip(&self.known) {
            linalg::axpy_lanes(inverse * known, line, &mut self.answer);
        }
        self.force.clear();
        for ((&number, jacobian), answer) in
            self.dense.iter().zip(self.jacobian.chunks_exact(smooth.len().max(1))).zip(&self.answer)
        {
            let row = &self.rows[number];
            let free = row.reference - linalg::dot(jacobian, smooth) - answer;
            self.force.push(if row.is_free() { free } else { 0.0 });
        }
        linalg::cholesky_backsolve(&self.factored, n, &mut self.force);
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
