//! What a contact remembers of the last step, and hands on to the next.

use super::GraspContact;
use crate::grasp::contact::cost::ActiveSet;
use nalgebra::Vector3;

/// What a contact remembers of the last step, in this step's axes.
#[derive(Clone, Copy, Debug)]
pub(in crate::grasp) struct WarmStart {
    /// Force of each row in the pass with soft contacts.
    pub main: [f64; 6],
    /// Friction: two tangents, spin, two rolling.
    pub friction: [f64; 5],
    /// What the friction pass changed in it; `None` if the engine solved the contact.
    pub correction: Option<[f64; 5]>,
    /// Where on its cone it was.
    pub active_sets: [ActiveSet; 2],
    /// Residual of each friction row in the friction pass.
    pub residual: [f64; 5],
}

/// What a contact hands on to the next step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(in crate::grasp) struct SavedContact {
    /// The two geoms, in the engine's order.
    pub geoms: (usize, usize),
    pub position: Vector3<f64>,
    pub normal: Vector3<f64>,
    /// Force of each row in the pass with soft contacts.
    pub main: [f64; 6],
    /// Friction force and torque, world axes.
    pub friction: [Vector3<f64>; 2],
    /// What the friction pass changed in them; `None` if the engine solved the contact.
    pub correction: Option<[Vector3<f64>; 2]>,
    pub active_sets: [ActiveSet; 2],
    /// Residual of friction in the friction pass, world axes.
    #[serde(default)]
    pub residual: [Vector3<f64>; 2],
}

impl SavedContact {
    pub fn of(contact: &GraspContact) -> SavedContact {
        let [n, t1, t2] = &contact.axes;
        let (f, main) = (&contact.force_rows, &contact.main);
        let friction = [contact.force - n * f[0], contact.torque];
        let world = |rows: &[f64]| [t1 * rows[0] + t2 * rows[1], n * rows[2] + t1 * rows[3] + t2 * rows[4]];
        let soft = world(&main[1..]);
        let correction = [friction[0] - soft[0], friction[1] - soft[1]];
        SavedContact {
            geoms: contact.geoms,
            position: contact.position,
            normal: *n,
            main: *main,
            friction,
            correction: contact.solved.then_some(correction),
            active_sets: contact.active_sets,
            residual: world(&contact.residual),
        }
    }

    /// The memory in the axes of the same contact one step later.
    pub fn warm_start(&self, contact: &GraspContact) -> WarmStart {
        let [n, t1, t2] = &contact.axes;
        let rows = |[force, torque]: &[Vector3<f64>; 2]| -> [f64; 5] {
            [force.dot(t1), force.dot(t2), torque.dot(n), torque.dot(t1), torque.dot(t2)]
        };
        WarmStart {
            main: self.main,
            friction: rows(&self.friction),
            correction: self.correction.as_ref().map(rows),
            active_sets: self.active_sets,
            residual: rows(&self.residual),
        }
    }

    /// True if every number is finite.
    pub fn is_finite(&self) -> bool {
        let friction = self.friction.iter().chain(self.correction.iter().flatten()).chain(&self.residual);
        let vectors = friction.chain([&self.position, &self.normal]);
        vectors.flat_map(|v| v.iter()).chain(&self.main).all(|x| x.is_finite())
    }
}
