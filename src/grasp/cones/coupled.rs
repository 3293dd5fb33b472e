//! The engine's constraint rows besides the grasp's own contacts: equalities, friction losses, limits, other contacts.
//!
//! Where they move with hand or target they are solved together with the grasp (see [`crate::grasp::cones::joint_groups`]), in the same two
//! passes as the engine: first all with their softness, then, if the engine has a noslip pass, friction at fixed normals.
//! The contacts of other latched grasps join them as foreign (see [`foreign`]).

use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::contact::contacts::{GraspContact, Turning};
use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS, pyramid_pairs};
use crate::grasp::contact::softness::SolverOptions;
use crate::mujoco::{Error, RowState, Simulation};
use std::ops::Range;

mod foreign;
mod rows;
mod saved;

pub(in crate::grasp) use saved::SavedConstraint;

/// One constraint that is not the grasp's own.
#[derive(Clone, Debug)]
pub struct CoupledConstraint {
    /// Its cost with the engine's softness.
    pub cost: Cost,
    /// Number of its rows: one, or a contact's normal, tangents, spin and rolling.
    pub rows: usize,
    /// First of its rows in [`CoupledConstraints::bias`].
    pub first: usize,
    /// What it moves.
    pub jacobian: Jacobian,
    /// Force of each row in the pass with soft contacts; before the solve, of the last step.
    pub main: [f64; MAX_ROWS],
    /// Force of each row in the end.
    pub force: [f64; MAX_ROWS],
    /// Where its cost stood in either pass.
    pub active_sets: [ActiveSet; 2],
    /// Normal force of each pair of a pyramid's edges.
    pairs: [f64; 5],
    /// True of a row of another grasp's weld: it gives way in both passes, since it is solved by its softness.
    pub gives: bool,
    /// True once it has been solved together with the grasp.
    solved: bool,
    /// Its first row in the engine; a foreign has none.
    row: usize,
    owner: Owner,
}

/// The rows of a constraint over the degrees of freedom.
#[derive(Clone, Copy, Debug)]
pub enum Jacobian {
    /// One row with one entry: degree of freedom and entry. Joint limits and friction losses are that.
    Single(usize, f64),
    /// Rows over these of [`CoupledConstraints::support`], with their entries from here on.
    Rows { support: (usize, usize), entries: usize },
}

/// What the rows belong to, from step to step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
enum Owner {
    /// Type of row and number of the equality, joint, tendon or degree of freedom.
    Element(i32, usize),
    /// Two geoms, and how many contacts of the same two come before.
    Geoms(usize, usize, usize),
    /// Another grasp's contact, by its number among the foreign.
    Foreign(usize),
}

/// All of them in one step. Buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct CoupledConstraints {
    list: Vec<CoupledConstraint>,
    before: Vec<CoupledConstraint>,
    /// Degrees of freedom that the rows of each constraint move, and all before them; each list from the last to the first.
    support: Vec<usize>,
    /// The rows' entries there.
    entries: Vec<f64>,
    bias: Vec<f64>,
    /// Rows over all degrees of freedom, and whether each of these is before one that is moved.
    dense: Vec<f64>,
    is_before: Vec<bool>,
    friction_pass: bool,
    /// No other solve takes what does not move with this grasp.
    alone: bool,
    foreign: Vec<GraspContact>,
    /// In a frozen step.
    turning: Turning,
}

