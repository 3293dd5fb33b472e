//! The grasp solve: from contacts and the engine's state to the contact forces of this step.
//!
//! MuJoCo's own contact problem, reduced to the target's and the palm's few unknowns (design note "form 1"):
//!
//! 1. *Main*: the convex problem with MuJoCo's contact softness gives the normal forces.
//! 2. *Noslip*: with the normal forces fixed, friction is solved without softness, as MuJoCo's noslip pass does, but to
//!    convergence: a proximal step around the friction of the first pass, corrected as in the last step. A still grasp
//!    does not creep, and what the motion does not decide (several contacts on one link) is as the first pass has it.
//!
//! Other constraints that move with hand or target (neighbours), the contacts of other grasps among them, are part of
//! both passes.

use super::arrow::{Arrow, ROOT, RootVector, Status};
use super::branches::Branches;
use super::cone::{Law, MAX_ROWS, Zone, pyramid_pairs};
use super::contacts::{GraspContact, Memory};
use super::mobility::{Dynamics, Mobility, Spatial};
use super::neighbours::Neighbours;
use super::softness::{SolverOptions, softness};
use super::topology::Topology;

/// Proximal resistance of friction, relative to what the contact's own inertia resists. The error that it leaves in
/// one step is this fraction of the *change* of the friction force, and it is gone in the next.
const RESISTANCE: f64 = 1e-3;

/// The solver and its memory from step to step (warm start).
#[derive(Clone, Debug)]
pub struct GraspSolver {
    mobility: Mobility,
    branches: Branches,
    arrow: Arrow,
    /// What each of the arrow's blocks is.
    order: Vec<Member>,
    /// Whitened rows of one branch, one entry for each of its joints.
    own_rows: Vec<f64>,
    main: RootVector,
    noslip: RootVector,
    kept: Vec<f64>,
    start: Vec<f64>,
    laws: Vec<(Law, Zone)>,
}

/// What a block of the arrow stands for.
#[derive(Clone, Copy, Debug)]
enum Member {
    Contact(usize),
    Neighbour(usize),
    /// Another grasp's contact, by its number among the guests.
    Guest(usize),
}

/// Iterations of the two passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolveStatus {
    /// Pass with soft contacts.
    pub main: Status,
    /// Friction pass.
    pub noslip: Status,
}

impl GraspSolver {
    /// For the hand and target of `topology`.
    pub fn new(topology: &Topology, dof_parent: &[i32]) -> Self {
        GraspSolver {
            mobility: Mobility::new(topology, dof_parent),
            branches: Branches::new(topology, dof_parent),
            arrow: Arrow::default(),
            order: Vec::new(),
            own_rows: Vec::new(),
            main: [0.0; ROOT],
            noslip: [0.0; ROOT],
            kept: Vec::new(),
            start: Vec::new(),
            laws: Vec::new(),
        }
    }

    /// Forgets the warm start (after a latch, a reset or a restored state).
    pub fn reset(&mut self) {
        self.main = [0.0; ROOT];
        self.noslip = [0.0; ROOT];
    }

    /// Where the two passes start in the next step.
    pub(super) fn warm_start(&self) -> [RootVector; 2] {
        [self.main, self.noslip]
    }

    /// Sets where the two passes start in the next step.
    pub(super) fn set_warm_start(&mut self, [main, noslip]: [RootVector; 2]) {
        (self.main, self.noslip) = (main, noslip);
    }

