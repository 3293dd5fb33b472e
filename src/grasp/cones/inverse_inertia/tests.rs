use super::*;
use crate::grasp::GraspId;
use crate::grasp::cones::arrow::ROOT;
use crate::grasp::contact::cost::{ActiveSet, Cost};
use crate::scenario::plan::Plan;
use crate::scenario::runner::{Mode, Runner};

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

/// As a step with new poses has it, of which only the state is wanted: a force then moves the joints by that mass matrix, and
/// contacts are solved for it.
#[test]
fn a_finger_is_moved_by_the_mass_matrix_that_there_is_though_it_be_of_an_earlier_pose() {
    for scenario in ["clutch", "two-hands"] {
        let plan = Plan::load(scenario).expect("a built-in scenario");
        let mut runner = Runner::new(&plan, Mode::Grasp, None).expect("a runner");
        runner.advance_to(plan.timeline.measure_from()).expect("a hold");
        let (mut sim, grasps) = runner.into_parts();
        sim.forward().expect("a forward pass");
        let topology = grasps[GraspId::FIRST].topology();
        sim.qpos_mut().iter_mut().enumerate().for_each(|(i, q)| *q += 1e-2 * (0.4 + 2.3 * i as f64).sin());
        sim.kinematics().expect("poses");
        let dynamics = Dynamics::of(&sim);
        let mut hand = HandInverseInertia::new(topology, sim.model().dof_parentid());
        hand.palm.update(&dynamics, topology.leaf(topology.palm()));
        hand.palm.find_accelerations(&dynamics);
        for finger in 0..hand.fingers.len() {
            let joints = &mut hand.fingers[finger];
            joints.update(&dynamics);
            let leaf = *topology.fingers()[finger].last().expect("a joint");
            let wrench = Spatial::new(0.3, -1.2, 0.7, 2.0, -0.4, 0.9);

            let mut arrow = Arrow::default();
            arrow.begin(hand.palm.rank());
            arrow.begin_branch(topology.fingers()[finger].len());
            joints.set_inertia(&dynamics, &hand.palm, &mut arrow, 0);
            let block = arrow.add_block(Cost::Still, ActiveSet::Open, &[0.0], &[0.0]);
            let (of_palm, own) = arrow.row(block, 0);
            hand.palm.own(&wrench, of_palm);
            joints.row(leaf, &wrench, own);
            arrow.end_branch();
            arrow.solve(&mut [0.0; ROOT]);
            let mobility = arrow.row_mobility(block, 0);

            let mut row = vec![0.0; sim.model().nv()];
            dynamics.with_ancestors(leaf).for_each(|dof| row[dof] = dynamics.axis(dof).dot(&wrench));
            let mut moved = row.clone();
            sim.solve_mass(&mut moved).expect("accelerations");
            let expected = row.iter().zip(&moved).map(|(a, b)| a * b).sum::<f64>();
            let apart = (mobility / expected - 1.0).abs();
            println!("{scenario}, finger {finger}: {mobility} / kg, {apart} apart");
            assert!(apart < 1e-5, "{scenario}, finger {finger}: {mobility}, not {expected}");
        }
    }
}
