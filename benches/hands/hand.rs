//! Hands of any size that hold a can: as many fingers, contacts and other joints as are asked for.
//!
//! The fingers hang round an upright can and press on it from all sides. Each touches it with pads, small spheres that lie
//! on the can's surface from the start, so that each pad is one contact. The other joints are a trunk, the arm that the hand
//! hangs from, and more arms: what counts is how many there are and that they are coupled, as in a humanoid.
//!
//! # Where the numbers are from
//! - **Fingers**: first finger of the Shadow Hand in MuJoCo Menagerie (`shadow_hand/right_hand.xml`): axes, lengths, radius,
//!   masses, damping, armature and the palm's mass. Its last joint is rigid, and the friction losses of the others are left
//!   out, as each is one more row.
//! - **Can**: a full drinks can of 330 ml, 66 mm across and 115 mm high, 350 g.
//! - **Arm**: 0.63 m and 4.9 kg of seven links, about a man's (de Leva 1996: 5 % of 73 kg with the hand); trunk 32 kg.
//! - **Chosen**: servos and damping of trunk and arms, which only hold their pose; 5 N of each finger, with which two hold
//!   the can (3.4 N) at friction 1; pads in a ring as wide as a fingertip, so that whatever their number each carries its
//!   share; MuJoCo's default softness, which time steps up to 10 ms do not change.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::ops::RangeInclusive;
use std::path::Path;

use anyhow::ensure;
use mujoco_grasp::mujoco::Model;
use mujoco_grasp::scenario::file::ScenarioFile;
use mujoco_grasp::scenario::plan::Plan;

/// Fingers that a hand may have.
pub const FINGERS: RangeInclusive<usize> = 2..=10;
/// Contacts that a finger may have.
pub const CONTACTS_PER_FINGER: RangeInclusive<usize> = 1..=16;
/// Joints besides the fingers' and the can's six degrees of freedom.
pub const OTHER_JOINTS: RangeInclusive<usize> = 20..=200;
/// Joints of a finger, and how far above the middle of its pads each bends it towards the can \[m\].
const FINGER_JOINTS: [(&str, f64); 3] =
    [("spread", 0.0), ("knuckle", PROXIMAL + MIDDLE + 0.5 * TIP), ("middle", MIDDLE + 0.5 * TIP)];

/// Lengths of the phalanges \[m\]; the last two are one link.
const PROXIMAL: f64 = 0.045;
const MIDDLE: f64 = 0.025;
const TIP: f64 = 0.026;
const FINGER_RADIUS: f64 = 0.009;
const CAN_RADIUS: f64 = 0.033;
/// Radius of a pad \[m\], by which the phalanx keeps off the can.
const PAD: f64 = 0.002;
/// Radius of the ring of pads \[m\].
const RING: f64 = 0.007;
/// What a finger presses with \[N\].
const PRESS: f64 = 5.0;
/// Of the finger's position actuators \[N m/rad\].
const FINGER_KP: f64 = 1.0;

const TRUNK_JOINTS: usize = 3;
const ARM_JOINTS: usize = 7;
const ARM_LINK: f64 = 0.09;
/// From the trunk's axis to the arms \[m\]: thirty hang there side by side.
const SHOULDER: f64 = 0.8;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// In [`FINGERS`].
    pub fingers: usize,
    /// In [`CONTACTS_PER_FINGER`].
    pub contacts_per_finger: usize,
    /// In [`OTHER_JOINTS`].
    pub other_joints: usize,
}

impl Hand {
    /// A hand of this size.
    ///
    /// # Errors
    /// A number out of its range.
    pub fn new(fingers: usize, contacts_per_finger: usize, other_joints: usize) -> anyhow::Result<Self> {
        let within = |what: &str, n: usize, range: RangeInclusive<usize>| {
            ensure!(range.contains(&n), "{n} {what}: a generated hand has {} to {}", range.start(), range.end());
            Ok(())
        };
        within("fingers", fingers, FINGERS)?;
        within("contacts per finger", contacts_per_finger, CONTACTS_PER_FINGER)?;
        within("other joints", other_joints, OTHER_JOINTS)?;
        Ok(Self { fingers, contacts_per_finger, other_joints })
    }

    /// Contacts with the can.
    pub fn contacts(&self) -> usize {
        self.fingers * self.contacts_per_finger
    }

    /// Degrees of freedom, the can's among them.
    pub fn nv(&self) -> usize {
        self.fingers * FINGER_JOINTS.len() + self.other_joints + 6
    }

