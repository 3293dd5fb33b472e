//! How good a grasp is: the thesis's quality (Guerroudj 2022, Eqs. 2.17 and 2.18), live, and the field's metrics.
//!
//! # The thesis's Q
//! `G = [w_1 .. w_N]`, `w_i` the wrenches about the target's centre of mass of contact i's basis forces; Q is the
//! smallest singular value of G. The basis forces are those of box friction, scaled by the live normal force f_n:
//!
//! * friction, as in the thesis, in symmetric pairs that span both directions of each axis: `+mu_1 f_n t_1`,
//!   `-mu_1 f_n t_1`, `+mu_2 f_n t_2`, `-mu_2 f_n t_2`. Both members of a pair are columns of G. They add no rank, but
//!   each adds its outer product to `G G'`, so a pair weighs as one column of `sqrt(2) mu f_n`;
//! * the normal force itself, `f_n n`, once: it pushes only. (The thesis's four forces alone would leave any two-finger
//!   grasp without a hold along the line between the fingers.)
//! * with condim 4 the pair of couples `+-mu_t f_n n`, with condim 6 also `+-mu_r f_n t_1`, `+-mu_r f_n t_2`. Without
//!   friction (condim 1) only the normal remains.
//!
//! Torques are divided by [`contact_radius`], so Q is in newtons. Consequences, all tested: Q is linear in the forces;
//! it does not depend on the pose of the scene, the order of the contacts, the target's frame, or (with equal tangential
//! coefficients) the choice of tangents; nor on the scene's size if the torsional and rolling coefficients, which are
//! lengths, grow with it. One contact, or contacts on one spot, have no radius: Q = 0. Two hard fingers have rank 5:
//! Q = 0.
//!
//! Closed forms on a sphere of radius a about the centre of mass, equal f and mu: two soft fingers
//! `f min(sqrt 2, 2 mu, 2 mu_t / a)`; N >= 3 hard ones around an equator `sqrt(N) mu f`; four at a tetrahedron's corners
//! `f min(4 mu / sqrt 3, sqrt((4 + 16 mu^2) / 3))`; six at a cube's face centres `f min(2 sqrt 2 mu, sqrt(2 + 8 mu^2))`.
//!
//! Q knows ranks and sizes but not that contacts only push: an object lying on an open palm has Q > 0. Force closure and
//! Ferrari and Canny's epsilon do tell.

use faer::Mat;
use nalgebra::{Matrix6, Vector3, Vector6};
use serde::Serialize;
use thiserror::Error;

use super::closure::{self, SolverFault};
use super::hull::{ConvexHull, HullError};
use super::wrench::{ContactError, ContactForce, contact_radius};

/// Singular values below this fraction of the largest are rounding: the matrix `G G'` cannot tell them from zero.
pub const RANK_TOLERANCE: f64 = 1e-7;
/// Edges of a linearised friction cone.
pub const CONE_EDGES: usize = 8;
/// The default Q_Th as a fraction of the target's weight, see [`default_latch_quality`].
pub const LATCH_PER_WEIGHT: f64 = 0.1;
/// The default Q_M as a fraction of Q_Th.
pub const RELEASE_PER_LATCH: f64 = 0.25;

