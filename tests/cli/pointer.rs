//! What the mouse does in the window: the camera, the selection, and the spring that pulls.

use crate::session::{LATCHED, claw, run};
use mujoco_grasp::mujoco::{
    Camera, Drawing, Error, Model, Perturb, Picked, Pull, Renderer, Scene, Segment, Simulation, Tint,
};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::view::{Action, Button, Gaze, Modifiers, Pointer, Seen, Session};
use nalgebra::Vector3;
use std::time::{Duration, Instant};

/// A scene of the claw once it holds, as the window would see it.
struct View {
    session: Session,
    poses: Simulation,
    scene: Scene,
    gaze: Gaze,
    pointer: Pointer,
    now: Instant,
}

const SIZE: (u32, u32) = (400, 300);
const MIDDLE: [f64; 2] = [200.0, 150.0];
const CTRL: Modifiers = Modifiers { ctrl: true, shift: false };
const NONE: Modifiers = Modifiers { ctrl: false, shift: false };

impl View {
    fn new() -> Self {
        let mut session = Session::new(&claw()).unwrap();
        // as the window does: before the pin is gone
        let mut poses = session.poses().unwrap();
        run(&mut session, LATCHED);
        session.show(&mut poses).unwrap();
        let centre = poses.body_com(poses.model().body("object").unwrap());
        let gaze = Gaze { camera: Camera::around(centre, 0.6, 90.0, -20.0), perturb: Perturb::default() };
        let scene = Scene::new(poses.model()).unwrap();
        let mut view = Self { session, poses, scene, gaze, pointer: Pointer::default(), now: Instant::now() };
        view.update();
        view
    }

    fn update(&mut self) {
        self.scene.update(&self.poses, self.gaze.camera, &Drawing::default()).unwrap();
    }

    fn move_to(&mut self, to: [f64; 2], held: Modifiers) {
        let seen = Seen { scene: &self.scene, sim: &self.poses, size: SIZE };
        self.pointer.move_to(to, held, &mut self.gaze, seen).unwrap();
        self.update();
    }

    fn press(&mut self, button: Button, down: bool, held: Modifiers) {
        self.now += Duration::from_millis(100);
        let seen = Seen { scene: &self.scene, sim: &self.poses, size: SIZE };
        self.pointer.press((button, down), held, self.now, &mut self.gaze, seen).unwrap();
        self.update();
    }

    fn double_click(&mut self, button: Button, at: [f64; 2]) {
        self.move_to(at, NONE);
        for down in [true, false, true, false] {
            self.press(button, down, NONE);
        }
    }

    fn free(&self) -> (Vector3<f64>, f64, f64, f64) {
        match self.gaze.camera {
            Camera::Free { lookat, distance, azimuth_deg, elevation_deg } => {
                (lookat, distance, azimuth_deg, elevation_deg)
            }
            Camera::Fixed(_) => panic!("a fixed camera"),
        }
    }

    /// One step under what the mouse pulls with.
    fn step(&mut self) {
        self.session.show(&mut self.poses).unwrap();
        let wrench = self.gaze.perturb.wrench(&mut self.poses).unwrap();
        self.session.push(self.gaze.perturb.body().zip(wrench)).unwrap();
        self.session.step().unwrap();
    }
}

#[test]
fn the_mouse_orbits_pans_and_zooms() {
    let mut view = View::new();
    let (lookat, distance, azimuth, elevation) = view.free();
    view.move_to(MIDDLE, NONE);
    view.press(Button::Left, true, NONE);
    view.move_to([230.0, 150.0], NONE);
    view.press(Button::Left, false, NONE);
    let turned = view.free();
    // the picture's height is half a turn
    assert!((turned.2 - (azimuth - 180.0 * 30.0 / 300.0)).abs() < 1e-9, "{} {azimuth}", turned.2);
    assert_eq!((turned.0, turned.1, turned.3), (lookat, distance, elevation));
    view.move_to([300.0, 250.0], NONE);
    assert_eq!(view.free(), turned, "no button is down");

    view.press(Button::Right, true, NONE);
    view.move_to([300.0, 280.0], NONE);
    view.press(Button::Right, false, NONE);
    let panned = view.free();
    assert!(panned.0.z > lookat.z && panned.1 == distance, "what is dragged down follows: {panned:?}");

    let seen = Seen { scene: &view.scene, sim: &view.poses, size: SIZE };
    view.pointer.scroll(1.0, &mut view.gaze, seen).unwrap();
    let far = view.free().1;
    assert!(far > distance, "farther, as in `simulate`");
    view.pointer.scroll(-2.0, &mut view.gaze, seen).unwrap();
    assert!(view.free().1 < distance, "nearer");
}

