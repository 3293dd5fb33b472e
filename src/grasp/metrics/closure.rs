//! What a grasp can hold: force closure, and equilibrium under an external wrench (thesis Eq. 2.16).
//!
//! The friction cones are exact: MuJoCo's elliptic ones, `sum (f_j / mu_j)^2 <= f_n^2` over the condim's friction
//! components. Every question is put as a conic program that always has a solution (how much can be held, not whether),
//! so the answer never rests on a certificate of infeasibility, and the solution is checked against the balance and the
//! cones before it is believed.

use clarabel::solver::{NonnegativeConeT, SecondOrderConeT, SolverStatus, ZeroConeT};
use nalgebra::{Matrix6, Vector3, Vector6};

use crate::grasp::metrics::conic::Program;
use crate::grasp::metrics::error::{QualityError, SolverFault, check, finite};
use crate::grasp::monitor::gram::RANK_TOLERANCE;
use crate::grasp::monitor::wrench::{LoadedContact, inverse, stack};

/// Force closure needs forces this deep within every cone, as a fraction of the mean normal force. The conic solver
/// resolves no less where contacts sit on the very boundary.
pub const CLOSURE_MARGIN: f64 = 1e-4;
/// A wrench that takes more than the inverse of this times its own size in normal forces counts as not held.
const LEAST_LOAD: f64 = 1e-4;
/// Largest violation of balance or cones in a solution that is believed, relative to its largest force.
const RESIDUAL: f64 = 1e-6;

/// What bounds the normal forces of an equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NormalForces {
    /// Nothing: the fingers press as hard as it takes. The contacts' live forces play no part.
    Unlimited,
    /// Each contact's live normal force: no contact is pressed harder than now.
    Live,
}

/// What a contact exerts on the target in an equilibrium, world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BalancingForce {
    /// Force \[N\], normal and friction together.
    pub force: Vector3<f64>,
    /// Couple of torsional and rolling friction \[N m\].
    pub torque: Vector3<f64>,
}

/// Whether the contacts have force closure: they can exert every wrench on the target, pressed hard enough.
///
/// That is so if and only if their grasp map has rank 6 and some forces strictly within all their cones balance each
/// other. The geometry decides: live forces play no part, so leave out contacts that do not touch. On the boundary
/// (antipodal contacts just on their cones' edges) the answer is no.
///
/// # Errors
/// Contacts that are not numbers, or a solver that gave no verifiable answer.
pub fn force_closure(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<bool, QualityError> {
    check(contacts, com)?;
    let balance = Balance::new(contacts, com);
    if !balance.full_rank() {
        return Ok(false);
    }
    let (_, margin) = balance.deepest()?;
    Ok(margin * contacts.len() as f64 > CLOSURE_MARGIN)
}

/// Contact forces within the friction cones that balance an external wrench on the target, `[force; torque about com]`
/// in world axes \[N, N m\] (thesis Eq. 2.16), or None where there are none. Of all such forces those with the least sum
/// of normal forces when unlimited; within live forces those that use the smallest share of them.
/// Without an external wrench, zero forces.
///
/// # Errors
/// As [`force_closure`].
pub fn equilibrium(
    contacts: &[LoadedContact],
    com: &Vector3<f64>,
    external: &Vector6<f64>,
    limit: NormalForces,
) -> Result<Option<Vec<BalancingForce>>, QualityError> {
    check(contacts, com)?;
    finite("external wrench", external.as_slice())?;
    let balance = Balance::new(contacts, com);
    if balance.size(external) == 0.0 {
        return Ok(Some(balance.forces(&vec![0.0; balance.columns.len()], 0.0)));
    }
    let (forces, load) = balance.heaviest(external, limit)?;
    let (held, least) = match limit {
        // In units of the wrench's size per newton of normal force in sum.
        NormalForces::Unlimited => (load * balance.size(external), LEAST_LOAD),
        // A target at rest uses its live forces in full: leave the solver its accuracy.
        NormalForces::Live => (load, 1.0 - RESIDUAL),
    };
    Ok((held >= least).then(|| balance.forces(&forces, load.recip())))
}

/// How many times the external wrench `[force; torque about com]` \[N, N m\] the contacts can balance **with no contact
/// pressed harder than now**: below 1 it is not held; infinite where there is no wrench.
///
/// # Errors
/// As [`force_closure`].
pub fn load_factor(
    contacts: &[LoadedContact],
    com: &Vector3<f64>,
    external: &Vector6<f64>,
) -> Result<f64, QualityError> {
    check(contacts, com)?;
    finite("external wrench", external.as_slice())?;
    let balance = Balance::new(contacts, com);
    if balance.size(external) == 0.0 {
        return Ok(f64::INFINITY);
    }
    Ok(balance.heaviest(external, NormalForces::Live)?.1)
}

/// A column of the balance: a contact's normal force, or a friction component in units of its coefficient.
struct Column {
    contact: usize,
    /// None: the normal force.
    row: Option<usize>,
    /// Wrench per unit, torque over the length.
    wrench: Vector6<f64>,
}

/// The contacts' grasp map, its friction columns scaled by their coefficients so that every cone is round.
struct Balance<'a> {
    contacts: &'a [LoadedContact],
    columns: Vec<Column>,
    /// First column of each contact, and the end.
    starts: Vec<usize>,
    length: f64,
}

