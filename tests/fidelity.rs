//! How closely grasp mode follows the full contact solve (noslip 100) under every kind of contact, setting and hand.
//!
//! Each variant closes its hand, latches or not from the same state, is pushed in two directions for half a second and
//! watched for another 0.3 s. `cargo nextest run --test fidelity --no-capture` prints what was measured; the bounds are
//! two to three times that.

#[path = "common/hands.rs"]
mod hands;
#[path = "common/hold.rs"]
mod hold;
#[path = "common/one_step.rs"]
mod one_step;
#[path = "common/table.rs"]
mod table;

use hands::{BALL, BOX, DUMBBELL, Finger, Hand, Mount, Pad, claw, five, pinch};
use hold::{Held, NOSLIP, Scene, compare, full};
use mujoco_grasp::grasp::Phase;
use table::Table;

const ELLIPTIC: &str = r#"cone="elliptic""#;
const PYRAMIDAL: &str = r#"cone="pyramidal""#;
const ANY: (f64, f64) = (0.1, 0.1);

/// The claw with contacts of `condim` and a cone.
fn claw_of(condim: usize, cone: &str) -> Scene {
    claw().with(r#"condim="3""#, &format!(r#"condim="{condim}""#)).with(ELLIPTIC, cone)
}

/// The name of a cone in the table.
fn short(cone: &str) -> &str {
    if cone == ELLIPTIC { "elliptic" } else { "pyramidal" }
}

#[test]
fn contact_dimensions_cones_and_time_steps() {
    let mut table = Table::new("The claw: condim, cone, time step");
    for condim in [3, 4, 6] {
        for cone in [ELLIPTIC, PYRAMIDAL] {
            for step in ["0.0005", "0.001", "0.002", "0.004"] {
                let scene = claw_of(condim, cone).with(r#"timestep="0.002""#, &format!(r#"timestep="{step}""#));
                table.row(&format!("condim {condim}, {}, {step} s", short(cone)), &scene, ANY);
            }
        }
    }
    table.finish();
}

#[test]
fn implicit_integrator() {
    let mut table = Table::new("The claw: integrator implicit");
    for condim in [3, 4, 6] {
        for cone in [ELLIPTIC, PYRAMIDAL] {
            let scene = claw_of(condim, cone).set("<option", r#"integrator="implicit""#);
            table.row(&format!("condim {condim}, {}", short(cone)), &scene, ANY);
        }
    }
    table.finish();
}

/// Five points without friction cannot keep a box from turning: its quality is 0, and it is never latched.
#[test]
fn frictionless_points_never_latch() {
    let mut scene = five(Pad::Point).condim(1).scene(PUSHES_ON_BOX);
    scene.latch_quality = Some(1e-9);
    let mut held = Held::closed(&scene);
    held.grasps[0].allow_latch(true);
    for _ in 0..100 {
        held.step();
        assert_eq!(held.grasp().contacts().len(), 5, "the box is not held");
        assert_eq!(held.grasp().quality(), 0.0);
        assert_eq!(held.grasp().phase(), Phase::Ungrasped);
    }
}

#[test]
fn contact_parameters() {
    let mut table = Table::new("The claw: parameters of the contacts");
    let geoms = |text: &str| claw().set("<geom condim=\"3\"", text);
    let variants = [
        ("impratio 10", claw().set("<option", r#"impratio="10""#)),
        ("impratio 10, pyramidal", claw().set("<option", r#"impratio="10""#).with(ELLIPTIC, PYRAMIDAL)),
        ("solref 0.01 0.7", geoms(r#"solref="0.01 0.7""#)),
        ("solref -1500 -60", geoms(r#"solref="-1500 -60""#)),
        ("solimp", geoms(r#"solimp="0.7 0.98 0.003 0.4 3""#)),
        ("solref and solimp of the override", overridden(r#"o_solref="0.03 1.2" o_solimp="0.8 0.99 0.002 0.5 2""#)),
        ("solref -1500 -60 and margin of the override", overridden(r#"o_solref="-1500 -60" o_margin="0.001""#)),
        ("margin and gap", geoms(r#"margin="0.003" gap="0.002""#)),
        ("friction of its own on each finger", fingers_of_different_friction()),
        ("pairs of condim 4 and 6 on three fingers", pairs(ELLIPTIC)),
        ("pairs, pyramidal", pairs(PYRAMIDAL)),
    ];
    for (name, scene) in variants {
        table.row(name, &scene, ANY);
    }
    table.finish();
}

fn overridden(option: &str) -> Scene {
    claw().with(
        r#"noslip_iterations="50"/>"#,
        &format!(r#"noslip_iterations="50" {option}><flag override="enable"/></option>"#),
    )
}

fn fingers_of_different_friction() -> Scene {
    let scene = claw().set(r#"<geom name="object""#, r#"friction="0.3 0.003 0.0001""#);
    ["0.6", "0.9", "1.3", "0.5", "0.8"].iter().enumerate().fold(scene, |scene, (k, friction)| {
        scene.set(&format!(r#"<geom name="f{k}_3""#), &format!(r#"friction="{friction}""#))
    })
}

/// Friction that differs between the tangents, too.
fn pairs(cone: &str) -> Scene {
    let pairs = r#"<contact>
      <pair geom1="f0_3" geom2="object" condim="4" friction="0.9 0.6 0.01 0.001 0.001"/>
      <pair geom1="f1_3" geom2="object" condim="6" friction="0.7 1.2 0.005 0.002 0.001" solref="0.015 1"/>
      <pair geom1="object" geom2="f3_3" condim="4" friction="1.5 1.5 0.02 0.001 0.001" solimp="0.8 0.9 0.002"/>
      </contact><actuator>"#;
    claw().with("<actuator>", pairs).with(ELLIPTIC, cone)
}

#[test]
fn several_contacts_on_a_link() {
    let mut table = Table::new("A box in five fingers with pads of 1 to 4 contacts");
    for (pad, contacts) in [(Pad::Point, 1), (Pad::Line, 2), (Pad::Triangle, 3), (Pad::Face, 4)] {
        for condim in [3, 4, 6] {
            for cone in [ELLIPTIC, PYRAMIDAL] {
                let scene = five(pad).condim(condim).scene(PUSHES_ON_BOX).with(ELLIPTIC, cone);
                let found = table.row(&format!("{pad:?}, condim {condim}, {}", short(cone)), &scene, ANY);
                assert_eq!((found.contacts, found.links), (contacts, [5, 5]), "{pad:?}");
            }
        }
    }
    table.finish();
}

const PUSHES_ON_BOX: [[f64; 3]; 2] = [[4.0, 1.0, 0.0], [0.0, 2.0, -3.0]];

/// Frictionless faces hold a box that lies on the lowest of them; frictionless points never get a quality.
#[test]
fn several_contacts_on_a_link_without_friction() {
    let mut table = Table::new("A box in five fingers, condim 1");
    for pad in [Pad::Triangle, Pad::Face] {
        for cone in [ELLIPTIC, PYRAMIDAL] {
            let mut scene = five(pad).condim(1).scene([[1.5, 0.5, 0.0], [0.0, 0.7, -1.0]]).with(ELLIPTIC, cone);
            scene.latch_quality = Some(1e-3);
            table.row(&format!("{pad:?}, {}", short(cone)), &scene, ANY);
        }
    }
    table.finish();
}

#[test]
fn parallel_grippers() {
    let mut table = Table::new("A box in a parallel gripper");
    for cone in [ELLIPTIC, PYRAMIDAL] {
        let gripper = gripper(Pad::Face).scene([[8.0, 0.0, 0.0], [6.0, 2.0, -3.0]]).with(ELLIPTIC, cone);
        table.row(&format!("two actuators, {}", short(cone)), &gripper, ANY);
        let mut slides =
            self::gripper(Pad::Triangle).scene([[0.0, 22.0, 0.0], [4.0, 15.0, -15.0]]).with(ELLIPTIC, cone);
        slides.push_time = 0.02;
        table.row(&format!("slides, {}", short(cone)), &slides, ANY);
        let mimic = gripper
            .with("<actuator>", r#"<equality><joint joint1="f1" joint2="f0"/></equality><actuator>"#)
            .with(r#"<position name="f1" joint="f1" kp="2000"/>"#, "")
            .with(r#"<position name="f0" joint="f0" kp="2000"/>"#, r#"<position name="f0" joint="f0" kp="4000"/>"#);
        table.row(&format!("one actuator, coupled, {}", short(cone)), &mimic, ANY);
    }
    table.finish();
}

fn gripper(pad: Pad) -> Hand {
    pinch(BOX, 0.02, |at, inward| Finger::stiff(pad, at, inward))
}

/// Two soft fingers on a ball.
fn two_points() -> Hand {
    pinch(BALL, 0.025, |at, inward| Finger::soft(Pad::Point, at, inward)).condim(4)
}

#[test]
fn light_arms() {
    let mut table = Table::new("Hand and arm of half a kilogram");
    for (name, mut hand) in [
        ("five points", five(Pad::Point)),
        ("five faces", five(Pad::Face)),
        ("two points", two_points()),
        ("gripper", gripper(Pad::Face)),
    ] {
        hand.mount = Mount::Arm;
        let pushes =
            if name == "gripper" { [[2.5, 0.0, 0.0], [2.5, -1.0, 0.5]] } else { [[1.5, 0.5, 0.0], [0.5, -1.0, 0.5]] };
        let found = table.row(name, &hand.scene(pushes), ANY);
        assert!(found.palm_peak > 5e-3, "{name}: the arm moves only {} m", found.palm_peak);
    }
    table.finish();
}

#[test]
fn two_points_on_a_ball() {
    let mut table = Table::new("A ball between two points, condim 4");
    for cone in [ELLIPTIC, PYRAMIDAL] {
        let scene = two_points().scene([[0.0, 1.0, 0.0], [0.5, 0.5, -0.6]]).with(ELLIPTIC, cone);
        table.row(short(cone), &scene, ANY);
    }
    table.finish();
}

/// A finger or the palm is a millimetre away until the push.
#[test]
fn contacts_born_while_grasped() {
    let mut table = Table::new("A third contact is born while two hold the ball, condim 4");
    for cone in [ELLIPTIC, PYRAMIDAL] {
        let mut hand = two_points();
        let third = Finger::soft(Pad::Point, [0.0, 0.025, 0.0], [0.0, -1.0, 0.0]);
        hand.fingers.push(Finger { squeeze: 0.0, ..third });
        let scene = hand.scene([[0.0, 1.5, 0.0], [0.3, 1.2, -0.3]]).with(ELLIPTIC, cone);
        let found = table.row(&format!("finger, {}", short(cone)), &scene, ANY);
        assert_eq!(found.links, [2, 3]);
        let mut hand = two_points();
        hand.palm = r#"<geom type="box" size=".02 .02 .005" pos="0 0 .0325" mass=".05"/>"#;
        let scene = hand.scene([[0.0, 0.0, 3.0], [0.3, 0.3, 3.0]]).with(ELLIPTIC, cone);
        let found = table.row(&format!("palm, {}", short(cone)), &scene, ANY);
        assert_eq!(found.links, [2, 3]);
    }
    table.finish();
}

#[test]
fn contacts_on_a_line() {
    let mut table = Table::new("Three points on a line, condim 4");
    let point = |at, inward| Finger::soft(Pad::Point, at, inward);
    let mut hand = pinch(DUMBBELL, 0.033, point).condim(4);
    hand.fingers[0].squeeze = 7.0;
    hand.fingers.push(point([0.027, 0.0, 0.0], [1.0, 0.0, 0.0]));
    let scene = hand.scene([[0.0, 2.0, 0.0], [2.0, 1.0, -1.0]]);
    let rest = Held::closed(&scene);
    let (reference, other) = (full(&rest, 1000), full(&rest, NOSLIP));
    let [a, b] = scene.pushes.map(|push| compare(&reference, &other, push, scene.push_time));
    table.row("grasp and full with noslip 100", &scene, ANY);
    table.row_against(1000, "grasp and full with noslip 1000", &scene, ANY);
    table.add("full with noslip 100 and with 1000", a.worse(&b), ANY);
    table.finish();
}

/// Light fingers on a heavy target and the other way round.
#[test]
fn mass_ratios() {
    let mut table = Table::new("A box in five fingers: masses");
    for (name, finger, target) in
        [("fingers of 1 g, box of 0.5 kg", ".001", ".5"), ("fingers of 0.5 kg, box of 5 g", ".5", ".005")]
    {
        for pad in [Pad::Point, Pad::Face] {
            let scene = five(pad).scene(PUSHES_ON_BOX);
            let scene = scene.with(r#"mass="0.02""#, &format!(r#"mass="{finger}""#));
            let scene = scene.with(r#"mass=".1""#, &format!(r#"mass="{target}""#));
            table.row(&format!("{name}, {pad:?}"), &scene, ANY);
        }
    }
    table.finish();
}
