//! Hands and objects of every make: bases that are led, welded or driven, fingers that are coupled, pads and objects of
//! several shapes, objects on a slide, a hinge or a ball joint. Each closes, latches, is shaken and pushed, and opens; while
//! it is latched its normal forces and its touch sensors are those of MuJoCo's converged solve of the same step.

use crate::one_step;
use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Phase, find_hand};
use mujoco_grasp::mujoco::{BodyId, Model, Simulation};
use nalgebra::Vector3;

/// What carries the gripper.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Base {
    Fixed,
    /// A mocap body is the palm's parent.
    Mocap,
    /// A palm with a free joint, welded to a mocap body.
    Welded,
    /// Slides and a turntable under a mast, driven.
    Mobile,
}

/// What closes the fingers.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Drive {
    /// An actuator for each.
    Each,
    /// One actuator; an equality couples the other finger's joint.
    Mimic,
    /// One actuator on a fixed tendon through both, with a stiff equality between them.
    Tendon,
}

/// A gripper of two sliding fingers that closes along y on an object at the origin.
#[derive(Clone, Debug)]
struct Scene {
    base: Base,
    drive: Drive,
    /// Geoms of a finger, whose inner face is at its origin, along +y.
    pad: &'static str,
    /// The object's joint.
    joint: &'static str,
    /// The object's geoms; 20 mm to each side along y.
    object: &'static str,
    cone: &'static str,
}

const BOX_PAD: &str = r#"<geom type="box" size=".012 .005 .015" pos="0 -.005 0" mass=".05"/>"#;
const SEVERAL_PADS: &str = r#"<geom type="box" size=".012 .003 .015" pos="0 -.007 0" mass=".03"/>
  <geom type="capsule" size=".004" fromto="-.01 -.004 .01 .01 -.004 .01" mass=".01"/>
  <geom type="sphere" size=".004" pos="0 -.004 -.01" mass=".01"/>"#;
const ELLIPSOID_PAD: &str = r#"<geom type="ellipsoid" size=".015 .006 .02" pos="0 -.006 0" mass=".05"/>"#;
const MESH_PAD: &str = r#"<geom type="mesh" mesh="wedge" mass=".05"/>"#;
const FREE: &str = "<freejoint/>";
const BLOCK: &str = r#"<geom type="box" size=".02 .02 .02" mass=".1"/>"#;
const MUG: &str = r#"<geom type="cylinder" size=".02 .03" mass=".1"/>
  <geom type="capsule" size=".004" fromto=".03 0 -.015 .03 0 .015" mass=".01"/>
  <geom type="box" size=".006 .003 .003" pos=".024 0 .015" mass=".005"/>
  <geom type="ellipsoid" size=".01 .01 .006" pos="0 0 .034" mass=".005"/>"#;

impl Scene {
    fn new() -> Scene {
        Scene { base: Base::Fixed, drive: Drive::Each, pad: BOX_PAD, joint: FREE, object: BLOCK, cone: "elliptic" }
    }

