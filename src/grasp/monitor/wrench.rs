//! Contact forces on the target and the wrenches that a contact can exert.
//!
//! A wrench is a 6-vector `[force; torque]` in world axes, its torque about a stated point. Wherever wrenches are
//! *compared* (singular values, hulls) the torque is divided by a characteristic length, so that all six numbers are
//! newtons; [`contact_radius`] is that length.

use nalgebra::{Vector3, Vector6};
use thiserror::Error;

/// Number of friction coefficients of a contact: two tangential, one torsional, two rolling (MuJoCo's order).
pub const FRICTION: usize = 5;

/// One contact of the target: where it is, what it could exert, and what it does exert on the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadedContact {
    /// Contact point, world \[m\].
    pub position: Vector3<f64>,
    /// Unit normal, world, pointing **into the target**.
    pub normal: Vector3<f64>,
    /// Unit tangents, world, orthogonal to the normal and to each other.
    pub tangents: [Vector3<f64>; 2],
    /// MuJoCo's contact dimension: 1 frictionless, 3 sliding, 4 also torsion, 6 also rolling friction.
    pub condim: usize,
    /// Friction coefficients: tangential along each tangent \[-\], torsional \[m\], rolling about each tangent \[m\].
    /// Those beyond `condim` are ignored.
    pub friction: [f64; FRICTION],
    /// Live normal force \[N\], never negative.
    pub normal_force: f64,
    /// Live force on the target, world \[N\]: normal and friction together.
    pub force: Vector3<f64>,
    /// Live couple on the target, world \[N m\]: torsional and rolling friction, free of any moment arm.
    pub torque: Vector3<f64>,
}

/// A contact that no physics can have produced.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ContactError {
    /// A number that is NaN or infinite.
    #[error("contact {contact}: its {field} is not finite; every number of a contact must be")]
    NotFinite {
        /// Its place in the list, from 0.
        contact: usize,
        /// Which field.
        field: &'static str,
    },
    /// Normal and tangents are not an orthonormal frame.
    #[error("contact {contact}: its normal and tangents are not orthonormal (off by {error:.1e}, at most 1e-6)")]
    Frame {
        /// Its place in the list, from 0.
        contact: usize,
        /// How far off.
        error: f64,
    },
    /// A contact dimension that MuJoCo does not have.
    #[error("contact {contact}: condim is {condim}; it must be 1, 3, 4 or 6")]
    Condim {
        /// Its place in the list, from 0.
        contact: usize,
        /// Its value.
        condim: usize,
    },
    /// A normal force that pulls.
    #[error("contact {contact}: its normal force is {force} N; contacts push, so it must be 0 or more")]
    Pulling {
        /// Its place in the list, from 0.
        contact: usize,
        /// Its value \[N\].
        force: f64,
    },
    /// A negative friction coefficient.
    #[error("contact {contact}: friction coefficient {index} is {value}; it must be 0 or more")]
    Friction {
        /// Its place in the list, from 0.
        contact: usize,
        /// Its place, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
}

impl LoadedContact {
    /// Friction coefficients in use: `condim - 1` of them.
    pub fn active_friction(&self) -> &[f64] {
        &self.friction[..self.condim.saturating_sub(1).min(FRICTION)]
    }

    /// The wrench `[force; torque about point]` \[N, N m\] that the contact exerts on the target now.
    pub fn wrench_about(&self, point: &Vector3<f64>) -> Vector6<f64> {
        let arm = self.position - point;
        stack(&self.force, &(arm.cross(&self.force) + self.torque))
    }

    /// Wrench about `com` of a unit normal force, torque over `length`: the first column of the contact's grasp map.
    pub fn normal_wrench(&self, com: &Vector3<f64>, length: f64) -> Vector6<f64> {
        self.force_wrench(&self.normal, com, length)
    }

