use super::*;

/// An arm of eight joints.
fn arm() -> BodyInverseInertia {
    let columns: Vec<Spatial> =
        (0..8).map(|k| Spatial::from_fn(|i, _| (1.7 * k as f64 + 2.3 * i as f64 + 0.4).sin())).collect();
    let inverse_inertia = columns.iter().fold(Matrix6::zeros(), |sum, column| sum + column * column.transpose());
    BodyInverseInertia {
        factor: semidefinite_factor(&inverse_inertia),
        smooth: Spatial::zeros(),
        chain: (0..8).collect(),
        columns,
    }
}

/// Rounding that was left in the row tied all fingers of a hand on a long arm to each other.
#[test]
fn what_acts_through_the_palm_leaves_nothing_on_a_long_arm() {
    let arm = arm();
    let wrench = Spatial::new(0.3, -1.2, 0.7, 2.0, -0.4, 0.9);
    let mut row: Vec<f64> = arm.columns.iter().map(|column| column.dot(&wrench)).chain([5.0]).collect();
    let mut y = [0.0; 6];
    arm.take(&mut row, &mut y);
    let y = Spatial::from(y);
    assert_eq!(row[..8], [0.0; 8]);
    assert_eq!(row[8], 5.0, "a finger's joint is not the arm's");
    assert!((arm.factor.tr_mul(&wrench) - y).norm() < 1e-12);
}

#[test]
fn what_acts_on_the_arm_alone_leaves_the_palm_at_rest() {
    let arm = arm();
    let mut row = vec![0.0; 8];
    row[2] = 1.0;
    let mut y = [0.0; 6];
    arm.take(&mut row, &mut y);
    let y = Spatial::from(y);
    let moved = arm.columns.iter().zip(&row).fold(Spatial::zeros(), |sum, (column, x)| sum + column * *x);
    assert!(moved.norm() < 1e-12 && row.iter().any(|x| x.abs() > 0.01));
    let size = row.iter().map(|x| x * x).sum::<f64>() + y.norm_squared();
    assert!((size - 1.0).abs() < 1e-12, "the parts are orthogonal");
}