    /// Computes the force of each contact, together with `neighbours`. What it was in the last step, its memory, is where
    /// the solve starts.
    pub fn solve(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &mut [GraspContact],
        neighbours: &mut Neighbours,
    ) -> SolveStatus {
        self.build(dynamics, topology, options, contacts, neighbours);
        let main = self.arrow.solve(&mut self.main);
        self.fix_normals(contacts, neighbours);
        let noslip = self.arrow.solve(&mut self.noslip);
        for (block, member) in self.order.iter().enumerate() {
            let response = self.arrow.response(block);
            let contact = match *member {
                Member::Contact(i) => &mut contacts[i],
                Member::Guest(i) => neighbours.guest_mut(i),
                Member::Neighbour(i) => {
                    if let Some(first) = first_governed(self.arrow.law(block)) {
                        neighbours.end_friction_pass(i, first, &response.force, response.zone);
                    }
                    continue;
                }
            };
            for j in 1..contact.parameters.condim {
                contact.force_rows[j] = response.force[j - 1];
            }
            contact.zones[1] = response.zone;
            contact.update_force();
        }
        SolveStatus { main, noslip }
    }

    /// Adds the generalised forces of all contacts to `out`: on the target, and against it on the links.
    pub fn add_forces(&self, dynamics: &Dynamics<'_>, topology: &Topology, contacts: &[GraspContact], out: &mut [f64]) {
        let (mut on_palm, mut on_target) = (Spatial::zeros(), Spatial::zeros());
        let target = dynamics.reference_point(topology.target());
        for c in contacts {
            on_target += c.wrench_about(&target);
            let on_link = -c.wrench_about(&dynamics.reference_point(c.link));
            on_palm += on_link;
            if let (Some(finger), Some(leaf)) = (c.finger, topology.leaf(c.link)) {
                self.mobility.fingers[finger].add_force(leaf, &on_link, out);
            }
        }
        for (body, wrench) in [(&self.mobility.palm, on_palm), (&self.mobility.target, on_target)] {
            for &dof in body.chain() {
                out[dof] += dynamics.axis(dof).dot(&wrench);
            }
        }
    }

    fn build(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
        neighbours: &Neighbours,
    ) {
        let palm = if topology.palm() == 0 { None } else { topology.leaf(topology.palm()) };
        self.mobility.palm.update(dynamics, palm);
        self.mobility.target.update(dynamics, topology.leaf(topology.target()));
        self.branches.form(dynamics, &self.mobility, contacts, neighbours);
        self.arrow.begin();
        self.order.clear();
        // without joints of their own blocks share nothing but the root
        for (i, contact) in contacts.iter().enumerate().filter(|(_, c)| c.finger.is_none()) {
            self.arrow.begin_branch();
            self.add_contact(dynamics, topology, options, (i, contact), None);
            self.arrow.end_branch(0, &[]);
        }
        for k in 0..self.branches.free().len() {
            self.arrow.begin_branch();
            self.add_neighbour(neighbours, self.branches.free()[k]);
            self.arrow.end_branch(0, &[]);
        }
        for k in 0..self.branches.count() {
            self.add_branch(dynamics, topology, options, contacts, neighbours, k);
        }
    }

    /// All contacts and neighbours of the joints that are eliminated together.
    fn add_branch(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        contacts: &[GraspContact],
        neighbours: &Neighbours,
        k: usize,
    ) {
        self.arrow.begin_branch();
        let joints = self.branches.joints(self.branches.branch(k));
        self.own_rows.clear();
        for n in 0..self.branches.branch(k).nodes.len() {
            let finger = self.branches.branch(k).nodes[n];
            if finger >= self.mobility.fingers.len() {
                continue;
            }
            self.mobility.fingers[finger].update(dynamics);
            let own = Own { finger, offset: self.branches.offset(finger), joints };
            for (i, contact) in contacts.iter().enumerate().filter(|(_, c)| c.finger == Some(finger)) {
                self.add_contact(dynamics, topology, options, (i, contact), Some(own));
            }
        }
        for n in 0..self.branches.branch(k).neighbours.len() {
            let branch = self.branches.branch(k);
            let i = branch.neighbours[n];
            let neighbour = &neighbours.list()[i];
            for row in neighbour.first..neighbour.first + neighbour.rows {
                let at = self.own_rows.len();
                self.own_rows.resize(at + joints, 0.0);
                self.branches.own_row(branch, row, &mut self.own_rows[at..]);
            }
            self.add_neighbour(neighbours, i);
        }
        self.arrow.end_branch(joints, &self.own_rows);
    }

