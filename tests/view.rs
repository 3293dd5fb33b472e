//! What is done in the window: without a window first, then with one on a virtual display.

mod cli_common;
#[path = "view_support/display.rs"]
mod display;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use cli_common::reference::{collect, named, page, section};
use cli_common::{call_in, data};
use display::{Display, wait};
use mujoco_grasp::grasp::{GraspId, Phase};
use mujoco_grasp::mujoco::{
    Camera, Drawing, Error, Model, Perturb, Picked, Pull, Renderer, Scene, Segment, Simulation, Tint,
};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use mujoco_grasp::view::{Action, Button, Digest, Gaze, KEYS, Modifiers, Pointer, Recording, Seen, Session, show};
use nalgebra::Vector3;

/// Steps of the claw after which its grasp is latched: the pin goes at 2 s.
const LATCHED: u64 = 1100;

fn claw() -> Plan {
    Plan::load(&data("claw.toml")).unwrap()
}

fn push(force: [f64; 3]) -> Action {
    Action::Push { body: "object".to_owned(), force, torque: [0.0; 3] }
}

/// Steps until `step`.
fn run(session: &mut Session, step: u64) {
    while session.steps() < step {
        session.step().unwrap();
    }
}

fn phase(session: &Session) -> Phase {
    session.grasps()[GraspId::FIRST].phase()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

// ------------------------------------------------------------------------------------------------ the session

#[test]
fn a_session_is_the_run_of_its_scenario_with_the_same_pushes_bit_for_bit() {
    let plan = claw();
    let mut session = Session::new(&plan).unwrap();
    let mut runner = Runner::new(&plan, Mode::Grasp, None).unwrap();
    let body = plan.model.body("object").unwrap();
    for step in 0..LATCHED + 200 {
        let force = Vector3::new(1.5, 0.25, -0.5);
        match step {
            LATCHED => {
                session.act(push(force.into())).unwrap();
                runner.sim_mut().set_body_wrench(body, &force, &Vector3::zeros()).unwrap();
            }
            1200 => {
                session.act(Action::Release).unwrap();
                runner.sim_mut().set_body_wrench(body, &Vector3::zeros(), &Vector3::zeros()).unwrap();
            }
            _ => {}
        }
        session.step().unwrap();
        runner.step().unwrap();
        assert_eq!(bits(session.sim().qpos()), bits(runner.sim().qpos()), "step {step}");
    }
    assert_eq!(phase(&session), Phase::Grasped);
}

/// Holds, slips, is lost, and is latched again after a reset; in between the modes are switched.
fn story(plan: &Plan) -> Session {
    let mut session = Session::new(plan).unwrap();
    let place = |session: &Session| session.sim().qpos()[..3].to_vec();
    run(&mut session, LATCHED);
    assert_eq!(phase(&session), Phase::Grasped, "latched");
    let held = place(&session);
    let moved = |session: &Session| {
        let now = place(session);
        (0..3).map(|i| (now[i] - held[i]).powi(2)).sum::<f64>().sqrt()
    };
    session.act(push([0.0, 0.0, -1.0])).unwrap();
    run(&mut session, 1300);
    assert_eq!(phase(&session), Phase::Grasped);
    let after_small = moved(&session);
    session.act(Action::Mode(Mode::Full)).unwrap();
    assert_eq!((session.mode(), phase(&session)), (Mode::Full, Phase::Ungrasped));
    run(&mut session, 1400);
    assert_eq!(phase(&session), Phase::Ungrasped, "full mode only watches");
    assert!(session.sim().contact_count() > 0 && moved(&session) < 0.005, "held by the engine's own solve");
    session.act(Action::Mode(Mode::Grasp)).unwrap();
    run(&mut session, 1500);
    assert_eq!(phase(&session), Phase::Grasped, "latched again");
    session.act(push([0.0, 0.0, -40.0])).unwrap();
    run(&mut session, 1700);
    assert_eq!(phase(&session), Phase::Ungrasped, "lost");
    assert!(moved(&session) > 0.05 && after_small < 0.005, "{} and {after_small}", moved(&session));
    session.act(Action::Reset).unwrap();
    assert_eq!(session.time(), 0.0);
    run(&mut session, 1700 + LATCHED);
    assert_eq!(phase(&session), Phase::Grasped, "latched after the reset");
    session
}

#[test]
fn a_recorded_story_is_replayed_bit_for_bit_and_another_is_not() {
    let plan = claw();
    let session = story(&plan);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("story.json");
    Recording::of(&session).write(&file).unwrap();
    let recording = Recording::read(&file, &plan).unwrap();
    assert_eq!(recording, Recording::of(&session));
    let replayed = recording.replay(&plan).unwrap();
    assert_eq!(replayed.digest(), session.digest());
    assert_eq!(bits(replayed.sim().qpos()), bits(session.sim().qpos()));

    let mut other = recording.clone();
    other.events[0].action = push([0.0, 0.0, -1.0 - f64::EPSILON]);
    assert_ne!(other.replay(&plan).unwrap().digest(), session.digest(), "a last bit of one push");
    let mut other = recording;
    other.events[0].step += 1;
    assert_ne!(other.replay(&plan).unwrap().digest(), session.digest(), "a step later");
}

#[test]
fn a_session_that_is_switched_to_full_mode_at_once_is_the_engines_own() {
    let plan = claw();
    let mut session = Session::new(&plan).unwrap();
    session.act(Action::Mode(Mode::Full)).unwrap();
    let mut runner = Runner::new(&plan, Mode::Full, None).unwrap();
    for _ in 0..LATCHED {
        session.step().unwrap();
        runner.step().unwrap();
    }
    assert_eq!(bits(session.sim().qpos()), bits(runner.sim().qpos()));
}

#[test]
fn the_solver_settings_of_a_merged_grasp_do_not_outlive_a_switch_to_full_mode() {
    let plan = Plan::load_with(&data("claw.toml"), Some(mujoco_grasp::grasp::Limits::Box)).unwrap();
    let mut session = Session::new(&plan).unwrap();
    let own = session.sim().model().noslip_iterations();
    run(&mut session, LATCHED);
    assert_eq!(phase(&session), Phase::Grasped);
    assert_ne!(session.sim().model().noslip_iterations(), own, "a merged grasp has changed it");
    session.act(Action::Mode(Mode::Full)).unwrap();
    assert_eq!(session.sim().model().noslip_iterations(), own);
    run(&mut session, LATCHED + 50);
    assert_eq!(session.sim().model().noslip_iterations(), own);
}

#[test]
fn pushes_that_make_no_sense_are_refused_and_change_nothing() {
    let mut session = Session::new(&claw()).unwrap();
    let unknown = Action::Push { body: "objct".to_owned(), force: [0.0; 3], torque: [0.0; 3] };
    let message = session.act(unknown).unwrap_err().to_string();
    assert!(message.contains("objct") && message.contains("object"), "{message}");
    let message = session.act(push([0.0, f64::NAN, 0.0])).unwrap_err().to_string();
    assert!(message.contains("finite"), "{message}");
    assert!(session.events().is_empty());
    assert!(session.sim().xfrc_applied().iter().all(|x| *x == 0.0));
}

#[test]
fn a_push_that_goes_on_is_noted_once() {
    let mut session = Session::new(&claw()).unwrap();
    let body = session.sim().model().body("object").unwrap();
    session.push(Some((body, nalgebra::Vector6::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))).unwrap();
    session.push(Some((body, nalgebra::Vector6::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))).unwrap();
    assert_eq!(session.events().len(), 1, "the same push is noted once");
    session.push(None).unwrap();
    session.push(None).unwrap();
    let actions: Vec<&Action> = session.events().iter().map(|e| &e.action).collect();
    assert_eq!(actions, [&push([1.0, 0.0, 0.0]), &Action::Release]);
}

// ------------------------------------------------------------------------------------------------ the mouse

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

// ------------------------------------------------------------------------------------------------ the program

fn call_without_display(args: &[&str], display: Option<&str>) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mujoco-grasp"));
    command.args(args).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    if let Some(display) = display {
        command.env("DISPLAY", display);
    }
    let output = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn without_a_display_it_says_what_is_wrong_and_what_would_be_right() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("none.json");
    let args = ["view", &data("claw.toml"), "--record", file.to_str().unwrap()];
    for (display, wrong) in [(None, "DISPLAY is not set"), (Some(":64999"), "DISPLAY=:64999 cannot be used")] {
        let (status, stdout, stderr) = call_without_display(&args, display);
        assert_eq!((status, stdout.as_str()), (Some(1), ""), "{stderr}");
        assert!(stderr.starts_with("error: cannot open a window: ") && stderr.lines().count() == 1, "{stderr}");
        for part in [wrong, "xvfb-run", "apt install xvfb"] {
            assert!(stderr.contains(part), "{stderr}");
        }
        assert!(!stderr.contains(".cargo") && !stderr.contains("panic"), "{stderr}");
    }
    assert!(!file.exists(), "nothing was recorded");
    let (status, stdout, _) = call_without_display(&["view", "clutch", "--json"], None);
    assert!(status == Some(1) && stdout.contains("\"error\""), "{stdout}");
}

