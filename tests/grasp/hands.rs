//! Hands as MJCF: the claw of tests/data with changes, and hands of sliding fingers.

use super::hold::Scene;

const PUSH_TIME: f64 = 0.5;

/// The claw of tests/data around its ball. `DEFAULT_GEOM`, `OPTION` and the like are there to be changed.
pub fn claw() -> Scene {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    let xml = std::fs::read_to_string(path).expect("the claw");
    let closed = [("mcp", 0.45), ("pip", 0.75), ("dip", 0.3)].map(|(joint, angle)| (joint.to_owned(), angle));
    Scene {
        xml,
        closed: closed.to_vec(),
        pushes: [[1.5, 0.4, 0.0], [0.0, -0.7, -0.7]],
        push_time: PUSH_TIME,
        latch_quality: None,
    }
}

/// What a finger touches the target with.
#[derive(Clone, Copy, Debug)]
pub enum Pad {
    /// A sphere: one contact.
    Point,
    /// A lying capsule: two contacts with a face.
    Line,
    /// Three spheres: three contacts with a face.
    Triangle,
    /// A box: four contacts with a face.
    Face,
}

impl Pad {
    /// Geoms that end at the origin, along z.
    fn geoms(self) -> String {
        match self {
            Pad::Point => r#"<geom class="pad" size=".008" pos="0 0 -.008"/>"#.into(),
            Pad::Line => r#"<geom class="pad" type="capsule" size=".006" fromto="-.008 0 -.006 .008 0 -.006"/>"#.into(),
            Pad::Triangle => [(0.0, 0.009), (0.008, -0.006), (-0.008, -0.006)]
                .map(|(x, y)| format!(r#"<geom class="pad" size=".005" pos="{x} {y} -.005"/>"#))
                .concat(),
            Pad::Face => r#"<geom class="pad" type="box" size=".008 .01 .005" pos="0 0 -.005"/>"#.into(),
        }
    }
}

/// A finger that slides towards the target.
#[derive(Clone, Copy, Debug)]
pub struct Finger {
    /// Where its pad is to touch, from the target's origin \[m\].
    pub at: [f64; 3],
    /// Its way inwards.
    pub inward: [f64; 3],
    pub pad: Pad,
    /// Stiffness of its actuator along its way \[N/m\].
    pub stiffness: f64,
    /// Force with which it presses in the end \[N\].
    pub squeeze: f64,
    /// Stiffness across its way \[N/m\] and against turning \[N m/rad\]; `None`: it can only slide.
    pub gives: Option<(f64, f64)>,
    /// Distance from the target when open, and if it does not close at all \[m\].
    pub gap: f64,
}

impl Finger {
    /// Compliant in all directions.
    pub fn soft(pad: Pad, at: [f64; 3], inward: [f64; 3]) -> Finger {
        Finger { at, inward, pad, stiffness: 400.0, squeeze: 4.0, gives: Some((300.0, 0.3)), gap: 0.001 }
    }

    /// On a stiff slide.
    pub fn stiff(pad: Pad, at: [f64; 3], inward: [f64; 3]) -> Finger {
        Finger { stiffness: 2000.0, squeeze: 10.0, gives: None, ..Finger::soft(pad, at, inward) }
    }

    fn body(&self, k: usize) -> String {
        let [x, y, z] = std::array::from_fn(|i| self.at[i] - self.gap * self.inward[i] - TARGET_BELOW_PALM[i]);
        let [dx, dy, dz] = self.inward;
        let damping = 0.3 * self.stiffness.sqrt();
        let gives = self.gives.map_or(String::new(), |(across, turn)| {
            format!(
                r#"<joint type="slide" axis="1 0 0" stiffness="{across}" damping="5"/>
                <joint type="slide" axis="0 1 0" stiffness="{across}" damping="5"/>
                <joint type="ball" stiffness="{turn}" damping=".004"/>"#
            )
        });
        format!(
            r#"<body name="f{k}" pos="{x} {y} {z}" zaxis="{dx} {dy} {dz}">
            <joint name="f{k}" type="slide" axis="0 0 1" damping="{damping}"/>{gives}{}</body>"#,
            self.pad.geoms()
        )
    }

    fn actuator(&self, k: usize) -> String {
        format!(r#"<position name="f{k}" joint="f{k}" kp="{}"/>"#, self.stiffness)
    }

    fn goal(&self, k: usize) -> (String, f64) {
        (format!("f{k}"), if self.squeeze > 0.0 { self.gap + self.squeeze / self.stiffness } else { 0.0 })
    }
}

/// The target's origin in the palm's frame, negative \[m\].
const TARGET_BELOW_PALM: [f64; 3] = [0.0, 0.0, 0.1];

/// What the palm is mounted on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mount {
    /// A stiff vertical slide.
    Wrist,
    /// A hanging arm of three hinges; with its hand it weighs half a kilogram.
    Arm,
}

/// Fingers around a target.
#[derive(Clone, Debug)]
pub struct Hand {
    pub fingers: Vec<Finger>,
    /// Geoms of the target, about its origin.
    pub target: &'static str,
    /// Contact dimension.
    pub condim: usize,
    pub mount: Mount,
    /// Geoms of the palm besides the one that is far from the target, in the target's frame.
    pub palm: &'static str,
}

pub const BALL: &str = r#"<geom name="object" size=".025" mass=".1"/>"#;
pub const BOX: &str = r#"<geom name="object" type="box" size=".02 .02 .02" mass=".1"/>"#;
/// Two plates that face each other, 60 mm apart, with a rod that stays clear of the line between their middles.
pub const DUMBBELL: &str = r#"<geom type="box" size=".003 .02 .02" pos=".03 0 0" mass=".04"/>
  <geom type="box" size=".003 .02 .02" pos="-.03 0 0" mass=".04"/>
  <geom type="capsule" size=".003" fromto="-.03 0 .017 .03 0 .017" mass=".02"/>"#;

impl Hand {
    pub fn new(target: &'static str, fingers: Vec<Finger>) -> Hand {
        Hand { fingers, target, condim: 3, mount: Mount::Wrist, palm: "" }
    }

    pub fn condim(mut self, condim: usize) -> Hand {
        self.condim = condim;
        self
    }

    pub fn on(mut self, mount: Mount) -> Hand {
        self.mount = mount;
        self
    }

    /// The scene, to be pushed by `pushes`.
    pub fn scene(&self, pushes: [[f64; 3]; 2]) -> Scene {
        let fingers: String = self.fingers.iter().enumerate().map(|(k, f)| f.body(k)).collect();
        let actuators: String = self.fingers.iter().enumerate().map(|(k, f)| f.actuator(k)).collect();
        let (mount, mount_actuators) = self.mount.around(&format!(
            r#"<geom type="cylinder" size=".04 .01" pos="0 0 .012" mass=".25"/>
            <body pos="0 0 -.1">{}</body>{fingers}"#,
            self.palm
        ));
        let xml = format!(
            r#"<mujoco><option timestep="0.002" cone="elliptic" noslip_iterations="50"/>
            <default><geom condim="{}" friction="1 0.005 0.0001"/>
            <default class="pad"><geom mass="0.02"/></default></default>
            <worldbody>{mount}
            <body name="object" pos="0 0 .3"><freejoint/>{}</body></worldbody>
            <actuator>{mount_actuators}{actuators}</actuator></mujoco>"#,
            self.condim, self.target
        );
        let closed = self.fingers.iter().enumerate().map(|(k, f)| f.goal(k)).collect();
        Scene { xml, closed, pushes, push_time: PUSH_TIME, latch_quality: None }
    }
}

impl Mount {
    /// The palm with `parts`, at 0.4 m, and the actuators of the mount.
    fn around(self, parts: &str) -> (String, String) {
        match self {
            Mount::Wrist => (
                format!(
                    r#"<body name="palm" pos="0 0 .4">
                    <joint name="wrist" type="slide" axis="0 0 1" damping="50"/>{parts}</body>"#
                ),
                r#"<position joint="wrist" kp="2000"/>"#.into(),
            ),
            Mount::Arm => {
                let link = r#"<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.1" mass=".07"/>"#;
                let joint = |k: usize, axis| format!(r#"<joint name="arm{k}" axis="{axis}" damping=".1"/>"#);
                (
                    format!(
                        r#"<body pos="0 0 .7">{}{link}<body pos="0 0 -.15">{}{link}
                        <body name="palm" pos="0 0 -.15">{}{parts}</body></body></body>"#,
                        joint(0, "0 1 0"),
                        joint(1, "1 0 0"),
                        joint(2, "0 1 0"),
                    ),
                    (0..3).map(|k| format!(r#"<position joint="arm{k}" kp="5"/>"#)).collect(),
                )
            }
        }
    }
}

/// Five fingers with the same pad around a box, the fifth from below.
pub fn five(pad: Pad) -> Hand {
    let fingers = [
        ([0.02, 0.0, 0.003], [-1.0, 0.0, 0.0]),
        ([-0.02, 0.0, -0.003], [1.0, 0.0, 0.0]),
        ([0.004, 0.02, 0.0], [0.0, -1.0, 0.0]),
        ([-0.004, -0.02, 0.0], [0.0, 1.0, 0.0]),
        ([0.0, 0.0, -0.02], [0.0, 0.0, 1.0]),
    ];
    Hand::new(BOX, fingers.map(|(at, inward)| Finger::soft(pad, at, inward)).to_vec())
}

/// Two fingers opposite each other.
pub fn pinch(target: &'static str, half: f64, finger: impl Fn([f64; 3], [f64; 3]) -> Finger) -> Hand {
    let fingers = vec![finger([half, 0.0, 0.0], [-1.0, 0.0, 0.0]), finger([-half, 0.0, 0.0], [1.0, 0.0, 0.0])];
    Hand::new(target, fingers)
}
