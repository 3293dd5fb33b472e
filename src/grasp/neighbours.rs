//! The engine's constraint rows besides the grasp's own contacts: equalities, friction losses, limits, other contacts.
//!
//! Where they move with hand or target they are solved together with the grasp (see [`super::branches`]), in the same two
//! passes as the engine: first all with their softness, then, if the engine has a noslip pass, friction at fixed normals.
//! The contacts of other latched grasps join them as guests (see [`guests`]).

use super::cone::{Law, MAX_ROWS, Zone, pyramid_pairs};
use super::contacts::GraspContact;
use crate::mujoco::{Cone, Error, RowKind, RowState, Simulation};
use std::ops::Range;

mod guests;

/// One constraint that is not the grasp's own.
#[derive(Clone, Debug)]
pub struct Neighbour {
    /// Its law with the engine's softness.
    pub law: Law,
    /// Number of its rows: one, or a contact's normal, tangents, spin and rolling.
    pub rows: usize,
    /// First of its rows in [`Neighbours::jacobian`].
    pub first: usize,
    /// Force of each row in the pass with soft contacts; before the solve, of the last step.
    pub main: [f64; MAX_ROWS],
    /// Force of each row in the end.
    pub force: [f64; MAX_ROWS],
    /// Where its law stood in either pass.
    pub zones: [Zone; 2],
    /// Normal force of each pair of a pyramid's edges.
    pairs: [f64; 5],
    /// True of a row of another grasp's weld: it gives way in both passes, since it is solved by its softness.
    pub gives: bool,
    /// True once it has been solved together with the grasp.
    solved: bool,
    /// Its first row in the engine; a guest has none.
    row: usize,
    owner: Owner,
}

/// What a constraint hands on to the next step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Past {
    owner: Owner,
    rows: usize,
    main: [f64; MAX_ROWS],
    force: [f64; MAX_ROWS],
    zones: [Zone; 2],
}

/// What the rows belong to, from step to step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
enum Owner {
    /// Type of row and number of the equality, joint, tendon or degree of freedom.
    Element(i32, usize),
    /// Two geoms, and how many contacts of the same two come before.
    Geoms(usize, usize, usize),
    /// Another grasp's contact, by its number among the guests.
    Guest(usize),
}

/// All of them in one step. Buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    list: Vec<Neighbour>,
    before: Vec<Neighbour>,
    jacobian: Vec<f64>,
    bias: Vec<f64>,
    friction_pass: bool,
    guests: Vec<GraspContact>,
}

