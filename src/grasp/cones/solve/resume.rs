//! The grasp solve one step on frozen geometry later: the same rows, other accelerations.

use super::{GraspSolver, Member, SolveStatus};
use crate::grasp::cones::coupled::CoupledConstraints;
use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::cost::{ActiveSet, Cost, MAX_ROWS};
use crate::grasp::contact::softness::{SolverOptions, softness};

impl GraspSolver {
    /// As [`solve`](Self::solve), of the contacts and coupled of the last step, which have moved on. Inertia, rows and softness
    /// are those of that step, and so are the factored Hessians as long as no active set changes.
    pub fn resume(
        &mut self,
        dynamics: &Dynamics<'_>,
        options: &SolverOptions,
        contacts: &mut [GraspContact],
        coupled: &mut CoupledConstraints,
    ) -> SolveStatus {
        self.arrow.resume();
        self.inverse_inertia.palm.accelerate(dynamics);
        self.inverse_inertia.target.accelerate(dynamics);
        self.inverse_inertia.fingers.iter_mut().for_each(|finger| finger.accelerate(dynamics));
        self.turning.forget();
        for block in 0..self.order.len() {
            match self.order[block] {
                Member::Contact(i) => self.resume_contact(dynamics, options, block, &mut contacts[i]),
                Member::Coupled(i) => {
                    let constraint = &coupled.list()[i];
                    let rows = constraint.first..constraint.first + constraint.rows;
                    self.arrow.bias_mut(block).copy_from_slice(&coupled.bias()[rows]);
                    self.arrow.recost(block, constraint.cost, constraint.active_sets[0], &constraint.main);
                }
                Member::Foreign(number) => {
                    let constraint = coupled.of_foreign(number);
                    let rows = constraint.first..constraint.first + constraint.rows;
                    self.arrow.bias_mut(block).copy_from_slice(&coupled.bias()[rows]);
                    self.recost_contact(block, &coupled.foreign()[number]);
                }
            }
        }
        for (single, &i) in self.singles.iter().enumerate() {
            let constraint = &coupled.list()[i];
            self.arrow.rebias_single(single, coupled.bias()[constraint.first]);
            self.arrow.recost_single(single, &constraint.cost, constraint.active_sets[0], constraint.main[0]);
        }
        self.two_passes(contacts, coupled)
    }

    fn resume_contact(
        &mut self,
        dynamics: &Dynamics<'_>,
        options: &SolverOptions,
        block: usize,
        contact: &mut GraspContact,
    ) {
        let velocity = contact.resume(dynamics, &mut self.turning, options.timestep);
        let soft = softness(&contact.parameters, options);
        let bias = self.contact_bias(dynamics, contact, &soft, &velocity);
        let rows = contact.parameters.condim;
        self.arrow.bias_mut(block).copy_from_slice(&bias[..rows]);
        self.recost_contact(block, contact);
    }

    /// Back to the soft cost; surfaces that have come apart are no contact.
    fn recost_contact(&mut self, block: usize, contact: &GraspContact) {
        if contact.parameters.dist < contact.parameters.margin {
            self.arrow.recost(block, self.soft[block], contact.active_sets[0], &contact.main);
        } else {
            self.arrow.recost(block, Cost::Still, ActiveSet::Open, &[0.0; MAX_ROWS]);
        }
    }
}