    fn add_neighbour(&mut self, neighbours: &Neighbours, i: usize) {
        let neighbour = &neighbours.list()[i];
        let mut root_rows = [[0.0; ROOT]; MAX_ROWS];
        for (k, row) in root_rows.iter_mut().take(neighbour.rows).enumerate() {
            *row = *self.branches.root_row(neighbour.first + k);
        }
        let n = neighbour.rows;
        let bias = &neighbours.bias()[neighbour.first..neighbour.first + n];
        self.arrow.add_block(neighbour.law, neighbour.zones[0], &root_rows[..n], bias, &neighbour.main[..n]);
        self.order.push(neighbour.guest().map_or(Member::Neighbour(i), Member::Guest));
    }

    fn add_contact(
        &mut self,
        dynamics: &Dynamics<'_>,
        topology: &Topology,
        options: &SolverOptions,
        (index, contact): (usize, &GraspContact),
        own: Option<Own>,
    ) {
        let soft = softness(&contact.parameters, options);
        let Mobility { palm, target, fingers } = &self.mobility;
        let rows = contact.parameters.condim;
        let row0 = self.own_rows.len();
        if let Some(own) = own {
            self.own_rows.resize(row0 + rows * own.joints, 0.0);
        }
        let hand_point = dynamics.reference_point(contact.link);
        let target_point = dynamics.reference_point(topology.target());
        let hand_velocity = dynamics.velocity(contact.link);
        let target_velocity = dynamics.velocity(topology.target());
        let finger = own.zip(topology.leaf(contact.link)).map(|(own, leaf)| (&fingers[own.finger], own, leaf));
        let hand_acceleration =
            palm.smooth + finger.map_or_else(Spatial::zeros, |(f, _, leaf)| f.smooth_acceleration(dynamics, leaf));

        let mut root_rows = [[0.0; ROOT]; MAX_ROWS];
        let mut bias = [0.0; MAX_ROWS];
        for i in 0..rows {
            let on_hand = -contact.unit_wrench(i, &hand_point);
            let on_target = contact.unit_wrench(i, &target_point);
            let velocity = on_target.dot(&target_velocity) + on_hand.dot(&hand_velocity);
            let acceleration = on_target.dot(&target.smooth) + on_hand.dot(&hand_acceleration);
            bias[i] = acceleration + soft.damping * velocity;
            let on_palm = match finger {
                Some((finger, own, leaf)) => {
                    let start = row0 + i * own.joints + own.offset;
                    finger.row(dynamics, leaf, &on_hand, &mut self.own_rows[start..start + finger.len()])
                }
                None => on_hand,
            };
            let (y_palm, y_target) = (palm.factor.tr_mul(&on_palm), target.factor.tr_mul(&on_target));
            for k in 0..6 {
                root_rows[i][k] = y_palm[k];
                root_rows[i][k + 6] = y_target[k];
            }
        }
        bias[0] += soft.spring;
        let memory = contact.memory();
        let start = memory.map_or([0.0; MAX_ROWS], |m| m.main);
        let zone = memory.map_or(Zone::Stick, |m| m.zones[0]);
        self.arrow.add_block(soft.law, zone, &root_rows[..rows], &bias[..rows], &start[..rows]);
        self.order.push(Member::Contact(index));
    }

    /// Keeps the normal forces of the main pass and turns each block's law into friction under them.
    fn fix_normals(&mut self, contacts: &mut [GraspContact], neighbours: &mut Neighbours) {
        self.kept.clear();
        self.start.clear();
        self.laws.clear();
        for (block, member) in self.order.iter().enumerate() {
            let relaw = match *member {
                Member::Contact(i) => friction_of_contact(&self.arrow, block, &mut contacts[i]),
                Member::Guest(i) => friction_of_contact(&self.arrow, block, neighbours.guest_mut(i)),
                Member::Neighbour(i) => friction_of_neighbour(&self.arrow, block, neighbours, i),
            };
            let rows = self.arrow.residual(block).len();
            self.kept.extend_from_slice(&relaw.kept[..rows]);
            self.start.extend_from_slice(&relaw.start[..rows]);
            self.laws.push((relaw.law, relaw.zone));
        }
        let laws = &self.laws;
        self.arrow.continue_with(&self.kept, &self.start, |block| laws[block]);
    }
}