#[test]
fn a_double_click_selects_what_is_there_and_looks_at_it() {
    let mut view = View::new();
    let object = view.poses.model().body("object").unwrap();
    view.double_click(Button::Left, MIDDLE);
    assert_eq!(view.gaze.perturb.body(), Some(object));
    let centre = view.poses.body_position(object);
    let world = centre + view.poses.body_rotation(object) * view.gaze.perturb.local_point();
    // on the near side of the ball of 3.5 cm
    assert!(world.y < centre.y && (world - centre).norm() < 0.05, "{world} {centre}");
    view.double_click(Button::Right, MIDDLE);
    assert!((view.free().0 - world).norm() < 1e-6, "{} {world}", view.free().0);
    view.double_click(Button::Left, [1.0, 1.0]);
    assert_eq!(view.gaze.perturb.body(), None, "the sky is nobody");
    for down in [true, false] {
        view.press(Button::Left, down, NONE);
    }
    view.now += Duration::from_secs(1);
    view.press(Button::Left, true, NONE);
    assert_eq!(view.gaze.perturb.body(), None, "two slow clicks are no double click");
}

#[test]
fn ctrl_drag_pulls_with_a_force_or_a_torque_until_it_is_let_go() {
    let mut view = View::new();
    view.double_click(Button::Left, MIDDLE);
    view.move_to(MIDDLE, CTRL);
    let camera = view.gaze.camera;
    view.press(Button::Right, true, CTRL);
    view.step();
    assert!(
        view.session.events().is_empty() || wrench(&view)[0].abs() < 0.05,
        "no tension yet: {:?}",
        view.session.events()
    );
    view.move_to([260.0, 150.0], CTRL);
    view.step();
    let force = wrench(&view);
    // 60 of 300 pixels at the ball's distance, looking along +y: x is to the right
    assert!(force[0] > 0.1 && force[0] > 5.0 * force[1].abs() && force[0] > 5.0 * force[2].abs(), "{force:?}");
    // of a body of 0.2 kg, not of one that is pinned
    assert!(force[0] < 5.0, "{force:?}");
    assert_eq!(view.gaze.camera, camera, "the camera stays");
    view.press(Button::Right, false, CTRL);
    view.step();
    assert_eq!(wrench(&view), [0.0; 6]);
    assert_eq!(view.session.events().last().map(|e| &e.action), Some(&Action::Release));

    view.press(Button::Left, true, CTRL);
    view.move_to([260.0, 200.0], CTRL);
    view.step();
    let torque = wrench(&view);
    assert!(torque[..3].iter().all(|f| f.abs() < 1e-9) && torque[3..].iter().any(|t| t.abs() > 1e-4), "{torque:?}");
}

fn wrench(view: &View) -> [f64; 6] {
    let sim = view.session.sim();
    sim.body_wrench(sim.model().body("object").unwrap()).unwrap().into()
}

#[test]
fn a_spring_is_refused_where_its_body_or_scene_is_not() {
    let view = View::new();
    let picked = Picked { body: mujoco_grasp::mujoco::BodyId::from_index(999), point: Vector3::zeros() };
    assert!(matches!(Perturb::select(&view.poses, &picked), Err(Error::OutOfRange { .. })));
    let other = Model::from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>").unwrap();
    let small = Simulation::new(&other).unwrap();
    let scene = Scene::new(small.model()).unwrap();
    let object = Picked { body: view.poses.model().body("object").unwrap(), point: Vector3::zeros() };
    let mut perturb = Perturb::select(&view.poses, &object).unwrap();
    assert!(matches!(perturb.begin(Pull::Force, &view.poses, &scene), Err(Error::OtherModel { .. })));
    assert!(matches!(scene.pick(&view.poses, 1.0, 0.5, 0.5), Err(Error::OtherModel { .. })));
    // a scene that was never updated has no camera
    let empty = Scene::new(view.poses.model()).unwrap();
    assert!(matches!(empty.pick(&view.poses, 1.0, 0.5, 0.5), Err(Error::Engine { .. })));
    assert!(perturb.begin(Pull::Force, &view.poses, &empty).is_err());
    let mut scene = Scene::new(small.model()).unwrap();
    let drawing = Drawing { perturb: Some(perturb), ..Drawing::default() };
    let camera = Camera::around(Vector3::zeros(), 1.0, 0.0, 0.0);
    assert!(matches!(scene.update(&small, camera, &drawing), Err(Error::OutOfRange { .. })));
}

