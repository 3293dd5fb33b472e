//! Pictures without a display: what is where, what is refused, and what is said when nothing can be drawn.

use image::RgbImage;
use mujoco_grasp::mujoco::{Arrow, Camera, Drawing, Error, Model, Renderer, Simulation};
use nalgebra::Vector3;

/// Objects in front of a black ground, lit by the headlight alone.
fn scene(objects: &str) -> Simulation {
    let xml = format!(
        r#"<mujoco>
          <visual><headlight ambient="0.5 0.5 0.5" diffuse="0.5 0.5 0.5" specular="0 0 0"/></visual>
          <worldbody><camera name="front" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>{objects}</worldbody>
        </mujoco>"#
    );
    started(&xml)
}

fn started(xml: &str) -> Simulation {
    let model = Model::from_xml_string(xml).expect("a model");
    let mut sim = Simulation::new(&model).expect("a simulation");
    sim.forward().expect("positions");
    sim
}

/// Looks along +y at the origin, so that x points right and z up in the picture.
const FRONT: Camera =
    Camera::Free { lookat: Vector3::new(0.0, 0.0, 0.0), distance: 2.0, azimuth_deg: 90.0, elevation_deg: 0.0 };

fn sphere(pos: [f64; 3], rgba: &str) -> String {
    let [x, y, z] = pos;
    format!(r#"<geom type="sphere" size="0.2" pos="{x} {y} {z}" rgba="{rgba}"/>"#)
}

const RED: &str = "1 0 0 1";
const GREEN: &str = "0 1 0 1";
const BLUE: &str = "0 0 1 1";

/// The one channel that is bright, if the others are dark.
fn hue(p: &image::Rgb<u8>) -> Option<usize> {
    let bright: Vec<usize> = (0..3).filter(|c| p.0[*c] > 100).collect();
    match bright[..] {
        [c] if (0..3).all(|o| o == c || p.0[o] < 60) => Some(c),
        _ => None,
    }
}

/// Middle of the pixels of a hue, as parts of the picture's width and height, and how many there are.
fn place(picture: &RgbImage, wanted: usize) -> (f64, f64, usize) {
    let of_hue = picture.enumerate_pixels().filter(|(_, _, p)| hue(p) == Some(wanted));
    let (x, y, n) = of_hue.fold((0.0, 0.0, 0), |(sx, sy, n), (x, y, _)| (sx + f64::from(x), sy + f64::from(y), n + 1));
    let count = f64::from(n.max(1) as u32);
    (x / count / f64::from(picture.width()), y / count / f64::from(picture.height()), n)
}

fn draw(sim: &Simulation, camera: Camera, drawing: &Drawing) -> RgbImage {
    let mut renderer = Renderer::new(sim.model(), 160, 120).expect("a renderer");
    renderer.draw(sim, camera, drawing).expect("a picture")
}

#[test]
fn a_red_sphere_in_the_middle_is_red_there_and_as_large_as_perspective_makes_it() {
    let sim = scene(&sphere([0.0; 3], RED));
    let picture = draw(&sim, FRONT, &Drawing::default());
    assert_eq!(picture.dimensions(), (160, 120));
    let (x, y, n) = place(&picture, 0);
    assert!((x - 0.5).abs() < 0.01 && (y - 0.5).abs() < 0.01, "at {x} {y}");
    // A sphere of radius r at distance d fills a disc of tan(asin(r/d)) / tan(fovy/2) of half the height.
    let radius = 60.0 * (0.2f64 / 2.0).asin().tan() / 22.5f64.to_radians().tan();
    let expected = std::f64::consts::PI * radius * radius;
    assert!((n as f64 - expected).abs() < 0.15 * expected, "{n} pixels, expected {expected}");
    assert_eq!(picture.get_pixel(3, 3).0, [0; 3]);
}

#[test]
fn up_is_up_and_right_is_right() {
    let all = [sphere([0.0, 0.0, 0.5], RED), sphere([0.5, 0.0, 0.0], GREEN), sphere([0.0, 0.0, -0.5], BLUE)];
    let sim = scene(&all.concat());
    for camera in [FRONT, Camera::named(sim.model(), "front").expect("the camera")] {
        let picture = draw(&sim, camera, &Drawing::default());
        let (red, green, blue) = (place(&picture, 0), place(&picture, 1), place(&picture, 2));
        assert!(red.2 > 50 && green.2 > 50 && blue.2 > 50, "{red:?} {green:?} {blue:?}");
        assert!(red.1 < 0.4 && blue.1 > 0.6, "red above blue: {red:?} {blue:?}");
        assert!((red.0 - 0.5).abs() < 0.02 && (blue.0 - 0.5).abs() < 0.02);
        assert!(green.0 > 0.6 && (green.1 - 0.5).abs() < 0.02, "green at the right: {green:?}");
    }
}

#[test]
fn the_free_camera_stands_where_its_angles_say() {
    let all = [sphere([0.5, 0.0, 0.0], RED), sphere([0.0, 0.5, 0.0], GREEN), sphere([0.0, 0.0, 0.5], BLUE)];
    let sim = scene(&all.concat());
    let origin = Vector3::zeros();
    // Along +x: the far red sphere is in the middle, y is at the left.
    let picture = draw(&sim, Camera::around(origin, 2.0, 0.0, 0.0), &Drawing::default());
    let (red, green) = (place(&picture, 0), place(&picture, 1));
    assert!((red.0 - 0.5).abs() < 0.02 && green.0 < 0.4, "{red:?} {green:?}");
    // Nearly straight down, heading along +x: x is up, y at the left, z toward us.
    let picture = draw(&sim, Camera::around(origin, 3.0, 0.0, -89.0), &Drawing::default());
    let (red, green, blue) = (place(&picture, 0), place(&picture, 1), place(&picture, 2));
    assert!(red.1 < 0.4 && green.0 < 0.45 && (blue.0 - 0.5).abs() < 0.02, "{red:?} {green:?} {blue:?}");
}

#[test]
fn sizes_that_cannot_be_drawn_are_refused() {
    let sim = scene("");
    for (width, height) in [(0, 100), (100, 0), (5000, 100), (100, u32::MAX)] {
        match Renderer::new(sim.model(), width, height) {
            Err(Error::Value { rule, .. }) => assert!(rule.contains("4096"), "{rule}"),
            Err(other) => panic!("{width} x {height}: {other:?}"),
            Ok(_) => panic!("{width} x {height} was accepted"),
        }
    }
}

#[test]
fn a_picture_may_be_larger_than_the_models_offscreen_buffer() {
    let sim = scene(&sphere([0.0; 3], RED));
    let mut renderer = Renderer::new(sim.model(), 1301, 703).expect("a renderer");
    let picture = renderer.render(&sim, FRONT).expect("a picture");
    assert_eq!(picture.dimensions(), (1301, 703));
    assert_eq!(renderer.size(), (1301, 703));
    let (x, y, n) = place(&picture, 0);
    assert!((x - 0.5).abs() < 0.01 && (y - 0.5).abs() < 0.01 && n > 10_000, "{x} {y} {n}");
}

/// They were drawn half as long as they are.
#[test]
fn an_arrow_reaches_from_its_point_to_where_it_points() {
    let ends = [-0.3, 0.3];
    let balls = ends.map(|x| format!(r#"<geom type="sphere" size="0.03" pos="{x} 0 0" rgba="{RED}"/>"#)).concat();
    let vector = Vector3::new(ends[1] - ends[0], 0.0, 0.0);
    let start = Vector3::new(ends[0], 0.0, 0.1);
    let arrow = Arrow::from_point(start, vector, 1.0, [0.0, 1.0, 0.0, 1.0]).with_width(0.02);
    let picture = draw(&scene(&balls), FRONT, &Drawing { arrows: vec![arrow], ..Drawing::default() });
    let span = |wanted: usize| {
        let columns =
            picture.enumerate_pixels().filter(|(_, _, p)| hue(p) == Some(wanted)).map(|(x, _, _)| f64::from(x));
        columns.fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), x| (least.min(x), most.max(x)))
    };
    let (balls, arrow) = (span(0), span(1));
    let near = 0.1 * (balls.1 - balls.0);
    assert!((balls.0 - arrow.0).abs() < near && (balls.1 - arrow.1).abs() < near, "balls {balls:?}, arrow {arrow:?}");
}

#[test]
fn edges_are_smooth_and_things_cast_shadows() {
    let sim = started(
        r#"<mujoco>
          <visual><headlight ambient="0.2 0.2 0.2" diffuse="0 0 0" specular="0 0 0"/></visual>
          <worldbody>
            <light directional="true" pos="-1.56 0 3" dir="0.6 0 -1" diffuse="0.7 0.7 0.7" specular="0 0 0"/>
            <geom type="plane" size="3 3 0.1" rgba="1 1 1 1"/>
            <geom type="sphere" size="0.2" pos="0 0 0.4" rgba="1 0 0 1"/>
          </worldbody>
        </mujoco>"#,
    );
    let picture = draw(&sim, Camera::around(Vector3::zeros(), 3.0, 90.0, -70.0), &Drawing::default());
    let grey: Vec<u8> = picture.pixels().filter(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]).map(|p| p.0[0]).collect();
    let (lit, shadow) = (grey.iter().max().copied().unwrap_or(0), 51);
    assert!(lit > 150, "{lit}");
    let dark = grey.iter().filter(|g| g.abs_diff(shadow) < 12).count();
    assert!(dark > 100, "{dark} pixels in the shadow");
    let mixed = picture.pixels().filter(|p| p.0[0] > p.0[1] + 20 && p.0[1] > 20).count();
    assert!(mixed > 10, "{mixed} pixels on the edge of the sphere mix its colour with the floor's");
}

