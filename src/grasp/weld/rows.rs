//! The weld equality that carries a merged grasp: its element, finding it, and what its rows can be.
//!
//! The weld is in the model for its six constraint rows only. It is switched on while the rows are made and off right
//! after, so that nothing else ever sees it active; Jacobian, reference and regularisation are overwritten.

use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::grasp::spec::Limits;
use crate::mujoco::{EqualityId, EqualityKind, Simulation};
use nalgebra::{Matrix6, Vector6};

/// Rows of a weld.
pub const WELD_ROWS: usize = 6;

/// The elements that a model needs, besides its own, for a grasp of body `target` with [`Limits::Box`] or
/// [`Limits::Rigid`]: a weld, switched off and without a name. To be added after all other equality constraints, as
/// `Model::from_xml_file_with` does with its second argument.
///
/// `hand` is any body of the hand that has a name; without, the weld's other side is the world. Either serves; two hands
/// that grasp the same target need a weld each, told apart by `hand`.
pub fn weld_xml(target: &str, hand: Option<&str>) -> String {
    let target = escape(target);
    let bodies = match hand {
        Some(hand) => format!("body1=\"{}\" body2=\"{target}\"", escape(hand)),
        None => format!("body1=\"{target}\""),
    };
    format!("<equality><weld {bodies} active=\"false\"/></equality>")
}

fn escape(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// The last weld between the target and the hand, or else between the target and the world.
pub(in crate::grasp) fn find(
    sim: &Simulation,
    topology: &Topology,
    limits: Limits,
    target: &str,
) -> Result<EqualityId, Error> {
    let model = sim.model();
    let welds = |other: &dyn Fn(usize) -> bool| {
        model
            .equalities()
            .filter(|&id| model.equality_kind(id) == Some(EqualityKind::Weld))
            .filter(|&id| {
                let bodies = model.equality_bodies(id).map(|bodies| bodies.map(|body| body.index()));
                bodies.is_some_and(|[a, b]| (topology.in_target(a) && other(b)) || (topology.in_target(b) && other(a)))
            })
            .last()
    };
    let weld = welds(&|body| topology.in_hand(body))
        .or_else(|| welds(&|body| body == 0))
        .ok_or_else(|| Error::NoWeld { limits: limits.name(), target: target.to_string() })?;
    if sim.is_equality_active(weld)? {
        return Err(Error::WeldActive(target.to_string()));
    }
    Ok(weld)
}

/// Splits the merged softness `N` into a diagonal `D >= N`, which the rows' regularisation can be, and the excess
/// `D - N`, which multiplies the last step's wrench in the reference: `J a + D l = aref + (D - N) l_last` has the solution
/// of `J a + N l = aref` as its fixed point and comes nearer to it in every step, since `0 <= D - N < D + J M^-1 J^T`.
pub(in crate::grasp) fn regularise(softness: &Matrix6<f64>) -> ([f64; WELD_ROWS], Matrix6<f64>) {
    let diagonal: [f64; WELD_ROWS] = std::array::from_fn(|i| {
        (0..WELD_ROWS).map(|j| softness[(i, j)].abs() * (softness[(i, i)] / softness[(j, j)]).sqrt()).sum()
    });
    (diagonal, Matrix6::from_diagonal(&Vector6::from(diagonal)) - softness)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn softness_matrix(seed: f64) -> Matrix6<f64> {
        let b = Matrix6::from_fn(|i, j| (seed + 2.3 * i as f64 + 1.1 * (i * j) as f64).sin());
        let scale = Matrix6::from_diagonal(&Vector6::new(1.0, 2.0, 1.0, 300.0, 500.0, 200.0));
        scale * (b * b.transpose() + Matrix6::identity() * 1e-3) * scale
    }

    #[test]
    fn regularisation_bounds_the_softness_and_its_lag_settles_on_the_solution() {
        for seed in [0.1, 1.3, 2.9, 4.2] {
            let n = softness_matrix(seed);
            let (d, excess) = regularise(&n);
            let diagonal = Matrix6::from_diagonal(&Vector6::from(d));
            let scaled = |m: &Matrix6<f64>| {
                let s = Matrix6::from_diagonal(&Vector6::from_fn(|i, _| d[i].sqrt().recip()));
                s * m * s
            };
            let least = scaled(&excess).symmetric_eigenvalues().min();
            assert!(least > -1e-12, "D - N must not be negative: {least}");
            assert!((diagonal - excess - n).amax() < 1e-12 * n.amax());
            // a light target: little inverse inertia beside the softness, the slowest case
            let a = scaled(&n).map(|x| 0.01 * x) + Matrix6::identity() * 0.01;
            let (n, excess) = (scaled(&n), scaled(&excess));
            let b = Vector6::new(1.0, -2.0, 0.5, 0.3, 0.8, -1.0);
            let solution = (a + n).lu().solve(&b).unwrap();
            let mut x = Vector6::zeros();
            let mut error = solution.norm();
            for _ in 0..3000 {
                x = (a + Matrix6::identity()).lu().solve(&(b + excess * x)).unwrap();
                let now = (x - solution).norm();
                assert!(now <= error * (1.0 + 1e-9) + 1e-12);
                error = now;
            }
            assert!(error < 1e-6 * solution.norm(), "{error}");
        }
    }
}