impl CoupledConstraints {
    /// Reads the engine's current rows, `welds` among them being those of merged grasps; after its smooth acceleration is
    /// known. `alone`: no other grasp is latched.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn read(&mut self, sim: &Simulation, welds: &Range<usize>, alone: bool) -> Result<(), Error> {
        self.alone = alone;
        std::mem::swap(&mut self.list, &mut self.before);
        self.list.clear();
        self.support.clear();
        self.entries.clear();
        self.bias.clear();
        self.foreign.clear();
        self.friction_pass = sim.model().noslip_iterations() > 0;
        let mut row = 0;
        while row < sim.nefc() {
            row += self.read_one(sim, row, welds.contains(&row))?;
        }
        Ok(())
    }

    /// The same rows one step on frozen geometry later: their biases.
    pub fn resume(&mut self, sim: &Simulation, dynamics: &Dynamics<'_>, options: &SolverOptions) {
        let (reference, acceleration) = (sim.efc_aref(), sim.qacc_smooth());
        let CoupledConstraints { list, support, entries, bias, foreign, turning, .. } = self;
        turning.forget();
        for n in list {
            n.solved = false;
            let bias = &mut bias[n.first..n.first + n.rows];
            let (support, entries) = match n.jacobian {
                Jacobian::Single(dof, value) => {
                    bias[0] = value * acceleration[dof] - reference[n.row];
                    continue;
                }
                Jacobian::Rows { support: (start, end), entries: first } => (&support[start..end], &entries[first..]),
            };
            for (k, bias) in bias.iter_mut().enumerate() {
                *bias = along(support, &entries[k * support.len()..], acceleration);
            }
            if let Some(number) = n.foreign() {
                foreign[number].resume_rows(dynamics, turning, options, bias);
                continue;
            }
            for (k, bias) in bias.iter_mut().enumerate() {
                *bias -= n.reference(reference, k);
            }
        }
    }

    /// Whether constraint `i`, which does not move with the grasp, may be solved with it, to leave the engine's solver nothing to
    /// do. Contacts elsewhere are the engine's, to whose accuracy the user has set it.
    pub fn takes(&self, i: usize) -> bool {
        self.alone && !matches!(self.list[i].cost, Cost::Elliptic { .. } | Cost::Pyramidal { .. })
    }

    /// The constraint that stands for foreign contact `number`.
    pub fn of_foreign(&self, number: usize) -> &CoupledConstraint {
        &self.list[self.list.len() - self.foreign.len() + number]
    }

    /// Forgets the last step's forces: this grasp has not solved its coupled in it, or was released.
    pub fn forget(&mut self) {
        self.list.clear();
        self.foreign.clear();
    }

    /// The constraints of this step.
    pub fn list(&self) -> &[CoupledConstraint] {
        &self.list
    }

    /// Number of the engine's rows that were solved together with the grasp.
    pub fn solved_rows(&self) -> usize {
        self.list.iter().filter(|n| n.solved).map(CoupledConstraint::engine_rows).sum()
    }

    /// Writes the forces of the constraints that were solved together with the grasp.
    pub fn write_forces(&self, sim: &mut Simulation) {
        for constraint in self.list.iter().filter(|n| n.solved && n.foreign().is_none()) {
            constraint.write_force(sim);
        }
    }

    /// The degrees of freedom that the rows of a constraint move, and all before them, from the last to the first; none of a
    /// [`Jacobian::Single`].
    pub fn support(&self, constraint: &CoupledConstraint) -> &[usize] {
        let Jacobian::Rows { support: (start, end), .. } = constraint.jacobian else { return &[] };
        &self.support[start..end]
    }

    /// The entries of row `k` of a constraint, one for each of its [support](Self::support).
    pub fn row(&self, constraint: &CoupledConstraint, k: usize) -> &[f64] {
        let Jacobian::Rows { support: (start, end), entries } = constraint.jacobian else { return &[] };
        let n = end - start;
        &self.entries[entries + k * n..entries + (k + 1) * n]
    }

    /// `J qacc_smooth - aref` of each row.
    pub fn bias(&self) -> &[f64] {
        &self.bias
    }

    /// Takes the result of the pass with soft contacts for constraint `i`, its force and where its cost stands at the
    /// residual `jar`, and gives its cost for the friction pass and where that is expected to stand. `resistance` is the
    /// proximal one of its first friction row. What has no part in the friction pass keeps its force.
    pub fn end_main_pass(
        &mut self,
        i: usize,
        (force, active_set): (&[f64; MAX_ROWS], ActiveSet),
        jar: &[f64],
        resistance: f64,
    ) -> (Cost, ActiveSet) {
        let friction_pass = self.friction_pass;
        let n = &mut self.list[i];
        n.solved = true;
        // friction starts from that of the first pass, corrected as in the last step
        let start: [f64; MAX_ROWS] = std::array::from_fn(|row| force[row] + n.force[row] - n.main[row]);
        (n.main, n.active_sets[0]) = (*force, active_set);
        if let Cost::Pyramidal { stiffness, friction } = n.cost {
            n.pairs = pyramid_pairs(jar, stiffness, &friction);
        }
        n.force = *force;
        if n.gives {
            return (n.cost, active_set);
        }
        let mut centre = [0.0; 5];
        centre.copy_from_slice(&start[1..]);
        let cost = match n.cost {
            Cost::Elliptic { friction, .. } if friction_pass => {
                Cost::slip_ellipsoid(centre, resistance, friction, force[0])
            }
            Cost::Pyramidal { friction, .. } if friction_pass => Cost::slip_box(centre, resistance, friction, n.pairs),
            Cost::Bounded { limit, .. } if friction_pass && limit.is_finite() => {
                Cost::Bounded { centre: start[0], stiffness: 1.0 / resistance, limit }
            }
            _ => Cost::Still,
        };
        (cost, n.active_sets[1])
    }

    /// How many of the first rows of constraint `i` keep the force of the pass with soft contacts in the friction pass.
    pub fn kept_rows(&self, i: usize) -> usize {
        let n = &self.list[i];
        match n.cost {
            _ if n.gives => 0,
            Cost::Elliptic { .. } | Cost::Pyramidal { .. } if self.friction_pass => 1,
            Cost::Bounded { limit, .. } if self.friction_pass && limit.is_finite() => 0,
            _ => n.rows,
        }
    }

    /// As [`end_friction_pass`](Self::end_friction_pass), of a row on one joint.
    pub fn end_single_friction_pass(&mut self, i: usize, force: f64, active_set: ActiveSet) {
        if self.kept_rows(i) == 0 {
            let n = &mut self.list[i];
            (n.force[0], n.active_sets[1]) = (force, active_set);
        }
    }

    /// Takes the result of the friction pass for the rows that its cost governs, from row `first` on.
    pub fn end_friction_pass(&mut self, i: usize, first: usize, force: &[f64; MAX_ROWS], active_set: ActiveSet) {
        let n = &mut self.list[i];
        n.force[first..].copy_from_slice(&force[..MAX_ROWS - first]);
        n.active_sets[1] = active_set;
    }
}

