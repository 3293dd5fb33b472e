//! `view`: the window, on a virtual display.

use crate::display::{Display, wait};
use crate::page::{collect, named, page, section};
use crate::program::{call_in, data};
use crate::session::{LATCHED, claw};
use mujoco_grasp::grasp::GraspId;
use mujoco_grasp::mujoco::{Camera, Drawing, Scene};
use mujoco_grasp::scenario::runner::Mode;
use mujoco_grasp::view::{Action, Digest, KEYS, Recording, Session, show};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

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
    let mut window = open(&display, folder.path(), &["--record", file.to_str().unwrap()]);
    display.window(&mut window, "view claw$");
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
    display.window(&mut window, "view claw, paused");
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

    let mut window = open(&display, folder.path(), &["--replay", file.to_str().unwrap()]);
    // it pauses where the recording ends
    display.window(&mut window, "view claw, paused");
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
