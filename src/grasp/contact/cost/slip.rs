//! Friction under a known normal force: proximal steps projected onto what it allows.

use super::{ActiveSet, MAX_ROWS, Response};

/// `s(jar) = max_f { -f.jar - sum r_j/2 (f_j - c_j)^2 }` over the ellipsoid, `r_j = kappa / mu_j^2`: in `f_j / mu_j`
/// the metric is isotropic and the projection radial.
pub(in crate::grasp) fn slip_ellipsoid(
    out: &mut Response,
    jar: &[f64],
    centre: &[f64; 5],
    kappa: f64,
    friction: &[f64; 5],
    normal: f64,
) {
    let dim = jar.len();
    let mut trial = [0.0; 5];
    let mut length = 0.0;
    for j in 0..dim {
        trial[j] = centre[j] / friction[j] - jar[j] * friction[j] / kappa;
        length += trial[j] * trial[j];
    }
    let length = length.sqrt();
    let sliding = length > normal;
    let shrink = if sliding { normal / length } else { 1.0 };
    for j in 0..dim {
        out.force[j] = friction[j] * shrink * trial[j];
        let off = (out.force[j] - centre[j]) / friction[j];
        out.cost -= out.force[j] * jar[j] + 0.5 * kappa * off * off;
    }
    for i in 0..dim {
        for j in 0..=i {
            let mut h = if i == j { 1.0 } else { 0.0 };
            if sliding {
                h -= trial[i] * trial[j] / (length * length);
            }
            h *= shrink * friction[i] * friction[j] / kappa;
            out.hessian[i * MAX_ROWS + j] = h;
            out.hessian[j * MAX_ROWS + i] = h;
        }
    }
    out.active_set = if sliding { ActiveSet::Slide } else { ActiveSet::Stick };
}

pub(in crate::grasp) fn slip_box(
    out: &mut Response,
    jar: &[f64],
    centre: &[f64; 5],
    kappa: f64,
    friction: &[f64; 5],
    normals: &[f64; 5],
) {
    let mut saturated = 0;
    for j in 0..jar.len() {
        let resistance = kappa / (friction[j] * friction[j]);
        let limit = friction[j] * normals[j];
        let trial = centre[j] - jar[j] / resistance;
        out.force[j] = trial.clamp(-limit, limit);
        if trial.abs() < limit {
            out.hessian[j * MAX_ROWS + j] = 1.0 / resistance;
        } else {
            saturated |= 1 << (2 * j + usize::from(trial > 0.0));
        }
        let off = out.force[j] - centre[j];
        out.cost -= out.force[j] * jar[j] + 0.5 * resistance * off * off;
    }
    out.active_set = ActiveSet::Facet(saturated);
}
