//! The target, held at its starting pose until the hand is ready.
//!
//! Setting its pose and velocity back before each step is not enough: within the step the fingers would meet a target that
//! gives way with its own small mass, and contacts on it would chatter. So it is also given a large inertia, and what the
//! fingers feel is a body that does not move. Letting go takes the inertia back.

use crate::mujoco::{BodyId, JointKind, Simulation};

/// Inertia added to each degree of freedom \[kg or kg m^2\]: far above any target's own.
const INERTIA: f64 = 1e3;

/// A joint between a target and the world, held at a position.
#[derive(Clone, Debug)]
pub(super) struct Pin {
    first_q: usize,
    position: Vec<f64>,
    first_v: usize,
    /// Armature and diagonal inertia of each degree of freedom, as the model has them.
    own: Vec<(f64, f64)>,
}

impl Pin {
    /// Takes hold of every joint between `targets` and the world, at its present position.
    pub(super) fn all(sim: &mut Simulation, targets: &[BodyId]) -> Vec<Self> {
        let mut pins: Vec<Self> = Vec::new();
        for target in targets {
            let mut body = target.index();
            while body != 0 {
                let model = sim.model();
                let first = model.body_jntadr()[body].max(0) as usize;
                let joints = first..first + model.body_jntnum()[body] as usize;
                body = model.body_parentid()[body] as usize;
                for joint in joints {
                    let first_q = sim.model().jnt_qposadr()[joint] as usize;
                    if pins.iter().all(|p| p.first_q != first_q) {
                        pins.push(Self::new(sim, joint));
                    }
                }
            }
        }
        pins
    }

    fn new(sim: &mut Simulation, joint: usize) -> Self {
        let model = sim.model();
        let (nq, nv) = match JointKind::from_raw(model.jnt_type()[joint]) {
            JointKind::Free => (7, 6),
            JointKind::Ball => (4, 3),
            _ => (1, 1),
        };
        let first_q = model.jnt_qposadr()[joint] as usize;
        let first_v = model.jnt_dofadr()[joint] as usize;
        let own = (first_v..first_v + nv).map(|v| (model.dof_armature()[v], model.dof_M0()[v])).collect();
        let pin = Self { first_q, position: sim.qpos()[first_q..first_q + nq].to_vec(), first_v, own };
        pin.add_inertia(sim, INERTIA);
        pin
    }

    /// Before a step: back to the starting position, at rest.
    pub(super) fn hold(&self, sim: &mut Simulation) {
        sim.qpos_mut()[self.first_q..self.first_q + self.position.len()].copy_from_slice(&self.position);
        sim.qvel_mut()[self.first_v..self.first_v + self.own.len()].fill(0.0);
    }

    /// Before the first free step.
    pub(super) fn let_go(self, sim: &mut Simulation) {
        self.hold(sim);
        self.add_inertia(sim, 0.0);
    }

    fn add_inertia(&self, sim: &mut Simulation, added: f64) {
        for (v, (armature, diagonal)) in (self.first_v..).zip(&self.own) {
            sim.dof_armature_mut()[v] = armature + added;
            // What mj_crb takes for bodies whose inertia does not depend on the pose.
            sim.dof_M0_mut()[v] = diagonal + added;
        }
    }
}