#[test]
fn arrows_go_where_they_point_and_bad_ones_are_refused() {
    let sim = scene(&sphere([0.0; 3], RED));
    let green = [0.0, 1.0, 0.0, 1.0];
    let force = Vector3::new(0.0, 0.0, -5.0);
    let tip = Vector3::new(0.0, 0.0, 0.2);
    let arrow = Arrow::to_point(tip, force, 0.1, green).with_width(0.02);
    let shown = Drawing { arrows: vec![arrow], ..Drawing::default() };
    assert_eq!(place(&draw(&sim, FRONT, &Drawing::default()), 1).2, 0);
    let (x, y, n) = place(&draw(&sim, FRONT, &shown), 1);
    assert!((x - 0.5).abs() < 0.02 && y < 0.4 && n > 50, "above the sphere: {x} {y} {n}");
    let down = Arrow::from_point(-tip, force, 0.1, green).with_width(0.02);
    let (_, y, n) = place(&draw(&sim, FRONT, &Drawing { arrows: vec![down], ..Drawing::default() }), 1);
    assert!(y > 0.6 && n > 50, "below the sphere: {y} {n}");
    let none = Arrow { vector: Vector3::zeros(), ..arrow };
    assert_eq!(place(&draw(&sim, FRONT, &Drawing { arrows: vec![none], ..Drawing::default() }), 1).2, 0);

    let mut renderer = Renderer::new(sim.model(), 16, 16).expect("a renderer");
    let bad = [
        Arrow { from: Vector3::new(f64::NAN, 0.0, 0.0), ..arrow },
        Arrow { vector: Vector3::new(0.0, f64::INFINITY, 0.0), ..arrow },
        Arrow { rgba: [0.0, 2.0, 0.0, 1.0], ..arrow },
        arrow.with_width(0.0),
    ];
    for arrow in bad {
        let result = renderer.draw(&sim, FRONT, &Drawing { arrows: vec![arrow], ..Drawing::default() });
        assert!(matches!(result, Err(Error::Value { .. })), "{arrow:?}: {result:?}");
    }
    let many = Drawing { arrows: vec![arrow; 100_000], ..Drawing::default() };
    assert!(matches!(renderer.draw(&sim, FRONT, &many), Err(Error::Rendering(_))));
}

