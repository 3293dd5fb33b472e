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
//! As in any sum of squares, a contact reported as k points that share its force counts less, `1 / sqrt(k)` of the one
//! point's share plus what the points' spread adds.
//!
//! Q knows ranks and sizes but not that contacts only push: an object lying on an open palm has Q > 0. Force closure and
//! Ferrari and Canny's epsilon do tell.

use faer::Mat;
use nalgebra::{Vector3, Vector6};
use serde::Serialize;

use crate::grasp::Grasp;
use crate::grasp::metrics::closure;
use crate::grasp::metrics::error::check;
pub use crate::grasp::metrics::error::{QualityError, SolverFault};
use crate::grasp::metrics::hull::ConvexHull;
pub use crate::grasp::monitor::gram::{Gram, RANK_TOLERANCE};
use crate::grasp::monitor::wrench::{LoadedContact, contact_radius};
use crate::mujoco::Simulation;

/// Edges of a linearised friction cone.
pub const CONE_EDGES: usize = 8;

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
    contacts: &[LoadedContact],
    com: &Vector3<f64>,
    weight: &Vector6<f64>,
) -> Result<QualityReport, QualityError> {
    check(contacts, com)?;
    let loaded: Vec<LoadedContact> = contacts.iter().copied().filter(|c| c.normal_force > 0.0).collect();
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

/// All measures of a grasp with the contacts of its effectors after the last step, and the target's weight to hold.
///
/// # Errors
/// As [`report`].
pub fn of_grasp(sim: &Simulation, grasp: &Grasp) -> Result<QualityReport, QualityError> {
    let effectors = grasp.contacts().iter().filter(|contact| grasp.links().contains(&contact.link_id));
    let contacts: Vec<LoadedContact> = effectors.map(|contact| contact.loaded()).collect();
    let (model, target) = (sim.model(), grasp.target());
    let gravity = if model.has_gravity() { model.gravity() } else { Vector3::zeros() };
    let force = model.body_subtreemass()[target.index()] * gravity;
    let weight = Vector6::new(force.x, force.y, force.z, 0.0, 0.0, 0.0);
    report(&contacts, &sim.subtree_com_of(target), &weight)
}

/// The thesis's Q \[N\]: the smallest singular value of G, by singular value decomposition of G itself. The reference
/// for [`Gram`], and no more accurate than it by design: below [`RANK_TOLERANCE`] of the largest both give 0.
///
/// # Errors
/// As [`report`].
pub fn min_singular_value(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<f64, QualityError> {
    Ok(singular_values(contacts, com)?[5])
}

/// Smallest over largest singular value of G: 1 for a grasp equally strong in all directions, 0 without full rank.
///
/// # Errors
/// As [`report`].
pub fn isotropy(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<f64, QualityError> {
    Ok(ratio(&singular_values(contacts, com)?))
}

/// The six singular values of G \[N\], falling.
///
/// # Errors
/// As [`report`].
pub fn singular_values(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<[f64; 6], QualityError> {
    let columns = basis_wrenches(contacts, com)?;
    let width = columns.len().max(6);
    let g = Mat::from_fn(6, width, |i, j| columns.get(j).map_or(0.0, |w| w[i]));
    let values = g.singular_values().map_err(|_| QualityError::SingularValues { contacts: contacts.len() })?;
    let largest = values.first().copied().unwrap_or(0.0);
    Ok(std::array::from_fn(|k| values.get(k).copied().filter(|&v| v > RANK_TOLERANCE * largest).unwrap_or(0.0)))
}

fn ratio(singular: &[f64; 6]) -> f64 {
    if singular[0] > 0.0 { singular[5] / singular[0] } else { 0.0 }
}

/// The columns of G \[N\]: per contact its normal force and both members of each friction pair.
///
/// # Errors
/// Contacts or a centre of mass that are not numbers.
pub fn basis_wrenches(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<Vec<Vector6<f64>>, QualityError> {
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

/// Ferrari and Canny's epsilon \[N\]: the radius of the largest ball about the origin in [`wrench_hull`]. Any wrench up
/// to this size (torques over [`contact_radius`]) can be resisted **with no contact pressed harder than now**: the hull
/// lies within the set of all wrenches that normal forces up to the live ones can exert. 0 without force closure.
///
/// # Errors
/// As [`report`].
pub fn ferrari_canny(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<f64, QualityError> {
    Ok(wrench_hull(contacts, com)?.inner_radius())
}

/// Volume of [`wrench_hull`] \[N^6\].
///
/// # Errors
/// As [`report`].
pub fn hull_volume(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<f64, QualityError> {
    Ok(wrench_hull(contacts, com)?.volume())
}

/// The convex hull of the union of all contacts' [`primitive_wrenches`]: Ferrari and Canny's (1992) first metric (L1:
/// the contacts share one effort), each contact scaled by its own live normal force.
///
/// # Errors
/// As [`report`].
pub fn wrench_hull(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<ConvexHull, QualityError> {
    Ok(ConvexHull::new(&primitive_wrenches(contacts, com)?)?)
}

/// Wrenches about `com` \[N\] on the edges of the friction cones, linearised from inside, at the live normal forces: on
/// the elliptic cone `sum (f_j / mu_j)^2 <= f_n^2` the points at [`CONE_EDGES`] angles of the tangents, and the two with
/// pure torsion or rolling along each further axis of the condim; for a frictionless contact its normal force.
///
/// # Errors
/// Contacts or a centre of mass that are not numbers.
pub fn primitive_wrenches(contacts: &[LoadedContact], com: &Vector3<f64>) -> Result<Vec<Vector6<f64>>, QualityError> {
    check(contacts, com)?;
    let radius = contact_radius(contacts);
    let mut wrenches = Vec::with_capacity(contacts.len() * (CONE_EDGES + 6));
    for c in contacts.iter().filter(|c| c.normal_force > 0.0) {
        let normal = c.normal_wrench(com, radius) * c.normal_force;
        let side = |row: usize| c.friction_wrench(row, com, radius) * (c.friction[row] * c.normal_force);
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