impl Neighbours {
    /// Reads the engine's current rows, `welds` among them being those of merged grasps; after its smooth acceleration is
    /// known.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn read(&mut self, sim: &Simulation, welds: &Range<usize>) -> Result<(), Error> {
        std::mem::swap(&mut self.list, &mut self.before);
        self.list.clear();
        self.jacobian.clear();
        self.bias.clear();
        self.guests.clear();
        self.friction_pass = sim.model().noslip_iterations() > 0;
        let mut row = 0;
        while row < sim.nefc() {
            row += self.read_one(sim, row, welds.contains(&row))?;
        }
        Ok(())
    }

    /// Forgets the last step's forces: this grasp has not solved its neighbours in it, or was released.
    pub fn forget(&mut self) {
        self.list.clear();
        self.guests.clear();
    }

    /// What the next step remembers, into `out`.
    pub(super) fn save_into(&self, out: &mut Vec<Past>) {
        out.clear();
        out.extend(self.list.iter().filter(|n| n.guest().is_none()).map(|n| Past {
            owner: n.owner,
            rows: n.rows,
            main: n.main,
            force: n.force,
            zones: n.zones,
        }));
    }

    /// The next step remembers `past`.
    pub(super) fn restore(&mut self, past: &[Past]) {
        self.list.clear();
        self.list.extend(past.iter().map(Past::constraint));
    }

    /// The constraints of this step.
    pub fn list(&self) -> &[Neighbour] {
        &self.list
    }

    /// Number of the engine's rows that were solved together with the grasp.
    pub fn solved_rows(&self) -> usize {
        self.list.iter().filter(|n| n.solved).map(Neighbour::engine_rows).sum()
    }

    /// Writes the forces of the constraints that were solved together with the grasp.
    pub fn write_forces(&self, sim: &mut Simulation) {
        for neighbour in self.list.iter().filter(|n| n.solved && n.guest().is_none()) {
            neighbour.write_force(sim);
        }
    }

    /// Row `row`, one entry for each degree of freedom.
    pub fn jacobian(&self, row: usize, nv: usize) -> &[f64] {
        &self.jacobian[row * nv..(row + 1) * nv]
    }

    /// `J qacc_smooth - aref` of each row.
    pub fn bias(&self) -> &[f64] {
        &self.bias
    }

    /// Takes the result of the pass with soft contacts for constraint `i`, its force and where its law stands at the
    /// residual `jar`, and gives its law for the friction pass and where that is expected to stand. `resistance` is the
    /// proximal one of its first friction row. What has no part in the friction pass keeps its force.
    pub fn end_main_pass(
        &mut self,
        i: usize,
        (force, zone): (&[f64; MAX_ROWS], Zone),
        jar: &[f64],
        resistance: f64,
    ) -> (Law, Zone) {
        let friction_pass = self.friction_pass;
        let n = &mut self.list[i];
        n.solved = true;
        // friction starts from that of the first pass, corrected as in the last step
        let start: [f64; MAX_ROWS] = std::array::from_fn(|row| force[row] + n.force[row] - n.main[row]);
        (n.main, n.zones[0]) = (*force, zone);
        if let Law::Pyramidal { stiffness, friction } = n.law {
            n.pairs = pyramid_pairs(jar, stiffness, &friction);
        }
        n.force = *force;
        if n.gives {
            return (n.law, zone);
        }
        let mut centre = [0.0; 5];
        centre.copy_from_slice(&start[1..]);
        let law = match n.law {
            Law::Elliptic { friction, .. } if friction_pass => {
                Law::slip_ellipsoid(centre, resistance, friction, force[0])
            }
            Law::Pyramidal { friction, .. } if friction_pass => Law::slip_box(centre, resistance, friction, n.pairs),
            Law::Bounded { limit, .. } if friction_pass && limit.is_finite() => {
                Law::Bounded { centre: start[0], stiffness: 1.0 / resistance, limit }
            }
            _ => Law::Still,
        };
        (law, n.zones[1])
    }

    /// Takes the result of the friction pass for the rows that its law governs, from row `first` on.
    pub fn end_friction_pass(&mut self, i: usize, first: usize, force: &[f64; MAX_ROWS], zone: Zone) {
        let n = &mut self.list[i];
        n.force[first..].copy_from_slice(&force[..MAX_ROWS - first]);
        n.zones[1] = zone;
    }

    /// Reads the constraint that begins at `row`; returns its number of rows in the engine.
    fn read_one(&mut self, sim: &Simulation, row: usize, gives: bool) -> Result<usize, Error> {
        let identity = sim.constraint_row(row)?;
        let first = self.bias.len();
        let stiffness = sim.efc_D()[row];
        let element = Owner::Element(identity.kind.raw(), identity.id);
        let (law, owner, rows, read) = match identity.kind {
            RowKind::ContactElliptic | RowKind::ContactPyramidal => {
                let contact = sim.contact(identity.id)?;
                let dim = contact.condim;
                let [a, b] = contact.geoms.map(|g| g.index());
                let nth = |n: &Neighbour| matches!(n.owner, Owner::Geoms(c, d, _) if (c, d) == (a, b));
                let owner = Owner::Geoms(a, b, self.list.iter().filter(|n| nth(n)).count());
                if sim.model().cone() == Cone::Elliptic {
                    self.copy_rows(sim, row, dim)?;
                    let cone = contact.friction[0] * (sim.efc_R()[row + 1] / sim.efc_R()[row]).sqrt();
                    (Law::Elliptic { stiffness, cone, friction: contact.friction }, owner, dim, dim)
                } else {
                    self.combine_edges(sim, row, dim, &contact.friction)?;
                    (Law::Pyramidal { stiffness, friction: contact.friction }, owner, dim, 2 * (dim - 1))
                }
            }
            kind => {
                self.copy_rows(sim, row, 1)?;
                let law = match kind {
                    RowKind::Equality => Law::Bounded { centre: 0.0, stiffness, limit: f64::INFINITY },
                    RowKind::FrictionDof | RowKind::FrictionTendon => {
                        Law::Bounded { centre: 0.0, stiffness, limit: sim.efc_frictionloss()[row] }
                    }
                    _ => Law::Unilateral { stiffness },
                };
                (law, element, 1, 1)
            }
        };
        let before = self.before.iter().find(|n| n.owner == owner && n.rows == rows);
        let nothing = [0.0; MAX_ROWS];
        let (main, force, zones) = before.map_or((nothing, nothing, [Zone::Stick; 2]), |n| (n.main, n.force, n.zones));
        let (pairs, solved) = ([0.0; 5], false);
        self.list.push(Neighbour { law, rows, first, main, force, zones, pairs, gives, solved, row, owner });
        Ok(read)
    }

    fn copy_rows(&mut self, sim: &Simulation, row: usize, count: usize) -> Result<(), Error> {
        let nv = sim.model().nv();
        for k in row..row + count {
            let at = self.jacobian.len();
            self.jacobian.resize(at + nv, 0.0);
            sim.row_jacobian(k, &mut self.jacobian[at..])?;
            let smooth = super::dense::dot(&self.jacobian[at..], sim.qacc_smooth());
            self.bias.push(smooth - sim.efc_aref()[k]);
        }
        Ok(())
    }

    /// From a pyramid's edges `n +- mu_j t_j`, two for each `j`, to the rows `n, t_1, t_2, ..`.
    fn combine_edges(&mut self, sim: &Simulation, row: usize, dim: usize, friction: &[f64; 5]) -> Result<(), Error> {
        let nv = sim.model().nv();
        let (j0, b0) = (self.jacobian.len(), self.bias.len());
        self.copy_rows(sim, row, 2 * (dim - 1))?;
        // in place from the front: rows 0 and 1 become normal and first tangent, then rows 2j, 2j + 1 the next tangent
        for (j, mu) in friction.iter().take(dim - 1).enumerate() {
            let half = 0.5 / mu;
            for k in 0..nv {
                let (plus, minus) = (self.jacobian[j0 + 2 * j * nv + k], self.jacobian[j0 + (2 * j + 1) * nv + k]);
                if j == 0 {
                    self.jacobian[j0 + k] = 0.5 * (plus + minus);
                }
                self.jacobian[j0 + (j + 1) * nv + k] = half * (plus - minus);
            }
            let (plus, minus) = (self.bias[b0 + 2 * j], self.bias[b0 + 2 * j + 1]);
            if j == 0 {
                self.bias[b0] = 0.5 * (plus + minus);
            }
            self.bias[b0 + j + 1] = half * (plus - minus);
        }
        self.jacobian.truncate(j0 + dim * nv);
        self.bias.truncate(b0 + dim);
        Ok(())
    }
}