impl<'a> Balance<'a> {
    fn new(contacts: &'a [LoadedContact], com: &Vector3<f64>) -> Self {
        let length = lever(contacts, com);
        let mut columns = Vec::new();
        let mut starts = vec![0];
        for (contact, c) in contacts.iter().enumerate() {
            columns.push(Column { contact, row: None, wrench: c.normal_wrench(com, length) });
            for (row, &mu) in c.active_friction().iter().enumerate() {
                if mu > 0.0 {
                    columns.push(Column { contact, row: Some(row), wrench: c.friction_wrench(row, com, length) * mu });
                }
            }
            starts.push(columns.len());
        }
        Balance { contacts, columns, starts, length }
    }

    /// Size of a wrench \[N\], its torque over the length.
    fn size(&self, wrench: &Vector6<f64>) -> f64 {
        self.scaled(wrench).norm()
    }

    fn scaled(&self, wrench: &Vector6<f64>) -> Vector6<f64> {
        let torque = wrench.fixed_rows::<3>(3) / self.length;
        stack(&wrench.fixed_rows::<3>(0).into(), &torque)
    }

    fn full_rank(&self) -> bool {
        let gram: Matrix6<f64> = self.columns.iter().map(|c| c.wrench * c.wrench.transpose()).sum();
        let values = gram.symmetric_eigenvalues();
        values.min() > RANK_TOLERANCE * RANK_TOLERANCE * values.max()
    }

    /// Forces that balance each other, their normal forces summing to at most 1, as deep in all cones as possible, and
    /// that depth.
    fn deepest(&self) -> Result<(Vec<f64>, f64), SolverFault> {
        self.solve(&Vector6::zeros(), 1.0, &Bound::Sum)
    }

    /// Forces \[N\] that balance the largest multiple of `external`, and that multiple: unlimited, with normal forces
    /// summing to at most 1 N, else within the live ones.
    fn heaviest(&self, external: &Vector6<f64>, limit: NormalForces) -> Result<(Vec<f64>, f64), SolverFault> {
        let size = self.size(external);
        let direction = self.scaled(external) / size;
        match limit {
            NormalForces::Unlimited => {
                let (forces, load) = self.solve(&direction, 0.0, &Bound::Sum)?;
                Ok((forces, load / size))
            }
            NormalForces::Live => {
                let live = || self.contacts.iter().map(|c| c.normal_force);
                let unit = live().fold(0.0, f64::max);
                if unit <= 0.0 {
                    return Ok((vec![0.0; self.columns.len()], 0.0));
                }
                let bounds = Bound::Each(live().map(|f| f / unit).collect());
                let (mut forces, load) = self.solve(&direction, 0.0, &bounds)?;
                forces.iter_mut().for_each(|f| *f *= unit);
                Ok((forces, load * unit / size))
            }
        }
    }

