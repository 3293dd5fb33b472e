//! What can keep a grasp's quality from being computed.

use super::hull::HullError;
use crate::grasp::monitor::wrench::{ContactError, LoadedContact};
use nalgebra::Vector3;
use thiserror::Error;

/// Why a grasp's quality could not be computed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum QualityError {
    /// A contact that no physics can have produced.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// A number that is NaN or infinite.
    #[error("the {what} is not finite: {value:?}")]
    NotFinite {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: Vec<f64>,
    },
    /// The singular value decomposition did not converge.
    #[error(
        "the singular values of the grasp matrix of {contacts} contacts did not converge; are its forces beyond 1e150 N?"
    )]
    SingularValues {
        /// Number of contacts.
        contacts: usize,
    },
    /// The wrench hull could not be formed.
    #[error("the hull of the contact wrenches: {0}")]
    Hull(#[from] HullError),
    /// A conic program could not be solved.
    #[error(transparent)]
    Solver(#[from] SolverFault),
}

/// The conic solver gave no solution that could be verified.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SolverFault {
    /// It refused the problem.
    #[error("the conic solver refused the balance of {contacts} contacts: {reason}")]
    Refused {
        /// Number of contacts.
        contacts: usize,
        /// The solver's reason.
        reason: String,
    },
    /// It stopped without a usable point.
    #[error(
        "the conic solver stopped ({status}) on the balance of {contacts} contacts, violated by {residual:.1e} \
         (at most 1e-6)"
    )]
    Unsolved {
        /// Number of contacts.
        contacts: usize,
        /// The solver's status.
        status: String,
        /// Violation of balance and cones, relative to the largest force.
        residual: f64,
    },
}

/// Checks every contact and the centre of mass.
pub(super) fn check(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<(), QualityError> {
    for (index, contact) in contacts.iter().enumerate() {
        contact.check(index)?;
    }
    finite("target's centre of mass", com.as_slice())
}

/// An error naming `what` unless all values are finite.
pub(super) fn finite(what: &'static str, values: &[f64]) -> Result<(), QualityError> {
    if values.iter().all(|x| x.is_finite()) {
        return Ok(());
    }
    Err(QualityError::NotFinite { what, value: values.to_vec() })
}
