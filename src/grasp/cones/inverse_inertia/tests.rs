use super::*;

/// An arm of eight joints.
fn arm() -> BodyInverseInertia {
    let mut arm = BodyInverseInertia { chain: (0..8).collect(), columns: axes(), ..BodyInverseInertia::default() };
    arm.factorize();
    arm
}

fn axes() -> Vec<Spatial> {
    (0..8).map(|k| Spatial::from_fn(|i, _| (1.7 * k as f64 + 2.3 * i as f64 + 0.4).sin())).collect()
}

/// A row beside others.
fn beside(x: f64) -> Lanes {
    [0.0, x, -2.0 * x, 0.0]
}

/// Rounding that was left in the row tied all fingers of a hand on a long arm to each other.
#[test]
fn what_acts_through_the_palm_leaves_nothing_on_a_long_arm() {
    let arm = arm();
    let wrench = Spatial::new(0.3, -1.2, 0.7, 2.0, -0.4, 0.9);
    let mut rows: Vec<Lanes> = axes().iter().map(|axis| beside(axis.dot(&wrench))).chain([beside(5.0)]).collect();
    let mut y = [[0.0; LANES]; 6];
    arm.take(&mut rows, &mut y);
    assert_eq!(rows[..8], [[0.0; LANES]; 8]);
    assert_eq!(rows[8], beside(5.0), "a finger's joint is not the arm's");
    for (lane, share) in beside(1.0).into_iter().enumerate() {
        let y = Spatial::from(y.map(|y| y[lane]));
        assert!((arm.factor.tr_mul(&wrench) * share - y).norm() < 1e-12);
    }
}

#[test]
fn what_acts_on_the_arm_alone_leaves_the_palm_at_rest() {
    let arm = arm();
    let mut rows = vec![[0.0; LANES]; 8];
    rows[2] = beside(1.0);
    let mut y = [[0.0; LANES]; 6];
    arm.take(&mut rows, &mut y);
    let moved = axes().iter().zip(&rows).fold(Spatial::zeros(), |sum, (axis, x)| sum + axis * x[1]);
    assert!(moved.norm() < 1e-12 && rows.iter().any(|x| x[1].abs() > 0.01));
    let size = rows.iter().chain(&y).map(|x| x[1] * x[1]).sum::<f64>();
    assert!((size - 1.0).abs() < 1e-12, "the parts are orthogonal");
}
