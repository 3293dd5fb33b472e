//! The contact laws against an independent conic solver, their derivatives against differences.

use crate::oracle;
use mujoco_grasp::grasp::contact::cost::{ActiveSet, Bound, Cost, MAX_ROWS};
use proptest::prelude::*;

fn friction() -> impl Strategy<Value = [f64; 5]> {
    (0.2..1.5f64, 0.2..1.5f64, 0.01..0.2f64, 0.01..0.2f64, 0.01..0.2f64).prop_map(|(a, b, c, d, e)| [a, b, c, d, e])
}

fn residual(rows: usize) -> impl Strategy<Value = Vec<f64>> {
    // spin and rolling residuals are larger than linear ones by about 1 / friction
    proptest::collection::vec(-3.0..3.0f64, rows).prop_map(|mut v| {
        for x in v.iter_mut().skip(3) {
            *x *= 10.0;
        }
        v
    })
}

fn soft() -> impl Strategy<Value = (Cost, Vec<f64>)> {
    (0.3..3.0f64, 0.2..1.5f64, friction(), prop_oneof![Just(3usize), Just(4), Just(6)], any::<bool>()).prop_flat_map(
        |(stiffness, cone, friction, rows, pyramidal)| {
            let law = if pyramidal {
                Cost::Pyramidal { stiffness, friction }
            } else {
                Cost::Elliptic { stiffness, cone, friction }
            };
            residual(rows).prop_map(move |jar| (law, jar))
        },
    )
}

fn slip() -> impl Strategy<Value = (Cost, Vec<f64>)> {
    (
        0.3..3.0f64,
        friction(),
        0.1..2.0f64,
        proptest::array::uniform5(0.05..2.0f64),
        proptest::array::uniform5(-1.0..1.0f64),
        prop_oneof![Just(2usize), Just(3), Just(5)],
        any::<bool>(),
    )
        .prop_flat_map(|(resistance, friction, normal, normals, unit, rows, boxed)| {
            let mut centre = [0.0; 5];
            for j in 0..5 {
                centre[j] = 0.5 * friction[j] * normal * unit[j];
            }
            let bound = if boxed { Bound::Box(normals) } else { Bound::Ellipsoid(normal) };
            let law = Cost::Slip { centre, resistance, friction, bound };
            residual(rows + 1).prop_map(move |jar| (law, jar[1..].to_vec()))
        })
}

/// An interior point method stops short of the boundary: ours must be as close as that method gets, feasible, and
/// no worse in the objective that both minimise.
fn assert_projection(law: &Cost, jar: &[f64]) -> Result<(), TestCaseError> {
    let ours = nalgebra::DVector::from_column_slice(&law.respond(jar).force[..jar.len()]);
    let oracle = oracle::project(law, jar);
    if matches!(law, Cost::Pyramidal { .. }) {
        prop_assert!((&ours - &oracle).norm() < 2e-3 * (1.0 + oracle.norm()), "{ours} and {oracle}");
    } else {
        // strongly convex: feasible and no worse than the oracle means the same point
        let gap = oracle::objective(law, jar, &ours) - oracle::objective(law, jar, &oracle);
        prop_assert!(gap < 1e-7, "objective is {gap} above the oracle's");
        prop_assert!(oracle::violation(law, &ours) < 1e-9, "outside the cone: {ours}");
    }
    Ok(())
}

/// Force and Hessian are the first and second differences of the cost.
fn assert_derivatives(law: &Cost, jar: &[f64]) -> Result<(), TestCaseError> {
    let h = 1e-6;
    let at = law.respond(jar);
    for j in 0..jar.len() {
        let (mut up, mut down) = (jar.to_vec(), jar.to_vec());
        up[j] += h;
        down[j] -= h;
        let (up, down) = (law.respond(&up), law.respond(&down));
        prop_assert!(((down.cost - up.cost) / (2.0 * h) - at.force[j]).abs() < 1e-4 * (1.0 + at.force[j].abs()));
        if up.active_set != at.active_set || down.active_set != at.active_set {
            continue; // the Hessian jumps between zones
        }
        for i in 0..jar.len() {
            let difference = (down.force[i] - up.force[i]) / (2.0 * h);
            let hessian = at.hessian[i * MAX_ROWS + j];
            prop_assert!(
                (difference - hessian).abs() < 1e-4 * (1.0 + hessian.abs()),
                "{i},{j}: {difference} {hessian}"
            );
        }
    }
    Ok(())
}