/// A block's part in the friction pass.
struct Relaw {
    law: Law,
    zone: Zone,
    /// Forces that stand.
    kept: [f64; MAX_ROWS],
    /// Forces at which the pass starts.
    start: [f64; MAX_ROWS],
}

fn resistance(arrow: &Arrow, block: usize, row: usize) -> f64 {
    (RESISTANCE * arrow.row_mobility(block, row)).max(f64::MIN_POSITIVE)
}

fn friction_of_contact(arrow: &Arrow, block: usize, contact: &mut GraspContact) -> Relaw {
    let rows = contact.parameters.condim;
    let response = *arrow.response(block);
    contact.force_rows = [0.0; MAX_ROWS];
    contact.force_rows[0] = response.force[0];
    contact.main = response.force;
    contact.solved = true;
    contact.zones[0] = response.zone;

    let mut centre = [0.0; 5];
    centre.copy_from_slice(&response.force[1..]);
    let zone = match contact.memory() {
        Some(Memory { correction: Some(correction), zones, .. }) => {
            centre.iter_mut().zip(correction).for_each(|(centre, correction)| *centre += correction);
            zones[1]
        }
        Some(Memory { friction, zones, .. }) => {
            centre = *friction;
            zones[1]
        }
        None => Zone::Stick,
    };
    let resistance = resistance(arrow, block, rows.min(2) - 1);
    let friction = contact.parameters.friction;
    let law = match *arrow.law(block) {
        Law::Pyramidal { stiffness, friction } => {
            let normals = pyramid_pairs(arrow.residual(block), stiffness, &friction);
            Law::slip_box(centre, resistance, friction, normals)
        }
        _ => Law::slip_ellipsoid(centre, resistance, friction, response.force[0]),
    };
    let (mut kept, mut start) = ([0.0; MAX_ROWS], [0.0; MAX_ROWS]);
    kept[0] = response.force[0];
    start[1..rows].copy_from_slice(&centre[..rows - 1]);
    Relaw { law, zone, kept, start }
}

fn friction_of_neighbour(arrow: &Arrow, block: usize, neighbours: &mut Neighbours, i: usize) -> Relaw {
    let response = arrow.response(block);
    let jar = arrow.residual(block);
    let rows = jar.len();
    let resistance = resistance(arrow, block, rows.min(2) - 1);
    let (law, zone) = neighbours.end_main_pass(i, (&response.force, response.zone), jar, resistance);
    if neighbours.list()[i].gives {
        return Relaw { law, zone, kept: [0.0; MAX_ROWS], start: response.force };
    }
    let (mut kept, mut start) = (response.force, [0.0; MAX_ROWS]);
    if let Some(first) = first_governed(&law) {
        kept[first..].fill(0.0);
        match law {
            Law::Slip { centre, .. } => start[1..].copy_from_slice(&centre),
            Law::Bounded { centre, .. } => start[0] = centre,
            _ => {}
        }
    }
    Relaw { law, zone, kept, start }
}

/// First row that a law of the friction pass governs; the rows before it, or all, keep the force of the first pass.
fn first_governed(law: &Law) -> Option<usize> {
    match law {
        Law::Slip { .. } => Some(1),
        Law::Bounded { .. } => Some(0),
        _ => None,
    }
}

/// Where a contact's finger stands among the joints of its branch.
#[derive(Clone, Copy)]
struct Own {
    finger: usize,
    offset: usize,
    joints: usize,
}