#[test]
fn contacts_are_shown_when_asked_for() {
    let mut sim = started(
        r#"<mujoco>
          <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/><rgba contactpoint="0 1 0 1" contactforce="0 0 1 1" contactgap="0 1 0 1"/><map force="0.05"/>
            <scale contactwidth="0.5" contactheight="0.2" forcewidth="0.3"/></visual>
          <worldbody>
            <geom name="floor" type="plane" size="3 3 0.1" rgba="0.2 0.2 0.2 1"/>
            <body pos="0 0 0.099"><freejoint/><geom name="ball" type="sphere" size="0.1" mass="1" rgba="0.3 0.3 0.3 0.4"/></body>
          </worldbody>
        </mujoco>"#,
    );
    let camera = Camera::around(Vector3::new(0.0, 0.0, 0.1), 1.0, 90.0, -30.0);
    let count = |sim: &Simulation, drawing: &Drawing, hue| place(&draw(sim, camera, drawing), hue).2;
    assert_eq!(sim.contact_count(), 1);
    let points = Drawing { contact_points: true, ..Drawing::default() };
    let forces = Drawing { contact_forces: true, ..Drawing::default() };
    for hue in [1, 2] {
        assert_eq!(count(&sim, &Drawing::default(), hue), 0);
    }
    assert!(count(&sim, &points, 1) > 20);
    assert_eq!(count(&sim, &points, 2), 0);
    assert!(count(&sim, &forces, 2) > 20);
    // A contact that is kept out of the solve has a place but no force.
    sim.collision().expect("found again");
    sim.exclude_contact(0).expect("excluded");
    sim.make_constraint().expect("no rows");
    assert!(count(&sim, &points, 1) > 20);
    assert_eq!(count(&sim, &forces, 2), 0);
}