fn assert_positive(law: &Cost, jar: &[f64]) -> Result<(), TestCaseError> {
    let at = law.respond(jar);
    let n = jar.len();
    let h = nalgebra::DMatrix::from_fn(n, n, |i, j| at.hessian[i * MAX_ROWS + j]);
    prop_assert!((&h - h.transpose()).norm() <= 1e-12 * (1.0 + h.norm()));
    prop_assert!(
        h.symmetric_eigenvalues().min() > -1e-9 * (1.0 + at.hessian.iter().fold(0.0f64, |a, b| a.max(b.abs())))
    );
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    #[test]
    fn soft_law_is_the_projection_in_the_metric_of_the_softness((law, jar) in soft()) {
        assert_projection(&law, &jar)?;
    }

    #[test]
    fn slip_law_is_the_proximal_step_within_the_bound((law, jar) in slip()) {
        assert_projection(&law, &jar)?;
    }

    #[test]
    fn derivatives_match_differences((law, jar) in prop_oneof![soft(), slip()]) {
        assert_derivatives(&law, &jar)?;
        assert_positive(&law, &jar)?;
    }
}

/// Each branch of each law is reached by hand, so that the random cases above are not the only ones who see it.
#[test]
fn every_branch() {
    let friction = [0.8, 0.8, 0.01, 0.01, 0.01];
    let elliptic = Cost::Elliptic { stiffness: 2.0, cone: 0.8, friction };
    let pyramid = Cost::Pyramidal { stiffness: 2.0, friction };
    let slip = |bound| Cost::Slip { centre: [0.1, 0.0, 0.0, 0.0, 0.0], resistance: 0.5, friction, bound };
    let cases: [(Cost, &[f64], ActiveSet); 9] = [
        (Cost::Unilateral { stiffness: 2.0 }, &[0.5], ActiveSet::Open),
        (Cost::Unilateral { stiffness: 2.0 }, &[-0.5], ActiveSet::Stick),
        (elliptic, &[1.0, 0.2, 0.0], ActiveSet::Open),
        (elliptic, &[-1.0, 0.2, 0.0], ActiveSet::Stick),
        (elliptic, &[0.1, 1.0, 0.5], ActiveSet::Slide),
        (pyramid, &[1.0, 0.2, 0.0], ActiveSet::Open),
        (pyramid, &[-1.0, 0.1, 0.2], ActiveSet::Facet(0b1111)),
        (slip(Bound::Ellipsoid(1.0)), &[0.1, 0.1], ActiveSet::Stick),
        (slip(Bound::Box([0.3; 5])), &[3.0, 0.01], ActiveSet::Facet(0b01)),
    ];
    for (law, jar, zone) in cases {
        let response = law.respond(jar);
        assert_eq!(response.active_set, zone, "{law:?} at {jar:?}");
        let oracle = oracle::project(&law, jar);
        for j in 0..jar.len() {
            assert!((response.force[j] - oracle[j]).abs() < 1e-4, "{law:?} at {jar:?}: {:?} {oracle}", response.force);
        }
    }
    // a contact without normal force has no friction
    assert_eq!(slip(Bound::Ellipsoid(0.0)).respond(&[1.0, 1.0]).force, [0.0; MAX_ROWS]);
    // head-on: no tangential residual at all
    assert_eq!(elliptic.respond(&[-1.0, 0.0, 0.0]).force[0], 2.0);
    assert_eq!(elliptic.respond(&[0.0, 0.0, 0.0]).active_set, ActiveSet::Open);
}
