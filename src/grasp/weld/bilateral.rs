//! What a contact does as a part of a merged grasp: MuJoCo's own law, kept bilateral.

use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::contact::softness::{ConeKind, SolverOptions, softness};
use crate::grasp::weld::impedance::ROWS;
use nalgebra::Vector3;

/// `J a + R f = aref` of one contact: MuJoCo's spring and damper.
#[derive(Clone, Copy, Debug)]
pub(in crate::grasp) struct BilateralContact {
    pub damping: f64,
    pub spring: f64,
    pub resistance: f64,
    /// Part of the normal's acceleration that its law left unexplained when the grasp latched: the engine's noslip pass
    /// changes friction after the normals are solved.
    pub offset: f64,
    /// Friction and torques of the last step.
    pub friction: [f64; ROWS],
}

/// A contact of the last step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(in crate::grasp) struct SavedBilateral {
    geoms: (usize, usize),
    position: Vector3<f64>,
    friction: Vector3<f64>,
    torque: Vector3<f64>,
    pub offset: f64,
}

impl BilateralContact {
    pub(in crate::grasp) fn of(
        contact: &GraspContact,
        options: &SolverOptions,
        memory: &[SavedBilateral],
    ) -> BilateralContact {
        let soft = softness(&contact.parameters, options);
        let distance = |m: &&SavedBilateral| (m.position - contact.position).norm_squared();
        let before =
            memory.iter().filter(|m| m.geoms == contact.geoms).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let mut friction = [0.0; ROWS];
        if let Some(before) = before {
            for (row, f) in friction.iter_mut().enumerate().take(contact.parameters.condim).skip(1) {
                let of = if row < 3 { &before.friction } else { &before.torque };
                *f = contact.axes[row % 3].dot(of);
            }
        }
        BilateralContact {
            damping: soft.damping,
            spring: soft.spring,
            resistance: normal_resistance(contact, options, soft.regularisation),
            offset: before.map_or(0.0, |m| m.offset),
            friction,
        }
    }

    /// One step on frozen geometry later.
    pub(in crate::grasp) fn resume(&mut self, contact: &GraspContact, options: &SolverOptions) {
        let soft = softness(&contact.parameters, options);
        (self.damping, self.spring) = (soft.damping, soft.spring);
        let rows = 1..contact.parameters.condim;
        self.friction[rows.clone()].copy_from_slice(&contact.force_rows[rows]);
    }
}

impl SavedBilateral {
    pub(in crate::grasp) fn of(contact: &GraspContact, offset: f64) -> SavedBilateral {
        SavedBilateral {
            geoms: contact.geoms,
            position: contact.position,
            friction: contact.force - contact.axes[0] * contact.force_rows[0],
            torque: contact.torque,
            offset,
        }
    }

    pub(in crate::grasp) fn geoms(&self) -> (usize, usize) {
        self.geoms
    }

    /// True if every number is finite.
    pub(in crate::grasp) fn is_finite(&self) -> bool {
        let vectors = [&self.position, &self.friction, &self.torque];
        vectors.into_iter().flat_map(|v| v.iter()).chain([&self.offset]).all(|x| x.is_finite())
    }
}

/// `R` of a contact's normal. A pyramid's `2 (condim - 1)` edges push side by side.
pub(in crate::grasp) fn normal_resistance(contact: &GraspContact, options: &SolverOptions, regularisation: f64) -> f64 {
    let condim = contact.parameters.condim;
    if condim > 1 && options.cone == ConeKind::Pyramidal {
        regularisation / (2 * (condim - 1)) as f64
    } else {
        regularisation
    }
}