    /// As the scenario is called: fingers, contacts of each, other joints.
    pub fn name(&self) -> String {
        format!("hand-{}x{}-{}", self.fingers, self.contacts_per_finger, self.other_joints)
    }

    /// Scenario and model, ready to run.
    ///
    /// # Errors
    /// None unless MuJoCo refuses its own compiler's options.
    pub fn plan(&self) -> anyhow::Result<Plan> {
        let path = format!("{}.toml", self.name());
        let file = ScenarioFile::parse(&self.scenario(), Path::new(&path))?;
        Ok(Plan::new(&file, Path::new(&path), Model::from_xml_string(&self.mjcf())?)?)
    }

    /// Writes the scenario and its model into a folder, for the command line; gives the scenario's path.
    ///
    /// # Errors
    /// What writing files brings.
    pub fn write(&self, folder: &Path) -> anyhow::Result<std::path::PathBuf> {
        let path = folder.join(format!("{}.toml", self.name()));
        std::fs::create_dir_all(folder)?;
        std::fs::write(path.with_extension("xml"), self.mjcf())?;
        std::fs::write(&path, self.scenario())?;
        Ok(path)
    }

    /// The scenario's text. The can is held in place until all fingers press.
    pub fn scenario(&self) -> String {
        let name = self.name();
        let targets: Vec<String> = (0..self.fingers)
            .flat_map(|finger| FINGER_JOINTS.map(|(joint, lever)| (finger, joint, lever)))
            .map(|(finger, joint, lever)| format!("f{finger}_{joint} = {:.4}", PRESS * lever / FINGER_KP))
            .collect();
        format!(
            r#"name = "{name}"
model = "{name}.xml"

[[grasp]]
target = "can"
palm = "palm"

[timeline]
duration = 1.2
pin_until = 0.4
measure_from = 0.8

[[control]]
time = 0.2
set = {{ {} }}
"#,
            targets.join(", ")
        )
    }

    /// The model's text.
    pub fn mjcf(&self) -> String {
        let Self { fingers, contacts_per_finger, .. } = self;
        let (trunk, actuators) = (self.trunk(), self.actuators());
        let can_height = 1.5 - ARM_JOINTS as f64 * ARM_LINK - FINGER_JOINTS[1].1;
        format!(
            r#"<!-- {fingers} fingers hold a can with {contacts_per_finger} contacts each. Made by benches/hands/hand.rs. -->
<mujoco model="{name}">
  <compiler angle="radian"/>
  <option timestep="0.002" cone="elliptic" impratio="10"/>
  <default>
    <geom condim="4" friction="1 0.005 0.0001"/>
    <default class="trunk"><joint damping="2000" armature="1"/><position kp="20000"/></default>
    <default class="arm"><joint damping="20" armature="0.01"/><position kp="500"/></default>
    <default class="finger">
      <joint axis="0 1 0" damping="0.05" armature="0.0002" limited="true" range="-0.5 1.57"/>
      <position kp="{FINGER_KP}"/>
    </default>
  </default>
  <worldbody>
    <light pos="0.5 -1 2.5" dir="-0.3 0.6 -1"/>
    <camera name="hand" pos="{SHOULDER} -0.5 {can_height}" xyaxes="1 0 0 0 0 1"/>
    <geom type="plane" size="2 2 0.1"/>
{trunk}
    <body name="can" pos="{SHOULDER} 0 {can_height}">
      <freejoint name="can"/>
      <geom type="cylinder" size="{CAN_RADIUS} 0.0575" mass="0.35" rgba="0.2 0.5 0.8 1"/>
    </body>
  </worldbody>
  <actuator>
{actuators}  </actuator>
</mujoco>
"#,
            name = self.name(),
        )
    }

    /// Joints of each arm, the hand's first; all but the last have as many as an arm has.
    fn arms(&self) -> Vec<usize> {
        let mut left = self.other_joints - TRUNK_JOINTS;
        let mut arms = Vec::new();
        while left > 0 {
            arms.push(left.min(ARM_JOINTS));
            left -= left.min(ARM_JOINTS);
        }
        arms
    }

