//! How closely grasp mode follows the full contact solve (noslip 100) under every kind of contact, setting and hand.
//!
//! Each variant closes its hand, latches or not from the same state, is pushed in two directions for half a second and
//! watched for another 0.3 s. `cargo nextest run --no-capture --test grasp fidelity::` prints what was measured; the bounds are
//! two to three times that.

use crate::hands::{BALL, BOX, DUMBBELL, Finger, Hand, Mount, Pad, claw, five, pinch};
use crate::hold::{Held, NOSLIP, Scene, compare, full};
use crate::table::{Bounds, Table};
use mujoco_grasp::grasp::{GraspId, Phase};

const ELLIPTIC: &str = r#"cone="elliptic""#;
const PYRAMIDAL: &str = r#"cone="pyramidal""#;

/// The claw with contacts of `condim` and a cone.
fn claw_of(condim: usize, cone: &str) -> Scene {
    claw().with(r#"condim="3""#, &format!(r#"condim="{condim}""#)).with(ELLIPTIC, cone)
}

/// The name of a cone in the table.
fn short(cone: &str) -> &str {
    if cone == ELLIPTIC { "elliptic" } else { "pyramidal" }
}

/// What differs by less cannot be told from rounding and from where the engine's sweeps stop.
const CLOSE: Bounds = (0.002, 0.001);

/// condim and cone of the claw's contacts, and the bounds at time steps of 0.5, 1, 2 and 4 ms.
const CLAWS: [(usize, &str, [Bounds; 4]); 6] = [
    (3, ELLIPTIC, [CLOSE; 4]),
    (3, PYRAMIDAL, [CLOSE; 4]),
    (4, ELLIPTIC, [(0.008, 0.001), (0.009, 0.0013), (0.013, 0.002), (0.03, 0.004)]),
    (4, PYRAMIDAL, [CLOSE, CLOSE, CLOSE, (0.0025, 0.001)]),
    (6, ELLIPTIC, [(0.005, 0.002), (0.008, 0.003), (0.015, 0.005), (0.04, 0.008)]),
    (6, PYRAMIDAL, [(0.006, 0.001), (0.008, 0.001), (0.01, 0.001), (0.02, 0.002)]),
];

#[test]
fn contact_dimensions_cones_and_time_steps() {
    let mut table = Table::new("The claw: condim, cone, time step");
    for (condim, cone, bounds) in CLAWS {
        for (step, bounds) in ["0.0005", "0.001", "0.002", "0.004"].iter().zip(bounds) {
            let scene = claw_of(condim, cone).with(r#"timestep="0.002""#, &format!(r#"timestep="{step}""#));
            table.row(&format!("condim {condim}, {}, {step} s", short(cone)), &scene, bounds);
        }
    }
    table.finish();
}

#[test]
fn implicit_integrator() {
    let mut table = Table::new("The claw: integrator implicit");
    for (condim, cone, [_, _, bounds, _]) in CLAWS {
        let scene = claw_of(condim, cone).set("<option", r#"integrator="implicit""#);
        table.row(&format!("condim {condim}, {}", short(cone)), &scene, bounds);
    }
    table.finish();
}

/// Five points without friction cannot keep a box from turning: its quality is 0, and it is never latched.
#[test]
fn frictionless_points_never_latch() {
    let mut scene = five(Pad::Point).condim(1).scene(PUSHES_ON_BOX);
    scene.latch_quality = Some(1e-9);
    let mut held = Held::closed(&scene);
    held.grasps[GraspId::FIRST].allow_latch(true);
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
        ("impratio 10", claw().set("<option", r#"impratio="10""#), CLOSE),
        ("impratio 10, pyramidal", claw().set("<option", r#"impratio="10""#).with(ELLIPTIC, PYRAMIDAL), CLOSE),
        ("solref 0.01 0.7", geoms(r#"solref="0.01 0.7""#), CLOSE),
        ("solref -1500 -60", geoms(r#"solref="-1500 -60""#), CLOSE),
        ("solimp", geoms(r#"solimp="0.7 0.98 0.003 0.4 3""#), CLOSE),
        (
            "solref and solimp of the override",
            overridden(r#"o_solref="0.03 1.2" o_solimp="0.8 0.99 0.002 0.5 2""#),
            (0.003, 0.0013),
        ),
        ("solref -1500 -60 and margin of the override", overridden(r#"o_solref="-1500 -60" o_margin="0.001""#), CLOSE),
        ("margin and gap", geoms(r#"margin="0.003" gap="0.002""#), CLOSE),
        ("friction of its own on each finger", fingers_of_different_friction(), CLOSE),
        ("pairs of condim 4 and 6 on three fingers", pairs(ELLIPTIC), (0.007, 0.0013)),
        ("pairs, pyramidal", pairs(PYRAMIDAL), (0.003, 0.001)),
    ];
    for (name, scene, bounds) in variants {
        table.row(name, &scene, bounds);
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

/// Pad, contacts that it has, and bounds for condim 3, 4, 6, each with both cones.
const PADS: [(Pad, usize, [[Bounds; 2]; 3]); 4] = [
    (Pad::Point, 1, [[CLOSE, CLOSE], [(0.004, 0.001), (0.0025, 0.001)], [(0.06, 0.028), (0.022, 0.008)]]),
    (
        Pad::Line,
        2,
        [[(0.007, 0.0025), (0.013, 0.002)], [(0.008, 0.003), (0.008, 0.002)], [(0.08, 0.025), (0.027, 0.006)]],
    ),
    (Pad::Triangle, 3, [[(0.004, 0.001), (0.007, 0.0013)], [(0.003, 0.001); 2], [(0.01, 0.003), (0.01, 0.0015)]]),
    (Pad::Face, 4, [[(0.04, 0.009), (0.07, 0.01)], [(0.04, 0.009), (0.075, 0.009)], [(0.006, 0.001), (0.03, 0.009)]]),
];

#[test]
fn several_contacts_on_a_link() {
    let mut table = Table::new("A box in five fingers with pads of 1 to 4 contacts");
    for (pad, contacts, bounds) in PADS {
        for (condim, bounds) in [3, 4, 6].into_iter().zip(bounds) {
            for (cone, bounds) in [ELLIPTIC, PYRAMIDAL].into_iter().zip(bounds) {
                let scene = five(pad).condim(condim).scene(PUSHES_ON_BOX).with(ELLIPTIC, cone);
                let found = table.row(&format!("{pad:?}, condim {condim}, {}", short(cone)), &scene, bounds);
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
            table.row(&format!("{pad:?}, {}", short(cone)), &scene, (1e-4, 1e-4));
        }
    }
    table.finish();
}

#[test]
fn parallel_grippers() {
    let mut table = Table::new("A box in a parallel gripper");
    for cone in [ELLIPTIC, PYRAMIDAL] {
        let gripper = gripper(Pad::Face).scene([[8.0, 0.0, 0.0], [6.0, 2.0, -3.0]]).with(ELLIPTIC, cone);
        // Two boxes' contacts have half their overlap as depth in 2.2.2, and all of it in 3.17.0: there the same pads are
        // stiffer and share their friction in another way. Under a pyramid the motions are then 0.52 % apart (2.2.2: 0.11 %),
        // of which 0.09 % is full mode's own difference between noslip 100 and 1000 (2.2.2: none).
        let allowed = if cfg!(mujoco3) { 0.007 } else { 0.0025 };
        table.row(&format!("two actuators, {}", short(cone)), &gripper, (allowed, 0.001));
        let mimic = gripper
            .with("<actuator>", r#"<equality><joint joint1="f1" joint2="f0"/></equality><actuator>"#)
            .with(r#"<position name="f1" joint="f1" kp="2000"/>"#, "")
            .with(r#"<position name="f0" joint="f0" kp="2000"/>"#, r#"<position name="f0" joint="f0" kp="4000"/>"#);
        table.row(&format!("one actuator, coupled, {}", short(cone)), &mimic, (0.045, 0.01));
    }
    table.finish();
}

/// Pads without torsion of their own, and so slowly that the engine's contacts do not come apart for a step.
#[test]
fn a_box_that_slides_in_a_parallel_gripper() {
    let mut table = Table::new("A box that slides in a parallel gripper");
    let scene = gripper(Pad::Triangle).scene([[0.0, 3.1, 0.0], [1.0, 2.0, -1.6]]);
    let mut scene = scene.with(r#"friction="1 "#, r#"friction="0.2 "#);
    scene.push_time = 0.05;
    table.row("three contacts on each pad", &scene, CLOSE);
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
    let pushes = [[1.5, 0.5, 0.0], [0.5, -1.0, 0.5]];
    let variants = [
        ("five points", five(Pad::Point), pushes, CLOSE),
        ("five faces", five(Pad::Face), pushes, (0.004, 0.001)),
        ("two points", two_points(), pushes, (0.028, 0.006)),
        ("gripper", gripper(Pad::Face), [[2.5, 0.0, 0.0], [2.5, -1.0, 0.5]], CLOSE),
    ];
    for (name, hand, pushes, bounds) in variants {
        let found = table.row(name, &hand.on(Mount::Arm).scene(pushes), bounds);
        assert!(found.palm_peak > 5e-3, "{name}: the arm moves only {} m", found.palm_peak);
    }
    table.finish();
}

#[test]
fn two_points_on_a_ball() {
    let mut table = Table::new("A ball between two points, condim 4");
    for (cone, bounds) in [(ELLIPTIC, (0.04, 0.005)), (PYRAMIDAL, (0.02, 0.001))] {
        let scene = two_points().scene([[0.0, 1.0, 0.0], [0.5, 0.5, -0.6]]).with(ELLIPTIC, cone);
        table.row(short(cone), &scene, bounds);
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
        let found = table.row(&format!("finger, {}", short(cone)), &scene, (0.012, 0.002));
        assert_eq!(found.links, [2, 3]);
        let mut hand = two_points();
        hand.palm = r#"<geom type="box" size=".02 .02 .005" pos="0 0 .0325" mass=".05"/>"#;
        let scene = hand.scene([[0.0, 0.0, 3.0], [0.3, 0.3, 3.0]]).with(ELLIPTIC, cone);
        let found = table.row(&format!("palm, {}", short(cone)), &scene, (0.006, 0.001));
        assert_eq!(found.links, [2, 3]);
    }
    table.finish();
}

/// Torsion is all that holds the target about the line. The engine's friction pass converges slowly here: full mode with
/// noslip 100 is further from full mode with noslip 1000 than grasp mode is.
#[test]
fn contacts_on_a_line() {
    let mut table = Table::new("Three points on a line, condim 4");
    let point = |at, inward| Finger::soft(Pad::Point, at, inward);
    let mut hand = pinch(DUMBBELL, 0.033, point).condim(4);
    hand.fingers[0].squeeze = 7.0;
    hand.fingers.push(point([0.027, 0.0, 0.0], [1.0, 0.0, 0.0]));
    let scene = hand.scene([[0.0, 2.0, 0.0], [2.0, 1.0, -1.0]]);
    table.row("grasp and full with noslip 100", &scene, (0.1, 0.045));
    let grasp = table.row_against(1000, "grasp and full with noslip 1000", &scene, (0.07, 0.013));
    let rest = Held::closed(&scene);
    let (reference, other) = (full(&rest, 1000), full(&rest, NOSLIP));
    let [a, b] = scene.pushes.map(|push| compare(&reference, &other, push, scene.push_time));
    let engine = a.worse(&b);
    table.add("full with noslip 100 and with 1000", engine, (0.2, 0.05));
    table.finish();
    assert!(grasp.apart < engine.apart, "grasp mode is {} m off, full mode {} m", grasp.apart, engine.apart);
}

/// Light fingers on a heavy target and the other way round.
#[test]
fn mass_ratios() {
    let mut table = Table::new("A box in five fingers: masses");
    let variants = [
        ("fingers of 5 g, box of 0.2 kg", ".005", ".2", [(0.004, 0.001), (0.075, 0.04)]),
        ("fingers of 0.2 kg, box of 20 g", ".2", ".02", [(0.007, 0.004), (0.011, 0.037)]),
    ];
    for (name, finger, target, bounds) in variants {
        for (pad, bounds) in [Pad::Point, Pad::Face].into_iter().zip(bounds) {
            let scene = five(pad).scene(PUSHES_ON_BOX);
            let scene = scene.with(r#"mass="0.02""#, &format!(r#"mass="{finger}""#));
            let scene = scene.with(r#"mass=".1""#, &format!(r#"mass="{target}""#));
            table.row(&format!("{name}, {pad:?}"), &scene, bounds);
        }
    }
    table.finish();
}

/// Many contacts begin and cease to slide: the friction pass takes up to some hundred iterations, once in a while. With
/// less it ends anywhere, and one such step puts the target millimetres off. (Faces with pyramidal cones are left out:
/// under these pushes full mode with noslip 1000 is a millimetre away from itself with noslip 100.)
#[test]
fn many_contacts_that_slide() {
    let mut table = Table::new("A box in five fingers, friction 0.5");
    let variants = [
        (Pad::Face, 3, ELLIPTIC, (0.025, 0.01)),
        (Pad::Triangle, 3, ELLIPTIC, (0.004, 0.0012)),
        (Pad::Line, 4, ELLIPTIC, (0.01, 0.005)),
        (Pad::Point, 4, PYRAMIDAL, CLOSE),
    ];
    for (pad, condim, cone, bounds) in variants {
        let scene = five(pad).condim(condim).scene([[6.0, 1.0, 0.0], [-2.0, 5.0, 1.0]]);
        let scene = scene.with("1 0.005 0.0001", "0.5 0.01 0.0003").with(ELLIPTIC, cone);
        table.row(&format!("{pad:?}, condim {condim}, {}", short(cone)), &scene, bounds);
    }
    table.finish();
}