/// What `entries` of a row over the degrees of freedom of `support` make of `vector`, which is over all.
fn along(support: &[usize], entries: &[f64], vector: &[f64]) -> f64 {
    support.iter().zip(entries).map(|(&dof, entry)| entry * vector[dof]).sum()
}

impl CoupledConstraint {
    /// One with nothing to remember, and no part in any solve.
    fn new(owner: Owner, rows: usize) -> Self {
        CoupledConstraint {
            cost: Cost::Still,
            rows,
            first: 0,
            jacobian: Jacobian::Rows { support: (0, 0), entries: 0 },
            main: [0.0; MAX_ROWS],
            force: [0.0; MAX_ROWS],
            active_sets: [ActiveSet::Stick; 2],
            pairs: [0.0; 5],
            gives: false,
            solved: false,
            row: 0,
            owner,
        }
    }

    /// Number among the foreign, of another grasp's contact.
    pub fn foreign(&self) -> Option<usize> {
        if let Owner::Foreign(number) = self.owner { Some(number) } else { None }
    }

    /// Number of its rows in the engine, where a pyramid has a row for each edge.
    fn engine_rows(&self) -> usize {
        if self.foreign().is_some() {
            0
        } else if matches!(self.cost, Cost::Pyramidal { .. }) {
            2 * (self.rows - 1)
        } else {
            self.rows
        }
    }

    /// Reference acceleration of row `k`, from those of the engine's rows.
    fn reference(&self, of_rows: &[f64], k: usize) -> f64 {
        let Cost::Pyramidal { friction, .. } = self.cost else { return of_rows[self.row + k] };
        let j = k.saturating_sub(1);
        let (plus, minus) = (of_rows[self.row + 2 * j], of_rows[self.row + 2 * j + 1]);
        if k == 0 { 0.5 * (plus + minus) } else { 0.5 / friction[j] * (plus - minus) }
    }

    fn write_force(&self, sim: &mut Simulation) {
        let rows = self.row..self.row + self.engine_rows();
        match self.cost {
            Cost::Pyramidal { friction, .. } => {
                let edges = sim.efc_force_mut()[rows.clone()].chunks_exact_mut(2);
                for (j, edge) in edges.enumerate() {
                    let along = self.force[j + 1] / friction[j];
                    edge.copy_from_slice(&[0.5 * (self.pairs[j] + along), 0.5 * (self.pairs[j] - along)]);
                }
            }
            _ => sim.efc_force_mut()[rows.clone()].copy_from_slice(&self.force[..self.rows]),
        }
        for row in rows {
            let force = sim.efc_force()[row];
            let state = match (self.cost, self.active_sets[0]) {
                (Cost::Elliptic { .. }, ActiveSet::Slide) => RowState::Cone,
                (Cost::Bounded { limit, .. }, _) if force >= limit => RowState::AtUpperLimit,
                (Cost::Bounded { limit, .. }, _) if force <= -limit => RowState::AtLowerLimit,
                (Cost::Bounded { .. }, _) => RowState::Quadratic,
                _ if force == 0.0 => RowState::Satisfied,
                _ => RowState::Quadratic,
            };
            sim.efc_state_mut()[row] = state.raw();
        }
    }
}