    /// Three links upwards, at whose top the arms hang.
    fn trunk(&self) -> String {
        let arms = self.arms();
        let mut inside = String::new();
        for (arm, &joints) in arms.iter().enumerate() {
            let angle = TAU * arm as f64 / arms.len() as f64;
            let pos = format!("{:.5} {:.5} 0.15", SHOULDER * angle.cos(), SHOULDER * angle.sin());
            let end = if arm == 0 { self.palm() } else { String::new() };
            inside.push_str(&arm_links(arm, &pos, joints, &end));
        }
        (0..TRUNK_JOINTS).rev().fold(inside, |inside, joint| {
            let z = if joint == 0 { 1.05 } else { 0.15 };
            format!(
                r#"<body pos="0 0 {z}"><joint name="trunk_{joint}" class="trunk" axis="{}"/>
<geom type="box" size="0.1 0.1 0.05" pos="0 0 0.075" mass="10.7"/>
{inside}</body>
"#,
                axis(joint)
            )
        })
    }

    fn palm(&self) -> String {
        let mut palm = format!(
            r#"<body name="palm" pos="0 0 {}"><geom type="cylinder" size="0.055 0.01" pos="0 0 0.01" mass="0.3"/>
"#,
            -ARM_LINK
        );
        for finger in 0..self.fingers {
            palm.push_str(&self.finger(finger));
        }
        palm + "</body>"
    }

    /// A finger whose frame has x outwards, so that a positive angle presses.
    fn finger(&self, finger: usize) -> String {
        let angle = TAU * finger as f64 / self.fingers as f64;
        let out = CAN_RADIUS + PAD + FINGER_RADIUS;
        let base = format!(
            r#"pos="{:.6} {:.6} 0" quat="{:.9} 0 0 {:.9}""#,
            out * angle.cos(),
            out * angle.sin(),
            (0.5 * angle).cos(),
            (0.5 * angle).sin()
        );
        format!(
            r#"<body name="f{finger}_proximal" {base}>
<joint name="f{finger}_spread" class="finger" axis="1 0 0" range="-0.35 0.35"/><joint name="f{finger}_knuckle" class="finger"/>
<geom type="capsule" size="{FINGER_RADIUS}" fromto="0 0 0 0 0 {}" mass="0.030"/>
<body name="f{finger}_tip" pos="0 0 {}"><joint name="f{finger}_middle" class="finger"/>
<geom type="capsule" size="{FINGER_RADIUS}" fromto="0 0 0 0 0 {}" mass="0.030"/>
{}</body></body>
"#,
            -PROXIMAL,
            -PROXIMAL,
            -(MIDDLE + TIP),
            self.pads(out)
        )
    }

    /// Pads of the last phalanx, whose axis is `out` from the can's: on the can's surface, in a ring about its middle.
    fn pads(&self, out: f64) -> String {
        let ring = if self.contacts_per_finger == 1 { 0.0 } else { RING };
        let reach = CAN_RADIUS + PAD;
        let mut pads = String::new();
        for pad in 0..self.contacts_per_finger {
            let angle = TAU * pad as f64 / self.contacts_per_finger as f64;
            let (up, round) = (ring * angle.cos(), ring * angle.sin() / CAN_RADIUS);
            let (x, y, z) = (reach * round.cos() - out, reach * round.sin(), up - FINGER_JOINTS[2].1);
            let _ = writeln!(pads, r#"<geom size="{PAD}" pos="{x:.6} {y:.6} {z:.6}" mass="0"/>"#);
        }
        pads
    }

    fn actuators(&self) -> String {
        let servo = |class: &str, joint: String| {
            format!("    <position name=\"{joint}\" joint=\"{joint}\" class=\"{class}\"/>\n")
        };
        let mut all: String = (0..TRUNK_JOINTS).map(|joint| servo("trunk", format!("trunk_{joint}"))).collect();
        for (arm, joints) in self.arms().into_iter().enumerate() {
            all.extend((0..joints).map(|joint| servo("arm", format!("arm{arm}_{joint}"))));
        }
        for finger in 0..self.fingers {
            all.extend(FINGER_JOINTS.map(|(joint, _)| servo("finger", format!("f{finger}_{joint}"))));
        }
        all
    }
}

/// Links that hang one below the other, with `end` at the last.
fn arm_links(arm: usize, pos: &str, joints: usize, end: &str) -> String {
    (0..joints).rev().fold(end.to_owned(), |inside, joint| {
        let at = if joint == 0 { pos.to_owned() } else { format!("0 0 {}", -ARM_LINK) };
        format!(
            r#"<body pos="{at}"><joint name="arm{arm}_{joint}" class="arm" axis="{}"/>
<geom type="capsule" size="0.025" fromto="0 0 -0.02 0 0 -0.07" mass="0.7"/>
{inside}</body>
"#,
            axis(joint)
        )
    })
}

fn axis(joint: usize) -> &'static str {
    ["1 0 0", "0 1 0", "0 0 1"][joint % 3]
}