impl Past {
    /// A constraint that has this to remember, and no part in any solve.
    fn constraint(&self) -> Neighbour {
        let Past { owner, rows, main, force, zones } = *self;
        let (law, pairs) = (Law::Still, [0.0; 5]);
        Neighbour { law, rows, first: 0, main, force, zones, pairs, gives: false, solved: false, row: 0, owner }
    }

    /// The geoms that it names, if it is a contact.
    pub(super) fn geoms(&self) -> Option<(usize, usize)> {
        match self.owner {
            Owner::Element(..) | Owner::Guest(_) => None,
            Owner::Geoms(a, b, _) => Some((a, b)),
        }
    }

    /// True if its rows are those of one constraint and every number is finite.
    pub(super) fn is_sound(&self) -> bool {
        (1..=MAX_ROWS).contains(&self.rows) && self.main.iter().chain(&self.force).all(|x| x.is_finite())
    }
}

impl Neighbour {
    /// Number among the guests, of another grasp's contact.
    pub fn guest(&self) -> Option<usize> {
        if let Owner::Guest(number) = self.owner { Some(number) } else { None }
    }

    /// Number of its rows in the engine, where a pyramid has a row for each edge.
    fn engine_rows(&self) -> usize {
        if self.guest().is_some() {
            0
        } else if matches!(self.law, Law::Pyramidal { .. }) {
            2 * (self.rows - 1)
        } else {
            self.rows
        }
    }

    fn write_force(&self, sim: &mut Simulation) {
        let rows = self.row..self.row + self.engine_rows();
        match self.law {
            Law::Pyramidal { friction, .. } => {
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
            let state = match (self.law, self.zones[0]) {
                (Law::Elliptic { .. }, Zone::Slide) => RowState::Cone,
                (Law::Bounded { limit, .. }, _) if force >= limit => RowState::AtUpperLimit,
                (Law::Bounded { limit, .. }, _) if force <= -limit => RowState::AtLowerLimit,
                (Law::Bounded { .. }, _) => RowState::Quadratic,
                _ if force == 0.0 => RowState::Satisfied,
                _ => RowState::Quadratic,
            };
            sim.efc_state_mut()[row] = state.raw();
        }
    }
}
