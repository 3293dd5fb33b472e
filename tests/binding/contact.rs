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
        assert_eq!(contact.geoms.map(|geom| sim.model().geom_name(geom).unwrap().to_string()), ["floor", "ball"]);
        // The normal points from geom 1 (floor) to geom 2 (ball): up. So does the force on the ball.
        assert!((contact.normal() - Vector3::z()).norm() < 1e-12);
        let force = sim.contact_force(0).unwrap();
        assert!((force.force - Vector3::new(0.0, 0.0, 2.0 * 9.81)).norm() < 1e-6, "{cone:?}: {force:?}");
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
    assert_eq!((contact.condim, contact.excluded, contact.efc_address), (3, false, Some(0)));
    assert_eq!(contact.friction[0], 1.0);
}

#[test]
fn an_excluded_contact_does_not_push() {
    let mut sim = settled(Cone::Pyramidal);
    let dof = 2;
    sim.kinematics().unwrap();
    sim.inertia().unwrap();
    sim.collision().unwrap();
    sim.exclude_contact(0).unwrap();
    sim.make_constraint().unwrap();
    assert_eq!(sim.nefc(), 0);
    let contact = sim.contact(0).unwrap();
    assert!(contact.excluded && contact.efc_address.is_none());
    sim.project_constraint().unwrap();
    sim.velocity().unwrap();
    sim.acceleration().unwrap();
    sim.constraint().unwrap();
    assert!((sim.qacc()[dof] + 9.81).abs() < 1e-9, "it falls freely");
    assert_eq!(sim.contact_force(0).unwrap().force, Vector3::zeros());
    // The next collision detection finds it again.
    sim.forward().unwrap();
    assert!(!sim.contact(0).unwrap().excluded && sim.qacc()[dof].abs() < 1e-6);
}

/// On a slope of 30 degrees a ball with enough friction rolls: friction force m g sin(a) 2/7, normal force m g cos(a).
#[test]
fn friction_of_a_rolling_ball_points_up_the_slope() {
    let slope = 30_f64.to_radians();
    for cone in [Cone::Pyramidal, Cone::Elliptic] {
        let xml = format!(
            r#"<mujoco><option gravity="{} 0 {}"/><worldbody><geom type="plane" size="9 9 1"/>
            <body name="ball" pos="0 0 0.1"><freejoint/><geom type="sphere" size="0.1" mass="2"/></body></worldbody></mujoco>"#,
            9.81 * slope.sin(),
            -9.81 * slope.cos()
        );
        let mut sim = Simulation::new(&Model::from_xml_string(&xml).unwrap()).unwrap();
        sim.set_cone(cone).unwrap();
        for _ in 0..300 {
            sim.step().unwrap();
        }
        let force = sim.contact_force(0).unwrap().force;
        let expected = Vector3::new(-slope.sin() * 2.0 / 7.0, 0.0, slope.cos()) * 2.0 * 9.81;
        assert!((force - expected).norm() < 0.02 * expected.norm(), "{cone:?}: {force} {expected}");
    }
}

/// With condim 4 a ball spinning on the floor is braked by a torque about the normal, against the spin.
#[test]
fn the_torque_of_a_spinning_ball_is_against_the_spin() {
    let xml = BALL.replace("size=\"1 1 1\"", "size=\"1 1 1\" condim=\"4\" friction=\"1 0.02 0\"");
    for cone in [Cone::Pyramidal, Cone::Elliptic] {
        let mut sim = Simulation::new(&Model::from_xml_string(&xml).unwrap()).unwrap();
        sim.set_cone(cone).unwrap();
        for _ in 0..500 {
            sim.step().unwrap();
        }
        sim.qvel_mut()[5] = 50.0;
        sim.step().unwrap();
        let on_ball = sim.contact_force(0).unwrap();
        // It spins fast, so friction is at its limit: 0.02 m times the normal force (most of it in a pyramid, which
        // shares the normal force between its edges).
        let (torque, limit) = (on_ball.torque, 0.02 * on_ball.force.z);
        assert!(torque.z < -0.5 * limit && torque.z > -1.001 * limit, "{cone:?}: {torque} {limit}");
        assert!(torque.x.abs() + torque.y.abs() < 1e-9);
    }
}