    fn xml(&self) -> String {
        let finger = |name: &str, y: f64, euler: &str| {
            format!(
                r#"<body name="{name}" pos="0 {y} -.1" euler="{euler}">
                <joint name="{name}" type="slide" axis="0 1 0" damping="8"/>{}
                <site name="{name}" type="box" size=".03 .02 .03"/></body>"#,
                self.pad
            )
        };
        let palm = format!(
            r#"<geom type="box" size=".03 .05 .01" mass=".3"/>{}{}"#,
            finger("left", -0.025, "0 0 0"),
            finger("right", 0.025, "0 0 180")
        );
        let (base, led) = match self.base {
            Base::Fixed => (format!(r#"<body name="palm" pos="0 0 .5">{palm}</body>"#), ""),
            Base::Mocap => {
                (format!(r#"<body name="lead" mocap="true" pos="0 0 .5"><body name="palm">{palm}</body></body>"#), "")
            }
            Base::Welded => (
                format!(
                    r#"<body name="lead" mocap="true" pos="0 0 .5"/>
                    <body name="palm" pos="0 0 .5"><freejoint/>{palm}</body>"#
                ),
                r#"<weld body1="lead" body2="palm"/>"#,
            ),
            Base::Mobile => (
                format!(
                    r#"<body name="car" pos="-.2 0 .1"><joint name="x" type="slide" axis="1 0 0" damping="60"/>
                    <joint name="y" type="slide" axis="0 1 0" damping="60"/><geom type="box" size=".1 .1 .03" mass="8"/>
                    <body name="mast" pos="0 0 .05"><joint name="turn" axis="0 0 1" damping="4"/>
                    <geom type="capsule" size=".02" fromto="0 0 0 0 0 .4" mass="1"/>
                    <body name="wrist" pos="0 0 .35"><geom type="capsule" size=".015" fromto="0 0 0 .15 0 0" mass=".3"/>
                    <body name="palm" pos=".2 0 0">{palm}</body></body></body></body>"#
                ),
                "",
            ),
        };
        let (couple, tendon, drive) = match self.drive {
            Drive::Each => (
                "",
                "",
                r#"<position name="left" joint="left" kp="600"/><position name="right" joint="right" kp="600"/>"#,
            ),
            Drive::Mimic => {
                (r#"<joint joint1="right" joint2="left"/>"#, "", r#"<position name="left" joint="left" kp="1200"/>"#)
            }
            Drive::Tendon => (
                r#"<joint joint1="right" joint2="left" solref=".01 1"/>"#,
                r#"<fixed name="cable"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed>"#,
                r#"<position name="cable" tendon="cable" kp="1200"/>"#,
            ),
        };
        let car = if self.base == Base::Mobile {
            r#"<position name="x" joint="x" kp="900"/><position name="y" joint="y" kp="900"/>
               <position name="turn" joint="turn" kp="60"/>"#
        } else {
            ""
        };
        format!(
            r#"<mujoco><option timestep=".002" cone="{}" noslip_iterations="20"/>
            <default><geom condim="4"/></default><asset><mesh name="wedge" vertex="-.012 0 -.015  .012 0 -.015  -.012 0 .015  .012 0 .015
              -.008 -.01 -.01  .008 -.01 -.01  -.008 -.01 .01  .008 -.01 .01"/></asset>
            <worldbody><geom type="plane" size="1 1 .1"/>{base}
              <body name="object" pos="0 0 .4">{}{}</body></worldbody>
            <tendon>{tendon}</tendon><equality>{led}{couple}</equality><actuator>{drive}{car}</actuator>
            <sensor><touch site="left"/><touch site="right"/></sensor></mujoco>"#,
            self.cone, self.joint, self.object
        )
    }

    /// Closes, latches, moves about, is pushed, and opens.
    fn story(&self) {
        let model = Model::from_xml_string(&self.xml()).unwrap_or_else(|e| panic!("{self:?}: {e}"));
        let mut sim = Simulation::new(&model).expect("a simulation");
        let object = sim.model().body("object").expect("object");
        let spec = GraspSpec::new(object, None);
        let mut grasps = Grasps::of(&sim, &spec).unwrap_or_else(|e| panic!("{self:?}: {e}"));
        assert_eq!(sim.model().body_name(grasps[GraspId::FIRST].palm()), Some("palm"), "{self:?}");
        let start = sim.qpos().to_vec();
        let (q, v) = joints_of(&sim, object);
        let fingers: Vec<usize> = ["left", "right", "cable"]
            .iter()
            .filter_map(|name| Some(sim.model().actuator(name).ok()?.index()))
            .collect();
        let squeeze = 0.005 + 8.0 / 600.0;
        grasps[GraspId::FIRST].allow_latch(false);
        while sim.time() < 0.8 {
            for &finger in &fingers {
                sim.ctrl_mut()[finger] = squeeze * (sim.time() / 0.4).min(1.0);
            }
            sim.qpos_mut()[q.clone()].copy_from_slice(&start[q.clone()]);
            sim.qvel_mut()[v.clone()].fill(0.0);
            grasps.step(&mut sim).expect("a step");
        }
        grasps[GraspId::FIRST].allow_latch(true);
        while sim.time() < 1.0 {
            grasps.step(&mut sim).expect("a step");
        }
        let quality = grasps[GraspId::FIRST].quality();
        assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped, "{self:?}: quality {quality}");
        let palm = grasps[GraspId::FIRST].palm();
        let (placed, mut moved) = (sim.body_position(palm), 0.0f64);
        let (mut worst, mut touch) = (0.0f64, 0.0f64);
        for step in 0..500 {
            self.shake(&mut sim, step as f64 * 0.002);
            let force = match step {
                100..200 => Vector3::new(0.6, 0.3, 0.0),
                300..400 => Vector3::new(-0.2, 0.0, -0.6),
                _ => Vector3::zeros(),
            };
            sim.set_body_wrench(object, &force, &Vector3::zeros()).expect("a wrench");
            let mut exact = (step % 10 == 0).then(|| one_step::engine(&sim));
            grasps.step(&mut sim).expect("a step");
            assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped, "{self:?}: given up after {step} steps");
            assert!(sim.contacts().all(|c| c.excluded || c.other_body(object).is_none()), "{self:?}");
            moved = moved.max((sim.body_position(palm) - placed).norm());
            if let Some(exact) = &mut exact {
                worst = worst.max(one_step::difference(exact, grasps[GraspId::FIRST].contacts()));
                let largest = exact.sensordata().iter().fold(0.0, |m: f64, x| m.max(*x));
                assert!(exact.sensordata().iter().all(|&x| x > 0.5), "{self:?}: {:?}", exact.sensordata());
                for (ours, theirs) in sim.sensordata().iter().zip(exact.sensordata()) {
                    touch = touch.max((ours - theirs).abs() / largest);
                }
            }
        }
        println!("{self:?}: one step {worst:.1e}, touch {touch:.1e}, palm moved by {:.1} mm", moved * 1e3);
        assert!(worst < 1e-5 && touch < 1e-5, "{self:?}: {worst:e} {touch:e}");
        assert!(self.base == Base::Fixed || moved > 0.005, "{self:?}: the palm moves by {moved} m");
        for &finger in &fingers {
            sim.ctrl_mut()[finger] = -0.005;
        }
        for _ in 0..150 {
            grasps.step(&mut sim).expect("a step");
        }
        assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Ungrasped, "{self:?}: not released");
        assert!(grasps[GraspId::FIRST].contacts().is_empty(), "{self:?}: still touches");
    }

    fn shake(&self, sim: &mut Simulation, time: f64) {
        let wave = (std::f64::consts::TAU * 1.5 * time).sin();
        match self.base {
            Base::Fixed => {}
            Base::Mocap | Base::Welded => {
                sim.mocap_pos_mut()[0] = 0.01 * wave;
                sim.mocap_pos_mut()[2] = 0.5 + 0.005 * wave;
            }
            Base::Mobile => {
                let car = ["x", "y", "turn"].map(|name| sim.model().actuator(name).expect("an actuator").index());
                for (index, size) in car.into_iter().zip([0.02, 0.02, 0.05]) {
                    sim.ctrl_mut()[index] = size * wave;
                }
            }
        }
    }
}

/// Where the object's joints are in qpos and qvel.
fn joints_of(sim: &Simulation, body: BodyId) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
    let model = sim.model();
    let (first, count) = (model.body_jntadr()[body.index()] as usize, model.body_jntnum()[body.index()] as usize);
    let q = model.jnt_qposadr()[first] as usize;
    let v = model.jnt_dofadr()[first] as usize;
    // the object is the last body
    assert_eq!(first + count, model.njnt());
    (q..model.nq(), v..model.nv())
}

#[test]
fn bases() {
    for base in [Base::Fixed, Base::Mocap, Base::Welded, Base::Mobile] {
        Scene { base, ..Scene::new() }.story();
        Scene { base, pad: ELLIPSOID_PAD, object: MUG, cone: "pyramidal", ..Scene::new() }.story();
    }
}

#[test]
fn drives() {
    for drive in [Drive::Mimic, Drive::Tendon] {
        for base in [Base::Welded, Base::Mobile] {
            Scene { base, drive, ..Scene::new() }.story();
        }
    }
}

#[test]
fn pads_and_objects_of_several_geoms() {
    for pad in [SEVERAL_PADS, ELLIPSOID_PAD, MESH_PAD] {
        for object in [BLOCK, MUG] {
            for cone in ["elliptic", "pyramidal"] {
                Scene { pad, object, cone, ..Scene::new() }.story();
            }
        }
    }
}

#[test]
fn objects_on_joints_of_their_own() {
    let joints = [
        r#"<joint type="slide" axis="1 0 0" damping=".5"/>"#,
        r#"<joint type="slide" axis="0 1 0" stiffness="5"/><joint type="slide" axis="0 0 1" stiffness="50"/>"#,
        r#"<joint type="hinge" axis="0 0 1" pos="-.1 0 0" damping=".01"/>"#,
        r#"<joint type="ball" pos="0 0 .02" damping=".001"/>"#,
        r#"<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
           <joint type="ball"/>"#,
    ];
    for joint in joints {
        for (pad, cone) in [(BOX_PAD, "elliptic"), (MESH_PAD, "pyramidal")] {
            Scene { joint, pad, cone, ..Scene::new() }.story();
        }
    }
    // the last one can go anywhere
    Scene { joint: joints[4], base: Base::Mobile, ..Scene::new() }.story();
}

/// A scene around the object, with what is found without a name in it.
fn found(worldbody: &str, rest: &str) -> Result<String, String> {
    let xml = format!(
        r#"<mujoco><worldbody><body name="object" pos="0 0 1"><freejoint/><geom size=".02"/></body>{worldbody}</worldbody>
        {rest}</mujoco>"#
    );
    let model = Model::from_xml_string(&xml).expect("a model");
    let (palm, _) = find_hand(&model, model.body("object").expect("object")).map_err(|e| e.to_string())?;
    // what is found holds the grasp, too
    let sim = Simulation::new(&model).expect("a simulation");
    let spec = GraspSpec::new(model.body("object").expect("object"), None);
    assert_eq!(Grasps::of(&sim, &spec).expect("a grasp")[GraspId::FIRST].palm(), palm);
    Ok(model.body_name(palm).unwrap_or("nameless").to_owned())
}

fn finger(name: &str) -> String {
    format!(r#"<body name="{name}"><joint name="{name}" axis="1 0 0"/><geom size=".01" pos="0 0 .03"/></body>"#)
}

fn hand(name: &str) -> String {
    format!(
        r#"<body name="{name}"><geom size=".01"/>{}<body name="{name} base">{}{}</body></body>"#,
        finger(&format!("{name} 1")),
        finger(&format!("{name} 2")),
        finger(&format!("{name} 3"))
    )
}

fn motors(joints: &[&str]) -> String {
    let motors: String = joints.iter().map(|joint| format!(r#"<motor joint="{joint}"/>"#)).collect();
    format!("<actuator>{motors}</actuator>")
}

#[test]
fn the_hand_is_found() {
    let arm = |hands: &str| {
        format!(r#"<body name="arm"><joint name="arm" axis="0 1 0"/><geom size=".01" pos="0 0 -.1"/>{hands}</body>"#)
    };
    let table = r#"<body name="table"><geom type="box" size=".1 .1 .1"/></body>"#;
    // neither things that lie about nor a cupboard with two doors is a hand
    let cupboard = r#"<body name="cupboard"><geom size=".1"/>
        <body><joint axis="0 0 1"/><geom size=".1"/></body><body><joint axis="0 0 1"/><geom size=".1"/></body></body>"#;
    let thing = r#"<body name="thing"><freejoint/><geom size=".02"/></body>"#;
    let around = |robot: &str| format!("{table}{thing}{cupboard}{robot}");
    let of = |robot: &str, rest: &str| found(&around(robot), rest);
    assert_eq!(of(&arm(&hand("h")), &motors(&["arm"])), Ok("h".into()), "fixed parts of a palm are one");
    assert_eq!(of(&hand("h"), &motors(&["h 2"])), Ok("h".into()), "a hand on the world");

    let eyes =
        format!("{}{}", finger("eye 1"), finger("eye 2")).replace("<geom", r#"<geom contype="0" conaffinity="0""#);
    let legs = format!("{}{}", finger("leg 1"), finger("leg 2"));
    let robot = format!(
        r#"<body name="trunk"><freejoint/><geom size=".1"/>{legs}{}<body name="head">
        <joint/><geom size=".05"/>{eyes}</body></body>"#,
        arm(&hand("h"))
    );
    assert_eq!(of(&robot, &motors(&["arm"])), Ok("h".into()), "neither trunk nor head is a palm");

    let tendon = r#"<tendon><fixed name="t"><joint joint="h 1" coef="1"/></fixed></tendon>
        <actuator><position tendon="t"/></actuator>"#;
    assert_eq!(of(&arm(&hand("h")), tendon), Ok("h".into()), "driven by a tendon");

    let led = format!(
        r#"<body name="lead" mocap="true"/><body name="wrist"><freejoint/><geom size=".01"/>{}</body>"#,
        hand("h")
    );
    let weld = r#"<equality><weld body1="lead" body2="wrist"/></equality>"#;
    assert_eq!(of(&led, weld), Ok("h".into()), "led by a mocap body");

    let tips: String = (0..3)
        .map(|k| format!(r#"<body name="tip {k}" mocap="true" pos="{k} 0 0"><geom size=".01"/></body>"#))
        .collect();
    assert_eq!(of(&tips, ""), Ok("world".into()), "fingertips that are mocap bodies");
    let paddles = format!("{}{}", finger("left"), finger("right"));
    assert_eq!(of(&paddles, &motors(&["left", "right"])), Ok("world".into()), "two arms without fingers");
    assert!(of(&paddles, &motors(&["left"])).is_err(), "one arm without fingers");
}

#[test]
fn no_hand_and_several_are_named() {
    let of = |robot: &str, rest: &str| found(robot, rest).expect_err("an error");
    let none = of(&hand("h"), "");
    assert!(none.contains("no hand is found") && none.contains("name the palm or the effectors"), "{none}");
    let passes_through = hand("h").replace("<geom", r#"<geom contype="2" conaffinity="2""#);
    let none = of(&passes_through, &motors(&["h 1"]));
    assert!(none.contains("no hand is found"), "{none}");
    let two = format!(
        r#"<body name="trunk"><joint name="trunk"/><geom size=".1"/>
        <body><joint/><geom size=".05"/>{}</body><body><joint/><geom size=".05"/>{}</body></body>"#,
        hand("left"),
        hand("right")
    );
    let several = of(&two, &motors(&["trunk"]));
    assert!(
        several.contains("several hands") && several.contains("\"left\"") && several.contains("\"right\""),
        "{several}"
    );
    assert!(!several.contains("trunk"), "{several}");
}
