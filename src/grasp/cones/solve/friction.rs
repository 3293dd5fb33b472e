//! The friction pass: normal forces as they are, and friction that is held without softness.

use super::{GraspSolver, Member};
use crate::grasp::cones::arrow::Arrow;
use crate::grasp::cones::coupled::CoupledConstraints;
use crate::grasp::contact::contacts::{GraspContact, WarmStart};
use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS, pyramid_pairs};
use std::cell::LazyCell;

/// Proximal resistance of friction, relative to what the contact's own inertia resists. The error that it leaves in
/// one step is this fraction of the *change* of the friction force, and it is gone in the next.
const RESISTANCE: f64 = 1e-3;

/// Friction that changes in a step by more than this share of its limit, as where contacts open or close, is centred anew in
/// the same step, so that no more than [`RESISTANCE`] times this is left of the error.
const SMALL_CHANGE: f64 = 1e-2;

/// Not so where what is left of the motion along it, against the largest acceleration that the forces have to answer, is no
/// more than what Newton's method leaves: the friction loss of a joint that hardly has any.
const NEGLIGIBLE: f64 = 1e-6;

impl GraspSolver {
    /// Centres each friction cost at the force that it has come to; false, with nothing done, where that is a small change.
    pub(super) fn recentre(&mut self, coupled: &CoupledConstraints) -> bool {
        // the rows of a weld have a softness of their own, and no centre
        let gives = |member: &Member| matches!(*member, Member::Coupled(i) if coupled.list()[i].gives);
        let negligible = LazyCell::new(|| NEGLIGIBLE * self.arrow.largest_bias());
        let changed = |(block, member): (usize, &Member)| {
            let (cost, force) = (self.arrow.cost(block), &self.arrow.response(block).force);
            let residual = &self.arrow.residual(block)[cost.first_friction_row().unwrap_or(0)..];
            !gives(member)
                && cost.change(&force[..residual.len()]) > SMALL_CHANGE
                && residual.iter().any(|x| x.abs() > *negligible)
        };
        let changed_single = |single: usize| {
            let single = self.arrow.single(single);
            single.change() > SMALL_CHANGE && single.jar.abs() > *negligible
        };
        if !self.order.iter().enumerate().any(changed) && !(0..self.singles.len()).any(changed_single) {
            return false;
        }
        for (block, member) in self.order.iter().enumerate() {
            let (cost, response) = (self.arrow.cost(block), self.arrow.response(block));
            let mut start = [0.0; MAX_ROWS];
            match cost {
                Cost::Slip { .. } => start[1..].copy_from_slice(&response.force[..MAX_ROWS - 1]),
                Cost::Still => {}
                _ => start = response.force,
            }
            let cost = if gives(member) { *cost } else { cost.centred(&response.force) };
            let active_set = response.active_set;
            self.arrow.recost(block, cost, active_set, &start);
            if active_set == ActiveSet::Slide {
                self.arrow.expect_same(block);
            }
        }
        self.arrow.centre_singles();
        true
    }

    /// Keeps the normal forces of the main pass and turns each block's cost into friction under them.
    pub(super) fn fix_normals(&mut self, contacts: &mut [GraspContact], coupled: &mut CoupledConstraints) {
        let GraspSolver { arrow, order, singles, .. } = self;
        arrow.keep(
            |block, force| {
                let kept = match order[block] {
                    Member::Contact(_) | Member::Foreign(_) => 1,
                    Member::Coupled(i) => coupled.kept_rows(i),
                };
                let mut out = [0.0; MAX_ROWS];
                out[..kept].copy_from_slice(&force[..kept]);
                out
            },
            |single, force| if coupled.kept_rows(singles[single]) > 0 { force } else { 0.0 },
        );
        for (block, member) in order.iter().enumerate() {
            match *member {
                Member::Contact(i) => friction_of_contact(arrow, block, &mut contacts[i]),
                Member::Foreign(i) => friction_of_contact(arrow, block, coupled.foreign_mut(i)),
                Member::Coupled(i) => friction_of_coupled(arrow, block, coupled, i),
            }
        }
        for (single, &i) in singles.iter().enumerate() {
            let own = arrow.single(single).mobility;
            let resistance = RESISTANCE * if own > IMMOBILE { own } else { 1.0 };
            let (mut force, s) = ([0.0; MAX_ROWS], arrow.single(single));
            force[0] = s.force;
            let (cost, active_set) = coupled.end_main_pass(i, (&force, s.active_set()), &[s.jar], resistance);
            let start = if let Cost::Bounded { centre, .. } = cost { centre } else { 0.0 };
            arrow.recost_single(single, &cost, active_set, start);
        }
    }
}

/// Below this nothing moves along a row: a tonne is 1e-3 \[1/kg\].
const IMMOBILE: f64 = 1e-9;

/// From how easily the block's rows move; from its most mobile direction where nothing can move along the row that is known,
/// as across the rail of a target on a slide.
fn resistance(arrow: &mut Arrow, block: usize) -> f64 {
    let own = arrow.mobility(block);
    if own > IMMOBILE {
        return RESISTANCE * own;
    }
    let rows = arrow.residual(block).len().min(3);
    let largest = (0..rows).map(|row| arrow.row_mobility(block, row)).fold(0.0, f64::max);
    RESISTANCE * if largest > IMMOBILE { largest } else { 1.0 }
}

fn friction_of_contact(arrow: &mut Arrow, block: usize, contact: &mut GraspContact) {
    let rows = contact.parameters.condim;
    let resistance = resistance(arrow, block);
    let response = arrow.response(block);
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
    let friction = contact.parameters.friction;
    let cost = match *arrow.cost(block) {
        Cost::Pyramidal { stiffness, friction } => {
            let normals = pyramid_pairs(arrow.residual(block), stiffness, &friction);
            Cost::slip_box(centre, resistance, friction, normals)
        }
        _ => Cost::slip_ellipsoid(centre, resistance, friction, response.force[0]),
    };
    let mut start = [0.0; MAX_ROWS];
    start[1..rows].copy_from_slice(&centre[..rows - 1]);
    arrow.recost(block, cost, active_set, &start);
    if let Some(memory) = contact.warm_start().filter(|_| active_set == ActiveSet::Slide) {
        arrow.expect(block, &memory.residual[..rows - 1]);
    }
}

fn friction_of_coupled(arrow: &mut Arrow, block: usize, coupled: &mut CoupledConstraints, i: usize) {
    let resistance = resistance(arrow, block);
    let response = arrow.response(block);
    let force = response.force;
    let (cost, active_set) = coupled.end_main_pass(i, (&force, response.active_set), arrow.residual(block), resistance);
    let mut start = [0.0; MAX_ROWS];
    match cost {
        _ if coupled.list()[i].gives => start = force,
        Cost::Slip { centre, .. } => start[1..].copy_from_slice(&centre),
        Cost::Bounded { centre, .. } => start[0] = centre,
        _ => {}
    }
    arrow.recost(block, cost, active_set, &start);
}