/// Why a grasp's quality could not be computed.
#[derive(Debug, Error)]
pub enum QualityError {
    #[error(transparent)]
    Contact(#[from] ContactError),
    #[error("the {what} is not finite: {value:?}")]
    NotFinite { what: &'static str, value: Vec<f64> },
    #[error(
        "the singular values of the grasp matrix of {contacts} contacts did not converge; are its forces beyond 1e150 N?"
    )]
    SingularValues { contacts: usize },
    #[error("the hull of the contact wrenches: {0}")]
    Hull(#[from] HullError),
    #[error(transparent)]
    Solver(#[from] SolverFault),
}

/// Quality of a grasp in all measures; the JSON of `mujoco-grasp quality`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct QualityReport {
    /// The thesis's Q \[N\].
    pub min_singular_value_n: f64,
    /// Ferrari and Canny's epsilon \[N\], see [`ferrari_canny`].
    pub ferrari_canny_n: f64,
    /// Volume of the wrench hull \[N^6\].
    pub hull_volume: f64,
    /// Smallest over largest singular value of G, 0 to 1.
    pub isotropy: f64,
    /// Whether the loaded contacts can resist any wrench if pressed hard enough: [`closure::force_closure`].
    pub force_closure: bool,
    /// Whether they hold the target's weight with no contact pressed harder than now: [`closure::load_factor`] is 1 or,
    /// since soft contacts carry the weight only to about that accuracy, at least 0.99.
    pub holds_own_weight: bool,
    /// Contacts that carry force; the others do not count as part of the grasp.
    pub contacts: usize,
}

/// All measures of a grasp. `com` is the target's centre of mass (world, m), `weight` the external wrench on the target
/// that it should hold, `[force; torque about com]` in world axes \[N, N m\]: its gravity.
///
/// # Errors
/// Contacts or vectors that are not numbers, or a computation that did not converge.
pub fn report(
    contacts: &[ContactForce],
    com: &Vector3<f64>,
    weight: &Vector6<f64>,
) -> Result<QualityReport, QualityError> {
    check(contacts, com)?;
    let loaded: Vec<ContactForce> = contacts
        .iter()
        .copied()
        .filter(|c| c.normal_force > 0.0)
        .collect();
    let singular = singular_values(&loaded, com)?;
    let hull = wrench_hull(&loaded, com)?;
    Ok(QualityReport {
        min_singular_value_n: singular[5],
        ferrari_canny_n: hull.inner_radius(),
        hull_volume: hull.volume(),
        isotropy: ratio(&singular),
        force_closure: closure::force_closure(&loaded, com)?,
        holds_own_weight: !loaded.is_empty() && closure::load_factor(&loaded, com, weight)? >= 0.99,
        contacts: loaded.len(),
    })
}

/// The thesis's Q \[N\]: the smallest singular value of G, by singular value decomposition of G itself. The reference
/// for [`Gram`], and no more accurate than it by design: below [`RANK_TOLERANCE`] of the largest both give 0.
///
/// # Errors
/// As [`report`].
pub fn min_singular_value(
    contacts: &[ContactForce],
    com: &Vector3<f64>,
) -> Result<f64, QualityError> {
    Ok(singular_values(contacts, com)?[5])
}

/// Smallest over largest singular value of G: 1 for a grasp equally strong in all directions, 0 without full rank.
///
/// # Errors
/// As [`report`].
pub fn isotropy(contacts: &[ContactForce], com: &Vector3<f64>) -> Result<f64, QualityError> {
    Ok(ratio(&singular_values(contacts, com)?))
}

/// The six singular values of G \[N\], falling.
///
/// # Errors
/// As [`report`].
pub fn singular_values(
    contacts: &[ContactForce],
    com: &Vector3<f64>,
) -> Result<[f64; 6], QualityError> {
    let columns = basis_wrenches(contacts, com)?;
    let width = columns.len().max(6);
    let g = Mat::from_fn(6, width, |i, j| columns.get(j).map_or(0.0, |w| w[i]));
    let values = g
        .singular_values()
        .map_err(|_| QualityError::SingularValues {
            contacts: contacts.len(),
        })?;
    let largest = values.first().copied().unwrap_or(0.0);
    Ok(std::array::from_fn(|k| {
        values
            .get(k)
            .copied()
            .filter(|&v| v > RANK_TOLERANCE * largest)
            .unwrap_or(0.0)
    }))
}

fn ratio(singular: &[f64; 6]) -> f64 {
    if singular[0] > 0.0 {
        singular[5] / singular[0]
    } else {
        0.0
    }
}

/// The columns of G \[N\]: per contact its normal force and both members of each friction pair.
///
/// # Errors
/// Contacts or a centre of mass that are not numbers.
pub fn basis_wrenches(
    contacts: &[ContactForce],
    com: &Vector3<f64>,
) -> Result<Vec<Vector6<f64>>, QualityError> {
    check(contacts, com)?;
    let radius = contact_radius(contacts);
    let mut columns = Vec::with_capacity(contacts.len() * 11);
    for c in contacts {
        columns.push(c.normal_wrench(com, radius) * c.normal_force);
        for (row, mu) in c.active_friction().iter().enumerate() {
            let friction = c.friction_wrench(row, com, radius) * (mu * c.normal_force);
            columns.extend([friction, -friction]);
        }
    }
    Ok(columns)
}

/// `G G'`, gathered contact by contact without allocating: Q in the hot loop.
///
/// Its eigenvalues are the squares of G's singular values, so values below [`RANK_TOLERANCE`] of the largest are lost in
/// rounding and count as 0. Nothing is checked here: a number that is not finite gives Q = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gram {
    matrix: Matrix6<f64>,
    com: Vector3<f64>,
    length: f64,
}

impl Gram {
    /// An empty grasp of a target with its centre of mass at `com` (world, m); torques will be divided by `length`
    /// \[m\], see [`contact_radius`]. With a length of 0 torques do not count and Q is 0.
    pub fn new(com: Vector3<f64>, length: f64) -> Self {
        Gram {
            matrix: Matrix6::zeros(),
            com,
            length,
        }
    }

