//! One grasped step against the engine's converged solve of the same step.

use mujoco_grasp::grasp::{GraspContact, Grasps};
use mujoco_grasp::mujoco::{Simulation, Solver};

/// The engine's own solve of the step that `sim` is about to make, with Newton's method to the last digit.
pub fn engine(sim: &Simulation) -> Simulation {
    let mut exact = sim.clone();
    exact.set_solver(Solver::Newton).expect("Newton");
    exact.set_noslip_iterations(0).expect("no noslip");
    exact.set_iterations(300).expect("iterations");
    exact.set_tolerance(0.0).expect("a tolerance");
    Grasps::new().step(&mut exact).expect("a step");
    exact
}

/// Largest difference of a normal force from the engine's, relative to the largest normal force.
pub fn difference(exact: &Simulation, contacts: &[GraspContact]) -> f64 {
    let (mut worst, mut largest) = (0.0f64, f64::MIN_POSITIVE);
    for contact in contacts {
        let distance = |c: &mujoco_grasp::mujoco::Contact| (c.position - contact.position).norm();
        let (i, _) = exact
            .contacts()
            .enumerate()
            .filter(|(_, c)| c.geoms.map(|g| g.index()) == [contact.geoms.0, contact.geoms.1])
            .min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)))
            .expect("the same contact");
        let sign = if contact.target_first { -1.0 } else { 1.0 };
        let normal = sign * exact.contact_force(i).expect("a force").force.dot(&contact.axes[0]);
        worst = worst.max((normal - contact.normal_force()).abs());
        largest = largest.max(normal);
    }
    worst / largest
}