#[test]
fn sites_can_be_left_out() {
    let sim = scene(r#"<site type="sphere" size="0.2" rgba="0 1 0 1"/>"#);
    assert!(place(&draw(&sim, FRONT, &Drawing::default()), 1).2 > 50);
    let hidden = Drawing { hide_sites: true, ..Drawing::default() };
    assert_eq!(place(&draw(&sim, FRONT, &hidden), 1).2, 0);
}

#[test]
fn cameras_that_do_not_exist_are_refused() {
    let sim = scene("");
    let message = Camera::named(sim.model(), "frnt").expect_err("no such camera").to_string();
    assert!(message.contains("front"), "{message}");
    let mut renderer = Renderer::new(sim.model(), 16, 16).expect("a renderer");
    let camera = mujoco_grasp::mujoco::CameraId::from_index(1);
    let result = renderer.render(&sim, Camera::Fixed(camera));
    assert!(matches!(result, Err(Error::OutOfRange { .. })), "{result:?}");
    for (distance, azimuth) in [(0.0, 0.0), (f64::NAN, 0.0), (1.0, f64::NAN), (1.0, f64::INFINITY)] {
        let result = renderer.render(&sim, Camera::around(Vector3::zeros(), distance, azimuth, 0.0));
        assert!(matches!(result, Err(Error::Value { .. })), "{result:?}");
    }
}

#[test]
fn a_renderer_draws_every_simulation_of_its_model_and_no_other() {
    let red = scene(&sphere([0.0; 3], RED));
    let copy = red.try_clone().expect("a copy");
    let other = scene(&sphere([0.0; 3], RED).repeat(2));
    let mut renderer = Renderer::new(red.model(), 64, 48).expect("a renderer");
    let picture = renderer.render(&red, FRONT).expect("a picture");
    assert_eq!(renderer.render(&copy, FRONT).expect("a picture"), picture);
    let message = renderer.render(&other, FRONT).expect_err("another model").to_string();
    assert!(message.contains("another model"), "{message}");
    assert_eq!(renderer.render(&red, FRONT).expect("still working"), picture);
}

#[test]
fn several_renderers_live_side_by_side_and_one_after_the_other() {
    let sims = [RED, BLUE].map(|color| scene(&sphere([0.0; 3], color)));
    let mut renderers = sims.each_ref().map(|s| Renderer::new(s.model(), 64, 48).expect("a renderer"));
    for _ in 0..3 {
        for (i, hue) in [(0, 0), (1, 2)] {
            let picture = renderers[i].render(&sims[i], FRONT).expect("a picture");
            assert!(place(&picture, hue).2 > 20);
        }
    }
    let [first, mut second] = renderers;
    drop(first);
    assert!(place(&second.render(&sims[1], FRONT).expect("a picture"), 2).2 > 20);
    for _ in 0..5 {
        assert!(place(&draw(&sims[0], FRONT, &Drawing::default()), 0).2 > 20);
    }
}

#[test]
fn threads_draw_the_same_at_the_same_time() {
    let alone = draw(&scene(&sphere([0.1, 0.0, 0.2], RED)), FRONT, &Drawing::default());
    let pictures: Vec<RgbImage> = std::thread::scope(|scope| {
        let draw_one = || draw(&scene(&sphere([0.1, 0.0, 0.2], RED)), FRONT, &Drawing::default());
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(draw_one)).collect();
        threads.into_iter().map(|t| t.join().expect("no panic")).collect()
    });
    assert!(pictures.iter().all(|p| *p == alone));
}