    /// The grasp by `contacts`.
    pub fn of(contacts: &[ContactForce], com: &Vector3<f64>) -> Self {
        let mut gram = Gram::new(*com, contact_radius(contacts));
        for contact in contacts {
            gram.add(contact);
        }
        gram
    }

    /// Adds a contact's basis forces.
    pub fn add(&mut self, contact: &ContactForce) {
        let force = contact.normal_force;
        let normal = contact.normal_wrench(&self.com, self.length) * force;
        self.matrix += normal * normal.transpose();
        for (row, mu) in contact.active_friction().iter().enumerate() {
            // Both members of the symmetric pair.
            let pair = contact.friction_wrench(row, &self.com, self.length)
                * (std::f64::consts::SQRT_2 * mu * force);
            self.matrix += pair * pair.transpose();
        }
    }

    /// `G G'` \[N^2\].
    pub fn matrix(&self) -> &Matrix6<f64> {
        &self.matrix
    }

    /// Q \[N\].
    pub fn min_singular_value(&self) -> f64 {
        let Some(values) = eigenvalues(self.matrix) else {
            return 0.0;
        };
        let largest = values.iter().copied().fold(0.0, f64::max);
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        if least > RANK_TOLERANCE * RANK_TOLERANCE * largest {
            least.sqrt()
        } else {
            0.0
        }
    }

    /// Whether Q > `quality` \[N\], by one Cholesky factorisation of `G G' - quality^2 I`: for the test against a
    /// threshold in every step. A negative `quality` is always exceeded.
    pub fn exceeds(&self, quality: f64) -> bool {
        if quality.is_nan() || quality < 0.0 {
            return quality < 0.0;
        }
        let floor = RANK_TOLERANCE * RANK_TOLERANCE * self.matrix.trace();
        let shift = (quality * quality).max(floor);
        let mut l = self.matrix;
        for j in 0..6 {
            let mut pivot = l[(j, j)] - shift;
            for k in 0..j {
                pivot -= l[(j, k)] * l[(j, k)];
            }
            // Not `pivot <= 0`: a NaN must fail.
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            let scale = pivot.sqrt().recip();
            for i in j + 1..6 {
                let mut entry = l[(i, j)];
                for k in 0..j {
                    entry -= l[(i, k)] * l[(j, k)];
                }
                l[(i, j)] = entry * scale;
            }
        }
        true
    }
}

/// Eigenvalues of a symmetric matrix by cyclic Jacobi rotations, in no order; None if it is not finite. Jacobi needs no
/// allocation, always ends, and keeps small eigenvalues of positive definite matrices accurate.
fn eigenvalues(mut a: Matrix6<f64>) -> Option<[f64; 6]> {
    let size = a.norm();
    if !size.is_finite() {
        return None;
    }
    // Quadratic convergence: six sweeps do, twenty are a safe end.
    for _ in 0..20 {
        let mut off: f64 = 0.0;
        for p in 0..5 {
            for q in p + 1..6 {
                off = off.max(a[(p, q)].abs());
                rotate(&mut a, p, q);
            }
        }
        if off <= 1e-17 * size {
            break;
        }
    }
    Some(std::array::from_fn(|k| a[(k, k)]))
}

/// The Jacobi rotation that makes `a[(p, q)]` zero.
fn rotate(a: &mut Matrix6<f64>, p: usize, q: usize) {
    let off = a[(p, q)];
    if off == 0.0 {
        return;
    }
    let theta = (a[(q, q)] - a[(p, p)]) / (2.0 * off);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = t.hypot(1.0).recip();
    let s = t * c;
    for k in 0..6 {
        let (x, y) = (a[(k, p)], a[(k, q)]);
        a[(k, p)] = c * x - s * y;
        a[(k, q)] = s * x + c * y;
    }
    for k in 0..6 {
        let (x, y) = (a[(p, k)], a[(q, k)]);
        a[(p, k)] = c * x - s * y;
        a[(q, k)] = s * x + c * y;
    }
    a[(p, q)] = 0.0;
    a[(q, p)] = 0.0;
}