#[test]
fn a_camera_of_the_model_that_is_freed_shows_the_same() {
    let plan = Plan::load("clutch").unwrap();
    let session = Session::new(&plan).unwrap();
    let poses = session.poses().unwrap();
    let ball = poses.model().body("ball").unwrap();
    let own = Camera::named(poses.model(), "grasp").unwrap();
    let freed = own.freed(&poses, poses.body_com(ball)).unwrap();
    assert!(matches!(freed, Camera::Free { .. }));
    let mut scene = Scene::new(poses.model()).unwrap();
    let mut pick = |camera, x, y| {
        scene.update(&poses, camera, &Drawing::default()).unwrap();
        scene.pick(&poses, 4.0 / 3.0, x, y).unwrap()
    };
    for (x, y) in [(0.5, 0.5), (0.45, 0.55), (0.55, 0.45)] {
        let (a, b) = (pick(own, x, y).unwrap(), pick(freed, x, y).unwrap());
        assert_eq!(a.body, b.body);
        // another distance with another opening angle: the same where the ball is, nearly so before it
        assert!((a.point - b.point).norm() < 0.005, "{} {}", a.point, b.point);
    }
}

// ------------------------------------------------------------------------------------------------ what is drawn

#[test]
fn tints_colour_a_body_and_segments_reach_their_ends() {
    let xml = r#"<mujoco>
      <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
      <worldbody><body name="ball"><freejoint/><geom size="0.2" rgba="1 0 0 1"/></body></worldbody></mujoco>"#;
    let mut sim = Simulation::new(&Model::from_xml_string(xml).unwrap()).unwrap();
    sim.forward().unwrap();
    let mut renderer = Renderer::new(sim.model(), 160, 120).unwrap();
    let camera = Camera::around(Vector3::zeros(), 2.0, 90.0, 0.0);
    let mut draw = |drawing: Drawing| renderer.draw(&sim, camera, &drawing);
    let body = sim.model().body("ball").unwrap();
    let tint = Tint { body, rgb: [0.0, 0.0, 1.0], share: 1.0, opacity: 1.0 };
    let middle = |drawing| draw(drawing).unwrap().get_pixel(80, 60).0;
    let mut middle = middle;
    let [r, _, b] = middle(Drawing::default());
    assert!(r > 200 && b < 20, "{r} {b}");
    let [r, _, b] = middle(Drawing { tints: vec![tint], ..Drawing::default() });
    assert!(r < 20 && b > 200, "{r} {b}");
    let [r, _, b] = middle(Drawing { tints: vec![Tint { opacity: 0.5, ..tint }], ..Drawing::default() });
    assert!(r < 20 && (60..200).contains(&b), "over a black ground: {r} {b}");
    let wrong = Drawing { tints: vec![Tint { share: 2.0, ..tint }], ..Drawing::default() };
    assert!(matches!(draw(wrong), Err(Error::Value { .. })));

    // past the ball on both sides: at a distance of 2 the picture is 2.2 wide
    for radius in [None, Some(0.03)] {
        let ends = [Vector3::new(-0.5, 0.0, 0.4), Vector3::new(0.5, 0.0, 0.4)];
        let segment = Segment { ends, radius, rgba: [0.0, 1.0, 0.0, 1.0] };
        let picture = draw(Drawing { segments: vec![segment], ..Drawing::default() }).unwrap();
        let green = picture.enumerate_pixels().filter(|(_, _, p)| p.0[1] > 100 && p.0[0] < 60).map(|(x, _, _)| x);
        let (least, most) = green.fold((u32::MAX, 0), |(least, most), x| (least.min(x), most.max(x)));
        let scale = 60.0 / 22.5_f64.to_radians().tan() / 2.0;
        let expected = [80.0 - 0.5 * scale, 80.0 + 0.5 * scale];
        let close = |x: u32, to: f64| (f64::from(x) - to).abs() < 4.0;
        assert!(close(least, expected[0]) && close(most, expected[1]), "{radius:?}: {least} {most} {expected:?}");
    }
}