    /// Wrench about `com` of a unit of friction component `row` (0, 1: force along a tangent; 2: couple about the
    /// normal; 3, 4: couple about a tangent), torque over `length`.
    pub fn friction_wrench(&self, row: usize, com: &Vector3<f64>, length: f64) -> Vector6<f64> {
        match row {
            0 | 1 => self.force_wrench(&self.tangents[row], com, length),
            _ => {
                let axis = match row {
                    2 => &self.normal,
                    3 => &self.tangents[0],
                    _ => &self.tangents[1],
                };
                stack(&Vector3::zeros(), &(axis * inverse(length)))
            }
        }
    }

    fn force_wrench(&self, force: &Vector3<f64>, com: &Vector3<f64>, length: f64) -> Vector6<f64> {
        let arm = (self.position - com) * inverse(length);
        stack(force, &arm.cross(force))
    }

    /// Checks the contact; `contact` is its index, for the message.
    pub fn check(&self, contact: usize) -> Result<(), ContactError> {
        let vectors = [
            ("position", self.position),
            ("normal", self.normal),
            ("first tangent", self.tangents[0]),
            ("second tangent", self.tangents[1]),
            ("force", self.force),
            ("torque", self.torque),
        ];
        for (field, vector) in vectors {
            if !vector.iter().all(|x| x.is_finite()) {
                return Err(ContactError::NotFinite { contact, field });
            }
        }
        if !self.normal_force.is_finite() {
            let field = "normal force";
            return Err(ContactError::NotFinite { contact, field });
        }
        if self.normal_force < 0.0 {
            let force = self.normal_force;
            return Err(ContactError::Pulling { contact, force });
        }
        if !matches!(self.condim, 1 | 3 | 4 | 6) {
            let condim = self.condim;
            return Err(ContactError::Condim { contact, condim });
        }
        for (index, &value) in self.active_friction().iter().enumerate() {
            if !value.is_finite() {
                let field = "friction";
                return Err(ContactError::NotFinite { contact, field });
            }
            if value < 0.0 {
                return Err(ContactError::Friction { contact, index, value });
            }
        }
        let [t1, t2] = &self.tangents;
        let n = &self.normal;
        let error = [
            n.norm_squared() - 1.0,
            t1.norm_squared() - 1.0,
            t2.norm_squared() - 1.0,
            n.dot(t1),
            n.dot(t2),
            t1.dot(t2),
        ]
        .into_iter()
        .fold(0.0, |worst: f64, x| worst.max(x.abs()));
        if error > 1e-6 {
            return Err(ContactError::Frame { contact, error });
        }
        Ok(())
    }
}

/// The characteristic length \[m\] by which torques are divided: the mean distance of the contacts from their centroid,
/// both means weighted by normal force.
///
/// The weights make the length, and with it the quality, continuous when a contact is born or dies at zero force, and a
/// finger weigh the same in it whether the collision stage reports one point or several beside each other.
/// With equal forces it is the plain mean of the design. It is 0 for a single contact, and where nothing is loaded.
pub fn contact_radius(contacts: &[LoadedContact]) -> f64 {
    let total: f64 = contacts.iter().map(|c| c.normal_force).sum();
    if total.is_nan() || total <= 0.0 {
        return 0.0;
    }
    let weighted: Vector3<f64> = contacts.iter().map(|c| c.position * (c.normal_force / total)).sum();
    let radius: f64 = contacts.iter().map(|c| (c.position - weighted).norm() * (c.normal_force / total)).sum();
    // Contacts on one spot leave only rounding, which must not pass for a length.
    let rounding = 1e-12 * weighted.norm();
    if radius > rounding { radius } else { 0.0 }
}

/// `[force; torque]`.
pub(crate) fn stack(force: &Vector3<f64>, torque: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}

/// 1/length, and 0 for a length that does not exist: contacts on one spot have no lever, and no torque counts.
pub(crate) fn inverse(length: f64) -> f64 {
    if length > 0.0 { length.recip() } else { 0.0 }
}
