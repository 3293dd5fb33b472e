//! The friction pass: normal forces as they are, and friction that is held without softness.

use super::{GraspSolver, Member};
use crate::grasp::cones::arrow::Arrow;
use crate::grasp::cones::coupled::CoupledConstraints;
use crate::grasp::contact::contacts::{GraspContact, WarmStart};
use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS, pyramid_pairs};

/// Proximal resistance of friction, relative to what the contact's own inertia resists. The error that it leaves in
/// one step is this fraction of the *change* of the friction force, and it is gone in the next.
const RESISTANCE: f64 = 1e-3;

/// Friction that changes in a step by more than this share of its limit, as where contacts open or close, is centred anew in
/// the same step, so that no more than [`RESISTANCE`] times this is left of the error.
const SMALL_CHANGE: f64 = 1e-2;

impl GraspSolver {
    /// Centres each friction cost at the force that it has come to; false, with nothing done, where that is a small change.
    pub(super) fn recentre(&mut self, coupled: &CoupledConstraints) -> bool {
        // the rows of a weld have a softness of their own, and no centre
        let gives = |member: &Member| matches!(*member, Member::Coupled(i) if coupled.list()[i].gives);
        let changed = |(block, member): (usize, &Member)| {
            let (cost, force) = (self.arrow.cost(block), &self.arrow.response(block).force);
            let rows = self.arrow.residual(block).len() - cost.first_friction_row().unwrap_or(0);
            !gives(member) && cost.change(&force[..rows]) > SMALL_CHANGE
        };
        if !self.order.iter().enumerate().any(changed) {
            return false;
        }
        self.start.clear();
        self.costs.clear();
        for block in 0..self.order.len() {
            let (cost, response) = (self.arrow.cost(block), self.arrow.response(block));
            let mut start = [0.0; MAX_ROWS];
            match cost {
                Cost::Slip { .. } => start[1..].copy_from_slice(&response.force[..MAX_ROWS - 1]),
                Cost::Still => {}
                _ => start = response.force,
            }
            self.start.extend_from_slice(&start[..self.arrow.residual(block).len()]);
            let cost = if gives(&self.order[block]) { *cost } else { cost.centred(&response.force) };
            self.costs.push((cost, response.active_set));
        }
        self.kept.fill(0.0);
        let costs = &self.costs;
        self.arrow.continue_with(&self.kept, &self.start, |block| costs[block]);
        true
    }

    /// Keeps the normal forces of the main pass and turns each block's cost into friction under them.
    pub(super) fn fix_normals(&mut self, contacts: &mut [GraspContact], coupled: &mut CoupledConstraints) {
        self.kept.clear();
        self.start.clear();
        self.costs.clear();
        for (block, member) in self.order.iter().enumerate() {
            let recost = match *member {
                Member::Contact(i) => friction_of_contact(&self.arrow, block, &mut contacts[i]),
                Member::Foreign(i) => friction_of_contact(&self.arrow, block, coupled.foreign_mut(i)),
                Member::Coupled(i) => friction_of_coupled(&self.arrow, block, coupled, i),
            };
            let rows = self.arrow.residual(block).len();
            self.kept.extend_from_slice(&recost.kept[..rows]);
            self.start.extend_from_slice(&recost.start[..rows]);
            self.costs.push((recost.cost, recost.active_set));
        }
        let costs = &self.costs;
        self.arrow.continue_with(&self.kept, &self.start, |block| costs[block]);
    }
}

/// A block's part in the friction pass.
struct Recost {
    cost: Cost,
    active_set: ActiveSet,
    /// Forces that stand.
    kept: [f64; MAX_ROWS],
    /// Forces at which the pass starts.
    start: [f64; MAX_ROWS],
}

/// Below this nothing moves along a row: a tonne is 1e-3 \[1/kg\].
const IMMOBILE: f64 = 1e-9;

/// From the inverse inertia of `row`; from that of the block's most mobile direction where nothing can move along `row`, as
/// across the rail of a target on a slide.
fn resistance(arrow: &Arrow, block: usize, row: usize) -> f64 {
    let own = arrow.row_inverse_inertia(block, row);
    if own > IMMOBILE {
        return RESISTANCE * own;
    }
    let rows = arrow.residual(block).len().min(3);
    let largest = (0..rows).map(|row| arrow.row_inverse_inertia(block, row)).fold(0.0, f64::max);
    RESISTANCE * if largest > IMMOBILE { largest } else { 1.0 }
}

fn friction_of_contact(arrow: &Arrow, block: usize, contact: &mut GraspContact) -> Recost {
    let rows = contact.parameters.condim;
    let response = *arrow.response(block);
    contact.force_rows = [0.0; MAX_ROWS];
    contact.force_rows[0] = response.force[0];
    contact.main = response.force;
    contact.solved = true;
    contact.active_sets[0] = response.active_set;

    let mut centre = [0.0; 5];
    centre.copy_from_slice(&response.force[1..]);
    let active_set = match contact.warm_start() {
        Some(WarmStart { correction: Some(correction), active_sets, .. }) => {
            centre.iter_mut().zip(correction).for_each(|(centre, correction)| *centre += correction);
            active_sets[1]
        }
        Some(WarmStart { friction, active_sets, .. }) => {
            centre = *friction;
            active_sets[1]
        }
        None => ActiveSet::Stick,
    };
    let resistance = resistance(arrow, block, rows.min(2) - 1);
    let friction = contact.parameters.friction;
    let cost = match *arrow.cost(block) {
        Cost::Pyramidal { stiffness, friction } => {
            let normals = pyramid_pairs(arrow.residual(block), stiffness, &friction);
            Cost::slip_box(centre, resistance, friction, normals)
        }
        _ => Cost::slip_ellipsoid(centre, resistance, friction, response.force[0]),
    };
    let (mut kept, mut start) = ([0.0; MAX_ROWS], [0.0; MAX_ROWS]);
    kept[0] = response.force[0];
    start[1..rows].copy_from_slice(&centre[..rows - 1]);
    Recost { cost, active_set, kept, start }
}

fn friction_of_coupled(arrow: &Arrow, block: usize, coupled: &mut CoupledConstraints, i: usize) -> Recost {
    let response = arrow.response(block);
    let jar = arrow.residual(block);
    let rows = jar.len();
    let resistance = resistance(arrow, block, rows.min(2) - 1);
    let (cost, active_set) = coupled.end_main_pass(i, (&response.force, response.active_set), jar, resistance);
    if coupled.list()[i].gives {
        return Recost { cost, active_set, kept: [0.0; MAX_ROWS], start: response.force };
    }
    let (mut kept, mut start) = (response.force, [0.0; MAX_ROWS]);
    if let Some(first) = cost.first_friction_row() {
        kept[first..].fill(0.0);
        match cost {
            Cost::Slip { centre, .. } => start[1..].copy_from_slice(&centre),
            Cost::Bounded { centre, .. } => start[0] = centre,
            _ => {}
        }
    }
    Recost { cost, active_set, kept, start }
}