/// winit would panic.
#[test]
fn off_the_main_thread_a_window_is_an_error() {
    let error = std::thread::spawn(|| {
        let mut ended = None;
        show(&claw(), None, &mut ended).unwrap_err().to_string()
    })
    .join()
    .expect("no panic");
    assert!(error.contains("cannot open a window"), "{error}");
}

#[test]
fn recordings_that_cannot_be_replayed_are_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let head = r#"{"scenario": "claw", "engine": "2.2.2", "steps": 9"#;
    let cases = [
        (folder.path().join("gone.json").to_str().unwrap().to_owned(), "cannot be read"),
        (write("text.json", "no JSON"), "is no recording"),
        (
            write("other.json", &format!("{}, \"events\": []}}", head.replace("claw", "pinch"))),
            "of the scenario \"pinch\"",
        ),
        (
            write(
                "order.json",
                &format!(r#"{head}, "events": [{{"step": 5, "do": "reset"}}, {{"step": 4, "do": "reset"}}]}}"#),
            ),
            "in order",
        ),
        (write("key.json", &format!(r#"{head}, "evnts": []}}"#)), "evnts"),
        (write("digest.json", &format!(r#"{head}, "events": [], "digest": "xyz"}}"#)), "hexadecimal"),
    ];
    for (file, what) in cases {
        let called = call_in(folder.path(), &["view", &data("claw.toml"), "--replay", &file, "--json"]);
        assert_eq!(called.status, 2, "{}", called.stderr);
        assert!(called.stderr.contains(what) && called.stderr.contains(&file), "{what}: {}", called.stderr);
        assert!(called.json()["error"].as_str().is_some_and(|error| error.contains(what)));
    }
}

// ------------------------------------------------------------------------------------------------ the window

fn open(display: &Display, folder: &Path, args: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_mujoco-grasp"))
        .args([&["view", &data("claw.toml"), "--json"], args].concat())
        .current_dir(folder)
        .env("DISPLAY", &display.name)
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn close(display: &Display, window: Child) -> serde_json::Value {
    display.xdotool(&["key", "q"]);
    let output = window.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A pixel in the midst of the ball, as the window shows it at first.
fn place_of_ball((width, height): (u32, u32)) -> (u32, u32) {
    let session = Session::new(&claw()).unwrap();
    let poses = session.poses().unwrap();
    let grasp = &session.grasps()[GraspId::FIRST];
    let camera = Camera::for_grasp(&poses, grasp.palm(), grasp.target()).unwrap();
    let mut scene = Scene::new(poses.model()).unwrap();
    scene.update(&poses, camera, &Drawing::default()).unwrap();
    let (w, h) = (f64::from(width), f64::from(height));
    let is_ball = |x: u32, y: u32| {
        let picked = scene.pick(&poses, w / h, f64::from(x) / w, 1.0 - f64::from(y) / h).unwrap();
        picked.is_some_and(|picked| picked.body == grasp.target())
    };
    const AROUND: u32 = 20;
    let places = (0..height / 10).flat_map(|y| (0..width / 10).map(move |x| (10 * x, 10 * y)));
    let midst = |&(x, y): &(u32, u32)| {
        x > AROUND
            && y > AROUND
            && [x - AROUND, x, x + AROUND].iter().all(|&x| is_ball(x, y - AROUND) && is_ball(x, y + AROUND))
    };
    places.into_iter().find(midst).expect("the ball is in view")
}

#[test]
fn a_session_with_the_mouse_is_its_recording_bit_for_bit_without_a_window_and_in_one() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mouse.json");
    let display = Display::start();
    let window = open(&display, folder.path(), &["--record", file.to_str().unwrap()]);
    display.window("view claw$");
    let pictures = || {
        let found = std::fs::read_dir(folder.path()).unwrap().map(|f| f.unwrap().path());
        found.filter(|p| p.extension().is_some_and(|e| e == "png")).collect::<Vec<_>>()
    };
    // of the name of the last picture
    let steps = || {
        display.xdotool(&["key", "p"]);
        std::thread::sleep(Duration::from_millis(300));
        let number = |p: PathBuf| p.file_stem()?.to_str()?.rsplit('-').next()?.parse::<u64>().ok();
        pictures().into_iter().filter_map(number).max().unwrap_or(0)
    };
    wait("the latch", || steps() > LATCHED);
    display.xdotool(&["key", "space"]);
    display.window("view claw, paused");
    // a picture with the list of keys and one without
    pictures().into_iter().for_each(|p| std::fs::remove_file(p).unwrap());
    display.xdotool(&["key", "p"]);
    wait("a picture", || !pictures().is_empty());
    let first = image::open(&pictures()[0]).unwrap().to_rgb8();
    for key in ["Right", "F1", "p"] {
        display.xdotool(&["key", key]);
    }
    wait("another picture", || pictures().len() == 2);
    let other = pictures().into_iter().max_by_key(|p| p.metadata().unwrap().modified().unwrap()).unwrap();
    let second = image::open(other).unwrap().to_rgb8();
    let colours = first.pixels().map(|p| p.0).collect::<std::collections::HashSet<_>>().len();
    assert!(first.dimensions() == second.dimensions() && colours > 1000, "{:?} {colours}", first.dimensions());
    // the texts are white, the ground is black
    let white = |picture: &image::RgbImage| {
        let at = (20..400).flat_map(|y| (5..250).map(move |x| (x, y)));
        at.filter(|&(x, y)| picture.get_pixel(x, y).0.iter().all(|c| *c > 200)).count()
    };
    assert!(white(&first) > 1000 && white(&second) < 100, "keys: {} and {}", white(&first), white(&second));

    // the ball is selected and pulled at, in both modes
    let (x, y) = place_of_ball(first.dimensions());
    display.xdotool(&["mousemove", &x.to_string(), &y.to_string(), "click", "--repeat", "2", "--delay", "50", "1"]);
    display.xdotool(&["keydown", "ctrl", "mousedown", "3", "mousemove_relative", "90", "20"]);
    display.xdotool(&["key", "space"]);
    let begun = steps();
    wait("some steps", || steps() > begun + 100);
    display.xdotool(&["mouseup", "3", "keyup", "ctrl", "key", "m"]);
    let switched = steps();
    wait("some more", || steps() > switched + 100);
    let report = close(&display, window);

    let plan = claw();
    let recording = Recording::read(&file, &plan).unwrap();
    let pushes = recording.events.iter().filter(|e| matches!(&e.action, Action::Push { body, .. } if body == "object"));
    assert!(pushes.count() > 50, "the mouse has pulled: {:?}", recording.events.first());
    for action in [Action::Release, Action::Mode(Mode::Full)] {
        assert_eq!(recording.events.iter().filter(|e| e.action == action).count(), 1, "{action:?}");
    }
    let digest: Digest = serde_json::from_value(report["digest"].clone()).unwrap();
    assert_eq!(report["steps"], recording.steps);
    let replayed = recording.replay(&plan).unwrap();
    assert_eq!(replayed.digest(), digest, "without a window");

    let window = open(&display, folder.path(), &["--replay", file.to_str().unwrap()]);
    // it pauses where the recording ends
    display.window("view claw, paused");
    let report = close(&display, window);
    assert_eq!((&report["same_as_replayed"], &report["steps"]), (&true.into(), &recording.steps.into()));
    assert_eq!(serde_json::from_value::<Digest>(report["digest"].clone()).unwrap(), digest, "in a window");
    let mut keys = std::collections::BTreeSet::new();
    collect(&report, &mut keys);
    named(&section("### view"), keys);
}

#[test]
fn every_key_is_on_the_page() {
    let page = page("view.md");
    for (key, what) in KEYS {
        assert!(page.contains(&format!("| {key} | {what}")), "{key}: {what}");
    }
    let help = call_in(Path::new("."), &["view", "--help"]).stdout;
    assert!(help.contains("--record") && help.contains("--replay"));
}
