//! A robot of 37 bodies and 40 geoms that holds a ball: 22 capsules of a hand, five of which touch it.

use mujoco_grasp::mujoco::{GeomId, Simulation};

const FINGERS: usize = 5;
const LINKS: usize = 4;

/// The model, with `option` as its `<option>` element.
pub fn robot(option: &str) -> String {
    let leg = |side: f64| {
        let foot = limb("0 0 -.35", ".15 0 0", 0.03, "");
        let shin = limb("0 0 -.4", "0 0 -.3", 0.05, &foot);
        limb(&format!("0 {} -.3", 0.1 * side), "0 0 -.35", 0.06, &shin)
    };
    let arm = |side: f64, hand: &str| {
        let wrist = limb("0.27 0 0", ".1 0 0", 0.03, hand);
        let lower = limb("0.3 0 0", ".22 0 0", 0.035, &wrist);
        limb(&format!("0 {} .25", 0.25 * side), ".25 0 0", 0.04, &lower)
    };
    let fingers: String = (0..FINGERS).map(finger).collect();
    let palm = format!(
        r#"<body name="palm" pos="0.17 0 0"><joint axis="1 0 0" damping=".5"/>
        <geom name="hand a" type="capsule" size=".012" fromto="0 -.03 -.01 0 .03 -.01"/>
        <geom name="hand b" type="capsule" size=".012" fromto=".025 -.03 -.01 .025 .03 -.01"/>{fingers}</body>"#
    );
    format!(
        r#"<mujoco>{option}<size nconmax="500"/><worldbody><geom name="floor" type="plane" size="9 9 1"/>
        <geom name="table" type="box" size=".3 .3 .02" pos="1 .25 .9"/>
        <body name="torso" pos="0 0 1.2"><freejoint/><geom type="capsule" size=".1 .2"/>
          <body name="head" pos="0 0 .4"><joint axis="0 1 0" damping="1"/><geom size=".1"/></body>
          {}{}{}{}</body>
        <body name="ball" pos=".7525 .25 1.51"><freejoint/><geom name="ball" size=".04" mass=".1"/></body>
        </worldbody></mujoco>"#,
        leg(1.0),
        leg(-1.0),
        arm(1.0, &palm),
        arm(-1.0, ""),
    )
}

/// A capsule from the body's origin to `end`, on a hinge.
fn limb(position: &str, end: &str, radius: f64, children: &str) -> String {
    format!(
        r#"<body pos="{position}"><joint axis="0 1 0" damping="2"/>
        <geom type="capsule" size="{radius}" fromto="0 0 0 {end}"/>{children}</body>"#
    )
}

/// A chain of short capsules along z, at 49.9 mm from the ball's centre.
fn finger(k: usize) -> String {
    let angle = std::f64::consts::TAU * k as f64 / FINGERS as f64;
    let (sin, cos) = angle.sin_cos();
    let links: String = (0..LINKS)
        .map(|link| {
            let (x, y) = if link == 0 { (0.0125 + 0.0499 * cos, 0.0499 * sin) } else { (0.0, 0.0) };
            format!(
                r#"<body pos="{x} {y} .03"><joint axis="{} {cos} 0" damping=".02"/>
                <geom name="hand {k} {link}" type="capsule" size=".01 .01"/>"#,
                -sin
            )
        })
        .collect();
    links + &"</body>".repeat(LINKS)
}

/// The hand's geoms and the ball's.
pub fn hand_and_ball(sim: &Simulation) -> (Vec<GeomId>, Vec<GeomId>) {
    let model = sim.model();
    let named = |prefix: &str| {
        let fits = |geom: &GeomId| model.geom_name(*geom).is_some_and(|name| name.starts_with(prefix));
        model.geoms().filter(fits).collect()
    };
    (named("hand"), named("ball"))
}
