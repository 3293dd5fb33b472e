//! What MuJoCo's sensors and contact list show of a grasp while its contacts are out of MuJoCo's solve: the same as in
//! the full solve.

use crate::claw::Claw;
use mujoco_grasp::grasp::{Grasps, Phase};
use mujoco_grasp::mujoco::{Model, Simulation};
use nalgebra::Vector3;

/// The claw with touch sensors on the fingertips and force and torque at the palm's base.
fn claw(cone: &str) -> Claw {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    let mut xml = std::fs::read_to_string(path).expect("the claw").replace(r#"cone="elliptic""#, cone);
    let palm = r#"<geom name="palm" type"#;
    assert!(xml.contains(palm));
    xml = xml.replace(palm, &format!(r#"<site name="base"/>{palm}"#));
    let mut sensors = String::from(r#"<sensor><force site="base"/><torque site="base"/>"#);
    for finger in 0..5 {
        // around the whole last link
        let tip = format!(r#"<site name="f{finger}_tip" pos="-0.008 0 -0.025" size="0.002"/>"#);
        assert!(xml.contains(&tip));
        xml = xml.replace(&tip, &format!(r#"{tip}<site name="pad{finger}" pos="0 0 -0.015" size="0.04"/>"#));
        sensors += &format!(r#"<touch site="pad{finger}"/>"#);
    }
    xml = xml.replace("</mujoco>", &(sensors + "</sensor></mujoco>"));
    Claw::closed_from(&Model::from_xml_string(&xml).expect("a model"), |_, _| {})
}

/// The engine's own converged solve of the step that `sim` is about to make.
fn engine(sim: &Simulation) -> Simulation {
    let mut full = sim.clone();
    full.set_noslip_iterations(200).expect("iterations");
    Grasps::new().step(&mut full).expect("a step");
    full
}

#[test]
fn sensors_and_contacts_see_the_grasp() {
    for cone in [r#"cone="elliptic""#, r#"cone="pyramidal""#] {
        let mut claw = claw(cone);
        claw.push(Vector3::new(0.3, 0.2, 0.0));
        claw.run(0.3);
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        for _ in 0..20 {
            claw.run(0.01);
            let mut full = engine(&claw.sim);
            claw.step();
            let (ours, theirs) = (claw.sim.sensordata(), full.sensordata());
            let scale = theirs.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            assert!(theirs[6..].iter().all(|touch| *touch > 0.5), "{cone}: {theirs:?}");
            for (a, b) in ours.iter().zip(theirs) {
                assert!((a - b).abs() < 0.01 * scale, "{cone}: {ours:?}\n{theirs:?}");
            }
            assert_eq!(claw.sim.contact_count(), full.contact_count());
            for i in 0..full.contact_count() {
                let (a, b) = (claw.sim.contact_force(i).expect("a force"), full.contact_force(i).expect("a force"));
                assert!((a.force - b.force).norm() < 0.02 * b.force.norm(), "{cone}: {a:?} {b:?}");
                let (a, b) = (claw.sim.contact(i).expect("a contact"), full.contact(i).expect("a contact"));
                assert!(a.excluded && !b.excluded && a.geoms == b.geoms && a.dist == b.dist);
            }
            full.rne_post_constraint().expect("forces");
            claw.sim.rne_post_constraint().expect("forces");
            let worst = claw.sim.cfrc_ext().iter().zip(full.cfrc_ext()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 0.02, "{cone}: cfrc_ext differs by {worst}");
        }
    }
}

/// Contacts that are shown are not solved: a step of the engine after the grasp makes its own.
#[test]
fn shown_contacts_do_not_outlive_their_step() {
    let mut claw = claw(r#"cone="elliptic""#);
    claw.run(0.3);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    claw.sim.step().expect("a step");
    assert!(claw.sim.contacts().all(|c| !c.excluded && c.efc_address.is_some_and(|row| row < claw.sim.nefc())));
}