    /// Maximises s so that the forces y balance `s direction`, lie at least `s depth` within their cones, and keep the
    /// bound. Returns y and s >= 0.
    fn solve(&self, direction: &Vector6<f64>, depth: f64, bound: &Bound) -> Result<(Vec<f64>, f64), SolverFault> {
        let contacts = self.contacts.len();
        if contacts == 0 {
            return Ok((Vec::new(), 0.0));
        }
        let last = self.columns.len();
        let mut program = Program::new(last + 1);
        for axis in 0..6 {
            for (j, column) in self.columns.iter().enumerate() {
                program.entry(j, column.wrench[axis]);
            }
            program.entry(last, direction[axis]);
            program.end_row(0.0);
        }
        program.cone(ZeroConeT(6));
        for span in self.starts.windows(2) {
            program.entry(span[0], -1.0);
            program.entry(last, depth);
            program.end_row(0.0);
            for j in span[0] + 1..span[1] {
                program.entry(j, -1.0);
                program.end_row(0.0);
            }
            program.cone(match span[1] - span[0] {
                1 => NonnegativeConeT(1),
                rows => SecondOrderConeT(rows),
            });
        }
        match bound {
            Bound::Sum => {
                for &start in &self.starts[..contacts] {
                    program.entry(start, 1.0);
                }
                program.end_row(1.0);
                program.cone(NonnegativeConeT(1));
            }
            Bound::Each(bounds) => {
                for (&start, &most) in self.starts.iter().zip(bounds) {
                    program.entry(start, 1.0);
                    program.end_row(most);
                }
                program.cone(NonnegativeConeT(contacts));
            }
        }
        // s >= 0: s = 0 with no forces is always a solution.
        program.entry(last, -1.0);
        program.end_row(0.0);
        program.cone(NonnegativeConeT(1));
        let (mut x, status) =
            program.maximise(last).map_err(|e| SolverFault::Refused { contacts, reason: e.to_string() })?;
        let best = x.pop().unwrap_or(f64::NAN);
        let residual = self.residual(&x, best, direction, depth);
        let stopped = !matches!(status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        if stopped || residual.is_nan() || residual > RESIDUAL {
            return Err(SolverFault::Unsolved { contacts, status: format!("{status:?}"), residual });
        }
        Ok((x, best.max(0.0)))
    }

    /// Largest violation of the balance and of the cones by `y` and `s`.
    fn residual(&self, y: &[f64], s: f64, direction: &Vector6<f64>, depth: f64) -> f64 {
        let wrench: Vector6<f64> = self.columns.iter().zip(y).map(|(c, f)| c.wrench * *f).sum();
        let unbalanced = (wrench + direction * s).norm();
        self.starts
            .windows(2)
            .map(|span| {
                let friction = y[span[0] + 1..span[1]].iter().map(|f| f * f).sum::<f64>();
                friction.sqrt() - (y[span[0]] - s * depth)
            })
            .fold(unbalanced, f64::max)
    }

    /// World forces of the solution `y` times `factor`.
    fn forces(&self, y: &[f64], factor: f64) -> Vec<BalancingForce> {
        let mut forces =
            vec![BalancingForce { force: Vector3::zeros(), torque: Vector3::zeros() }; self.contacts.len()];
        for (column, value) in self.columns.iter().zip(y) {
            let c = &self.contacts[column.contact];
            let out = &mut forces[column.contact];
            let value = value * factor;
            match column.row {
                None => out.force += c.normal * value,
                Some(row @ (0 | 1)) => out.force += c.tangents[row] * (c.friction[row] * value),
                Some(2) => out.torque += c.normal * (c.friction[2] * value),
                Some(row) => out.torque += c.tangents[row - 3] * (c.friction[row] * value),
            }
        }
        forces
    }
}

/// What keeps the program bounded.
enum Bound {
    /// Normal forces sum to at most 1.
    Sum,
    /// Each normal force has its own bound.
    Each(Vec<f64>),
}

/// A length \[m\] that makes torques comparable to forces: the largest distance of a contact from the centre of mass.
fn lever(contacts: &[LoadedContact], com: &Vector3<f64>) -> f64 {
    let longest = contacts.iter().map(|c| (c.position - com).norm()).fold(0.0, f64::max);
    if inverse(longest).is_normal() { longest } else { 1.0 }
}