/// A palm with two fingers around a ball, turned by `euler` and away from the origin, on a long arm.
fn hand(euler: &str) -> Simulation {
    started(&format!(
        r#"<mujoco>
          <visual><headlight ambient="0.5 0.5 0.5" diffuse="0.5 0.5 0.5" specular="0 0 0"/></visual>
          <worldbody><body name="arm" pos="3 2 1" euler="{euler}">
            <geom type="capsule" fromto="-0.06 0 0 -1 0 0" size="0.02" rgba="0.3 0.3 0.3 1"/>
            <body name="palm"><joint axis="0 1 0"/><geom type="box" size="0.02 0.05 0.05" rgba="0 1 0 1"/>
              <body pos="0.02 0.05 0"><geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" rgba="0 1 0 1"/></body>
              <body pos="0.02 -0.05 0"><geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" rgba="0 1 0 1"/></body>
            </body>
          </body>
          <body name="ball" pos="3 2 1" euler="{euler}"><geom type="sphere" size="0.03" pos="0.07 0 0" rgba="1 0 0 1"/></body>
          </worldbody>
        </mujoco>"#
    ))
}

#[test]
fn the_grasp_camera_shows_all_of_the_hand_and_the_target_however_it_is_turned() {
    for euler in ["0 0 0", "0 0 100", "0 90 0", "0 -90 0", "90 0 200", "30 40 50"] {
        let sim = hand(euler);
        let id = |name| sim.model().body(name).expect("a body");
        let camera = Camera::on_grasp(&sim, id("palm"), id("ball")).expect("a camera");
        let picture = draw(&sim, camera, &Drawing::default());
        let (red, green) = (place(&picture, 0).2, place(&picture, 1).2);
        assert!(red > 100, "{euler}: {red} pixels of the target");
        assert!(green > 300, "{euler}: {green} pixels of the hand");
        let (width, height) = picture.dimensions();
        let on_edge = |x: u32, y: u32| x == 0 || y == 0 || x == width - 1 || y == height - 1;
        let cut = picture.enumerate_pixels().filter(|(x, y, p)| on_edge(*x, *y) && hue(p).is_some()).count();
        assert_eq!(cut, 0, "{euler}: hand and target are whole");
    }
}

#[test]
fn the_grasp_camera_needs_something_to_see() {
    let sim = started(r#"<mujoco><worldbody><body name="palm"/><body name="ball" pos="1 0 0"/></worldbody></mujoco>"#);
    let id = |name| sim.model().body(name).expect("a body");
    let message = Camera::on_grasp(&sim, id("palm"), id("ball")).expect_err("no geoms").to_string();
    assert!(message.contains("palm") && message.contains("ball"), "{message}");
    let nobody = mujoco_grasp::mujoco::BodyId::from_index(99);
    for (palm, target) in [(nobody, id("ball")), (id("palm"), nobody)] {
        let result = Camera::on_grasp(&sim, palm, target);
        assert!(matches!(result, Err(Error::OutOfRange { .. })), "{result:?}");
    }
}

/// Runs as a process of its own without any EGL driver, because a process looks for drivers once.
#[test]
fn without_a_driver_the_error_names_the_packages() {
    const CHILD: &str = "MUJOCO_GRASP_TEST_WITHOUT_DRIVER";
    if std::env::var_os(CHILD).is_some() {
        let error = Renderer::new(scene("").model(), 16, 16).err().expect("there is no driver");
        println!("error: {error}");
        return;
    }
    let output = std::process::Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "render::without_a_driver_the_error_names_the_packages", "--nocapture"])
        .env(CHILD, "1")
        .env("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent.json")
        .output()
        .expect("it runs");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    let message = text.lines().find(|l| l.contains("error: ")).unwrap_or_default();
    for part in ["cannot draw a picture", "apt install", "libegl1", "libgl1-mesa-dri"] {
        assert!(message.contains(part), "{text}");
    }
}