/// The default Q_Th \[N\] for a target of that weight \[N\] (mass times gravity; where there is no gravity, use what it
/// would be on earth): a tenth of the weight.
///
/// The thesis records, scene by scene, the least Q at which the target stays at rest under gravity. For the grasps with
/// closed forms that value follows from the weight W. N hard fingers around an equator carry it when `N mu f = W`; then
/// `Q = sqrt(N) mu f = W / sqrt N`: 0.58 W for three, 0.45 W for five, 0.32 W for ten. Two soft fingers carry it when
/// `2 mu f = W`; then `Q = 2 f mu_t / a = W mu_t / (mu a)`, with MuJoCo's default friction (1, 0.005 m) and objects up to
/// 10 cm across (a <= 5 cm) at least W / 10. So W / 10 is the largest round threshold that all of these pass by the time
/// they can just hold the target, and a grasp that holds with some reserve passes it clearly.
///
/// Lower is not dangerous: the grasp constraint keeps the cones of the contacts it replaces, so a latch too early slips
/// like the contacts would; a latch too high never comes.
pub fn default_latch_quality(weight: f64) -> f64 {
    LATCH_PER_WEIGHT * weight
}

/// The default Q_M \[N\] for a given Q_Th: a quarter of it. Q is linear in the forces, so at the same contacts the
/// fingers must have relaxed to a quarter of what latched them: wide enough that no push chatters, and passed at once
/// when a hand opens.
pub fn default_release_quality(latch_quality: f64) -> f64 {
    RELEASE_PER_LATCH * latch_quality
}

/// Ferrari and Canny's epsilon \[N\]: the radius of the largest ball about the origin in [`wrench_hull`]. Any wrench up
/// to this size (torques over [`contact_radius`]) can be resisted **with no contact pressed harder than now**: the hull
/// lies within the set of all wrenches that normal forces up to the live ones can exert. 0 without force closure.
///
/// # Errors
/// As [`report`].
pub fn ferrari_canny(contacts: &[ContactForce], com: &Vector3<f64>) -> Result<f64, QualityError> {
    Ok(wrench_hull(contacts, com)?.inner_radius())
}

/// Volume of [`wrench_hull`] \[N^6\].
///
/// # Errors
/// As [`report`].
pub fn hull_volume(contacts: &[ContactForce], com: &Vector3<f64>) -> Result<f64, QualityError> {
    Ok(wrench_hull(contacts, com)?.volume())
}

/// The convex hull of the union of all contacts' [`primitive_wrenches`]: Ferrari and Canny's (1992) first metric (L1:
/// the contacts share one effort), each contact scaled by its own live normal force.
///
/// # Errors
/// As [`report`].
pub fn wrench_hull(
    contacts: &[ContactForce],
    com: &Vector3<f64>,
) -> Result<ConvexHull, QualityError> {
    Ok(ConvexHull::new(&primitive_wrenches(contacts, com)?)?)
}

/// Wrenches about `com` \[N\] on the edges of the friction cones, linearised from inside, at the live normal forces: on
/// the elliptic cone `sum (f_j / mu_j)^2 <= f_n^2` the points at [`CONE_EDGES`] angles of the tangents, and the two with
/// pure torsion or rolling along each further axis of the condim; for a frictionless contact its normal force.
///
/// # Errors
/// Contacts or a centre of mass that are not numbers.
pub fn primitive_wrenches(
    contacts: &[ContactForce],
    com: &Vector3<f64>,
) -> Result<Vec<Vector6<f64>>, QualityError> {
    check(contacts, com)?;
    let radius = contact_radius(contacts);
    let mut wrenches = Vec::with_capacity(contacts.len() * (CONE_EDGES + 6));
    for c in contacts.iter().filter(|c| c.normal_force > 0.0) {
        let normal = c.normal_wrench(com, radius) * c.normal_force;
        let side =
            |row: usize| c.friction_wrench(row, com, radius) * (c.friction[row] * c.normal_force);
        if c.condim == 1 {
            wrenches.push(normal);
            continue;
        }
        for k in 0..CONE_EDGES {
            let angle = std::f64::consts::TAU * k as f64 / CONE_EDGES as f64;
            wrenches.push(normal + side(0) * angle.cos() + side(1) * angle.sin());
        }
        for row in 2..c.condim - 1 {
            wrenches.extend([normal + side(row), normal - side(row)]);
        }
    }
    Ok(wrenches)
}

/// Checks every contact and the centre of mass.
pub(crate) fn check(contacts: &[ContactForce], com: &Vector3<f64>) -> Result<(), QualityError> {
    for (index, contact) in contacts.iter().enumerate() {
        contact.check(index)?;
    }
    finite("target's centre of mass", com.as_slice())
}

/// An error naming `what` unless all values are finite.
pub(crate) fn finite(what: &'static str, values: &[f64]) -> Result<(), QualityError> {
    if values.iter().all(|x| x.is_finite()) {
        return Ok(());
    }
    Err(QualityError::NotFinite {
        what,
        value: values.to_vec(),
    })
}
