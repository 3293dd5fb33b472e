//! Contacts: what they say, and the sign of their forces.

use mujoco_grasp::mujoco::{BodyId, Cone, Model, Simulation};
use nalgebra::{Matrix3, Vector3};

/// A ball of 2 kg on a plane; the plane is the first geom.
const BALL: &str = r#"<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="ball" pos="0 0 0.1"><freejoint/><geom name="ball" type="sphere" size="0.1" mass="2"/></body>
</worldbody></mujoco>"#;

fn settled(cone: Cone) -> Simulation {
    let mut sim = Simulation::new(&Model::from_xml_string(BALL).unwrap()).unwrap();
    sim.set_cone(cone).unwrap();
    for _ in 0..2000 {
        sim.step().unwrap();
    }
    sim
}

#[test]
fn a_resting_ball_is_pushed_up_by_its_weight() {
    for cone in [Cone::Pyramidal, Cone::Elliptic] {
        let sim = settled(cone);
        let ball = sim.model().body("ball").unwrap();
        assert_eq!(sim.contact_count(), 1);
        let contact = sim.contact(0).unwrap();
        assert_eq!(contact.bodies, [BodyId::WORLD, ball]);
        assert_eq!(contact.other_body(ball), Some(BodyId::WORLD));
        assert_eq!(
            contact
                .geoms
                .map(|geom| sim.model().geom_name(geom).unwrap().to_string()),
            ["floor", "ball"]
        );
        // The normal points from geom 1 (floor) to geom 2 (ball): up. So does the force on the ball.
        assert!((contact.normal() - Vector3::z()).norm() < 1e-12);
        let force = sim.contact_force(0).unwrap();
        assert!(
            (force.force - Vector3::new(0.0, 0.0, 2.0 * 9.81)).norm() < 1e-6,
            "{cone:?}: {force:?}"
        );
        assert!(force.torque.norm() < 1e-9);
    }
}

#[test]
fn the_frame_is_a_rotation_and_the_point_lies_between_the_surfaces() {
    let sim = settled(Cone::Elliptic);
    let contact = sim.contacts().next().unwrap();
    assert!((contact.frame * contact.frame.transpose() - Matrix3::identity()).norm() < 1e-12);
    assert!((contact.frame.determinant() - 1.0).abs() < 1e-12);
    assert!(contact.dist < 0.0 && contact.dist > -0.01);
    assert!((contact.position.z - contact.dist / 2.0).abs() < 1e-12);
    assert_eq!(
        (contact.condim, contact.excluded, contact.efc_address),
        (3, false, Some(0))
    );
    assert_eq!(contact.friction[0], 1.0);
}
