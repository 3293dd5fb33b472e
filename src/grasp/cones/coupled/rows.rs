//! The rows of the engine's constraints, read.

use super::{CoupledConstraint, CoupledConstraints, Jacobian, Owner, along};
use crate::grasp::contact::cost::Cost;
use crate::mujoco::{Cone, Error, RowKind, Simulation};

impl CoupledConstraints {
    /// Reads the constraint that begins at `row`; returns its number of rows in the engine.
    pub(super) fn read_one(&mut self, sim: &Simulation, row: usize, gives: bool) -> Result<usize, Error> {
        let identity = sim.constraint_row(row)?;
        let first = self.bias.len();
        let (support, entries) = (self.support.len(), self.entries.len());
        let mut single = None;
        let stiffness = sim.efc_D()[row];
        let element = Owner::Element(identity.kind.raw(), identity.id);
        let (cost, owner, rows, read) = match identity.kind {
            RowKind::ContactElliptic | RowKind::ContactPyramidal => {
                let contact = sim.contact(identity.id)?;
                let dim = contact.condim;
                let [a, b] = contact.geoms.map(|g| g.index());
                let nth = |n: &CoupledConstraint| matches!(n.owner, Owner::Geoms(c, d, _) if (c, d) == (a, b));
                let owner = Owner::Geoms(a, b, self.list.iter().filter(|n| nth(n)).count());
                if sim.model().cone() == Cone::Elliptic {
                    self.copy_rows(sim, row, dim)?;
                    let cone = contact.friction[0] * (sim.efc_R()[row + 1] / sim.efc_R()[row]).sqrt();
                    (Cost::Elliptic { stiffness, cone, friction: contact.friction }, owner, dim, dim)
                } else {
                    self.combine_edges(sim, row, dim, &contact.friction)?;
                    (Cost::Pyramidal { stiffness, friction: contact.friction }, owner, dim, 2 * (dim - 1))
                }
            }
            kind => {
                // a row of a weld may pass for a friction loss
                single = if gives { None } else { sim.row_single_entry(row)? };
                match single {
                    Some((dof, value)) => self.bias.push(value * sim.qacc_smooth()[dof] - sim.efc_aref()[row]),
                    None => self.copy_rows(sim, row, 1)?,
                }
                let cost = match kind {
                    RowKind::Equality => Cost::Bounded { centre: 0.0, stiffness, limit: f64::INFINITY },
                    RowKind::FrictionDof | RowKind::FrictionTendon => {
                        Cost::Bounded { centre: 0.0, stiffness, limit: sim.efc_frictionloss()[row] }
                    }
                    _ => Cost::Unilateral { stiffness },
                };
                (cost, element, 1, 1)
            }
        };
        let jacobian = single
            .map_or(Jacobian::Rows { support: (support, self.support.len()), entries }, |(dof, value)| {
                Jacobian::Single(dof, value)
            });
        // as a rule in the same place as in the last step
        let same = |n: &&CoupledConstraint| n.owner == owner && n.rows == rows;
        let before = self.before.get(self.list.len()).filter(same).or_else(|| self.before.iter().find(same));
        let mut constraint =
            CoupledConstraint { cost, first, jacobian, gives, row, ..CoupledConstraint::new(owner, rows) };
        if let Some(n) = before {
            (constraint.main, constraint.force, constraint.active_sets) = (n.main, n.force, n.active_sets);
        }
        self.list.push(constraint);
        Ok(read)
    }

    /// Copies rows of one constraint, as many as are counted from `row` on.
    fn copy_rows(&mut self, sim: &Simulation, row: usize, count: usize) -> Result<(), Error> {
        let CoupledConstraints { support, entries, bias, dense, is_before: before, .. } = self;
        let nv = sim.model().nv();
        dense.resize(dense.len().max(nv * count), 0.0);
        for (k, out) in dense.chunks_exact_mut(nv.max(1)).take(count).enumerate() {
            sim.row_jacobian(row + k, out)?;
        }
        let first = support.len();
        before.clear();
        before.resize(nv, false);
        for dof in (0..nv).rev() {
            if before[dof] || (0..count).any(|k| dense[k * nv + dof] != 0.0) {
                support.push(dof);
                if let Ok(parent) = usize::try_from(sim.model().dof_parentid()[dof]) {
                    before[parent] = true;
                }
            }
        }
        let support = &support[first..];
        for k in 0..count {
            let at = entries.len();
            entries.extend(support.iter().map(|&dof| dense[k * nv + dof]));
            bias.push(along(support, &entries[at..], sim.qacc_smooth()) - sim.efc_aref()[row + k]);
        }
        Ok(())
    }

    /// From a pyramid's edges `n +- mu_j t_j`, two for each `j`, to the rows `n, t_1, t_2, ..`.
    fn combine_edges(&mut self, sim: &Simulation, row: usize, dim: usize, friction: &[f64; 5]) -> Result<(), Error> {
        let (j0, b0, s0) = (self.entries.len(), self.bias.len(), self.support.len());
        self.copy_rows(sim, row, 2 * (dim - 1))?;
        let n = self.support.len() - s0;
        // in place from the front: rows 0 and 1 become normal and first tangent, then rows 2j, 2j + 1 the next tangent
        for (j, mu) in friction.iter().take(dim - 1).enumerate() {
            let half = 0.5 / mu;
            for k in 0..n {
                let (plus, minus) = (self.entries[j0 + 2 * j * n + k], self.entries[j0 + (2 * j + 1) * n + k]);
                if j == 0 {
                    self.entries[j0 + k] = 0.5 * (plus + minus);
                }
                self.entries[j0 + (j + 1) * n + k] = half * (plus - minus);
            }
            let (plus, minus) = (self.bias[b0 + 2 * j], self.bias[b0 + 2 * j + 1]);
            if j == 0 {
                self.bias[b0] = 0.5 * (plus + minus);
            }
            self.bias[b0 + j + 1] = half * (plus - minus);
        }
        self.entries.truncate(j0 + dim * n);
        self.bias.truncate(b0 + dim);
        Ok(())
    }
}
