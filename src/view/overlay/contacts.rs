//! Contacts as discs, their friction cones as nets, their forces as arrows: one that slides ends on the rim of its cone.

use nalgebra::Vector3;

use super::load_colour;
use crate::grasp::{Grasp, GraspContact};
use crate::mujoco::{Arrow, Cone, Drawing, Segment, Simulation};

/// Spokes of a net.
const SPOKES: usize = 16;
/// Thickness, radius of discs and width of arrows, in parts of the target's radius.
const THICKNESS: f64 = 0.01;
const DISC: f64 = 0.09;
const SHAFT: f64 = 0.025;

/// A force like the target's weight is as long as this part of the target's radius: a hand that holds it against a push presses
/// several times as hard, and its cones are to leave something to be seen.
const WEIGHT: f64 = 0.5;
/// The largest normal force is at most as long: hands press up to a hundred times as hard as their target weighs.
const LONGEST: f64 = 1.5;

/// Adds the contacts of a grasp: discs and cones, and forces.
pub fn add(sim: &Simulation, grasp: &Grasp, (contacts, forces): (bool, bool), drawing: &mut Drawing) {
    let radius = radius(sim, grasp);
    let largest = grasp.contacts().iter().map(GraspContact::normal_force).fold(1e-6, f64::max);
    let scale = radius * (WEIGHT / weight(sim, grasp)).min(LONGEST / largest);
    let cone = sim.model().cone();
    for contact in grasp.contacts() {
        let share = contact.friction_share(cone).unwrap_or(0.0);
        let [r, g, b] = load_colour(share);
        if contacts {
            let half = 0.5 * THICKNESS * radius * contact.axes[0];
            let ends = [contact.position - half, contact.position + half];
            drawing.segments.push(Segment { ends, radius: Some(DISC * radius), rgba: [r, g, b, 0.9] });
            net(contact, cone, scale, [r, g, b, 0.5], drawing);
        }
        if forces {
            let arrow = Arrow::from_point(contact.position, contact.force, scale, [r, g, b, 1.0]);
            drawing.arrows.push(arrow.with_width(SHAFT * radius));
        }
    }
}

/// The cone of forces with the contact's normal force and no more friction than it has; of torsion and rolling nothing is
/// seen.
fn net(contact: &GraspContact, cone: Cone, scale: f64, rgba: [f32; 4], drawing: &mut Drawing) {
    let height = scale * contact.normal_force();
    if contact.parameters.condim < 3 || height == 0.0 {
        return;
    }
    let [normal, first, second] = &contact.axes;
    let [mu_1, mu_2] = [contact.parameters.friction[0], contact.parameters.friction[1]];
    let spokes = if cone == Cone::Elliptic { SPOKES } else { 4 };
    let rim: Vec<Vector3<f64>> = (0..spokes)
        .map(|i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / spokes as f64).sin_cos();
            contact.position + height * (normal + mu_1 * cos * first + mu_2 * sin * second)
        })
        .collect();
    for (i, point) in rim.iter().enumerate() {
        drawing.segments.push(Segment::line(*point, rim[(i + 1) % spokes], rgba));
        if i % 4 == 0 || spokes == 4 {
            drawing.segments.push(Segment::line(contact.position, *point, rgba));
        }
    }
}

/// Of the target on earth, whatever the model's gravity is \[N\].
fn weight(sim: &Simulation, grasp: &Grasp) -> f64 {
    (9.81 * sim.model().body_subtreemass()[grasp.target().index()]).max(1e-6)
}

/// Between that of the largest sphere about a geom of the target and that of the ball with its mass and least moment of inertia,
/// which is about how thick it is \[m\]: by the first alone the forces on a baton would be longer than the arms that hold it.
fn radius(sim: &Simulation, grasp: &Grasp) -> f64 {
    let (model, target) = (sim.model(), grasp.target().index());
    let own = model.geom_bodyid().iter().zip(model.geom_rbound()).filter(|(owner, _)| **owner == target as i32);
    let about = own.map(|(_, radius)| *radius).fold(0.0, f64::max).max(1e-3);
    let inertia = model.body_inertia()[3 * target..3 * target + 3].iter().copied().fold(f64::INFINITY, f64::min);
    let thick = (2.5 * inertia / model.body_mass()[target]).sqrt();
    if thick.is_finite() && thick > 0.0 { (about * thick).sqrt().min(about) } else { about }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasp::{GraspId, Phase};
    use crate::scenario::plan::Plan;
    use crate::view::Session;

    /// Those on the baton of the handover were longer than the arms.
    #[test]
    fn forces_are_not_much_longer_than_the_target_is_thick() {
        let mut session = Session::new(&Plan::load("handover").unwrap()).unwrap();
        while session.time() < 2.5 {
            session.step().unwrap();
        }
        let grasp = &session.grasps()[GraspId::FIRST];
        assert_eq!(grasp.phase(), Phase::Grasped);
        let mut drawing = Drawing::default();
        add(session.sim(), grasp, (false, true), &mut drawing);
        let longest = drawing.arrows.iter().map(|arrow| arrow.vector.norm()).fold(0.0, f64::max);
        assert!((0.02..0.12).contains(&longest), "{longest} m");
    }
}
