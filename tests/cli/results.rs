//! What is left of a call that a full disk or a signal cuts short, and of the call before it.

use crate::program::{Called, call_in, changed_claw, data};
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Calls `mujoco-grasp` from a shell that has run `before`.
fn call_after(before: &str, folder: &Path, args: &[&str]) -> Called {
    let output = Command::new("bash")
        .args(["-c", &format!("{before}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_mujoco-grasp")])
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap();
    Called {
        status: output.status.code().expect("ended by a signal"),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

#[test]
fn on_a_full_disk_the_numbers_are_kept_and_no_file_is_half_there() {
    let folder = tempfile::tempdir().unwrap();
    // No file may grow beyond 8 KiB, which the system refuses as it would on a full disk.
    let full = "trap '' XFSZ; ulimit -f 8";
    let called = call_after(full, folder.path(), &["run", &data("claw.toml"), "--push", "along", "--json"]);
    assert_eq!(called.status, 1, "{}", called.stderr);
    let json = called.json();
    for mode in ["full", "grasp"] {
        assert_eq!(json["runs"][0][mode]["outcome"], "held");
        assert!(json["error"].as_str().unwrap().contains(&format!("{mode}-along.csv")), "{}", json["error"]);
    }
    assert_eq!(json["runs"][0]["compare"]["same_outcome"], true);
    for text in [json["error"].as_str().unwrap(), &called.stderr] {
        assert_eq!(text.matches("os error").count(), 1, "the system's reason, once: {text}");
    }
    assert_eq!(names(&folder.path().join("out/claw")), [""; 0]);
}

#[test]
fn a_file_that_cannot_be_written_harms_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("o");
    std::fs::create_dir_all(out.join("full-along.csv")).unwrap();
    let called = call_in(folder.path(), &["run", &data("claw.toml"), "--push", "along", "--out", "o", "--no-pictures"]);
    assert_eq!(called.status, 1);
    assert!(called.stdout.contains("grasp mode against full"), "the tables are there: {}", called.stdout);
    assert_eq!(called.stderr.matches("Is a directory").count(), 1, "{}", called.stderr);
    assert_eq!(names(&out), ["full-along.csv", "grasp-along.csv"]);
}

#[test]
fn standard_output_that_is_full_is_a_failure_with_one_reason() {
    let folder = tempfile::tempdir().unwrap();
    for args in [&["list"][..], &["list", "--json"]] {
        let output = Command::new(env!("CARGO_BIN_EXE_mujoco-grasp"))
            .args(args)
            .current_dir(folder.path())
            .stdout(std::fs::File::options().write(true).open("/dev/full").unwrap())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(stderr.contains("standard output"), "{stderr}");
        assert_eq!(stderr.matches("No space left").count(), 1, "{stderr}");
    }
}

#[test]
fn files_of_an_earlier_run_do_not_lie_beside_those_of_this_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("o");
    let call = |options: &[&str]| {
        let called = call_in(folder.path(), &[&["run", &data("claw.toml"), "--out", "o"], options].concat());
        assert_eq!(called.status, 0, "{}", called.stderr);
    };
    call(&["--push", "all"]);
    let of_a_push =
        |push: &str| ["full-P.csv", "grasp-P.csv", "motion-P.svg", "strip-P.png"].map(|name| name.replace('P', push));
    for push in ["along", "down", "twist"] {
        assert!(of_a_push(push).iter().all(|name| out.join(name).exists()), "{:?}", names(&out));
    }
    // What is not this program's stays, whatever its name.
    std::fs::write(out.join("grasp-data.csv"), "mine").unwrap();
    std::fs::write(out.join("strip-data.png"), "mine").unwrap();
    call(&["--push", "down", "--no-pictures"]);
    assert_eq!(names(&out), ["full-down.csv", "grasp-data.csv", "grasp-down.csv", "strip-data.png"]);
}

fn spawn(folder: &Path, args: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_mujoco-grasp"))
        .args(args)
        .current_dir(folder)
        .env("RAYON_NUM_THREADS", "1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn wait_for(path: &Path, child: &mut Child) {
    while !path.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it is over before {}", path.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args(["-s", name, &child.id().to_string()]).status().unwrap().success());
}

fn finish(mut child: Child) -> Called {
    let (mut stdout, mut stderr) = (String::new(), String::new());
    child.stdout.take().unwrap().read_to_string(&mut stdout).unwrap();
    child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
    let status = child.wait().unwrap().code().expect("it ended itself");
    Called { status, stdout, stderr }
}

#[test]
fn an_interrupted_run_keeps_and_reports_what_is_finished() {
    for (name, status) in [("INT", 130), ("TERM", 143)] {
        let folder = tempfile::tempdir().unwrap();
        let mut child = spawn(folder.path(), &["run", &data("claw.toml"), "--duration", "60", "--json"]);
        let out = folder.path().join("out/claw");
        wait_for(&out.join("full-along.csv"), &mut child);
        signal(&child, name);
        let called = finish(child);
        assert_eq!(called.status, status, "{}", called.stderr);
        let json = called.json();
        let error = json["error"].as_str().unwrap();
        assert!(error.contains(&format!("interrupted by SIG{name}")) && error.contains("of 6 runs"), "{error}");
        assert!(called.stderr.contains(error), "{}", called.stderr);
        let pairs = json["runs"].as_array().unwrap();
        assert!(pairs.len() == 3 && pairs[0]["full"]["outcome"].is_string(), "{json}");
        assert!(pairs[2]["grasp"].is_null() && pairs[2]["compare"].is_null());
        // A file for each run that is reported, whole, and nothing else.
        let reported = pairs.iter().flat_map(|p| [&p["full"], &p["grasp"]]).filter(|r| !r.is_null()).count();
        assert_eq!(names(&out).iter().filter(|n| n.ends_with(".csv")).count(), reported, "{:?}", names(&out));
        let text = std::fs::read_to_string(out.join("full-along.csv")).unwrap();
        assert_eq!(text.lines().count(), 30_002, "head, and a row for each step");
    }
}

#[test]
fn an_interrupted_agree_keeps_the_onsets_that_it_found() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = spawn(folder.path(), &["agree", &data("claw.toml"), "--json"]);
    let out = folder.path().join("out/claw");
    wait_for(&out, &mut child);
    std::thread::sleep(Duration::from_millis(1500));
    signal(&child, "TERM");
    let called = finish(child);
    assert_eq!(called.status, 143, "{}", called.stderr);
    let json = called.json();
    assert!(json["error"].as_str().unwrap().contains("interrupted by SIGTERM"), "{}", json["error"]);
    let found = json["onsets"].as_array().unwrap().len();
    assert!(found < 52 && json["trials"] == 0 && json["agreement"].is_null(), "{json}");
    let onsets = std::fs::read_to_string(out.join("agree-onsets.csv")).unwrap();
    assert_eq!(onsets.lines().count(), found + 1);
    assert_eq!(names(&out), ["agree-onsets.csv"]);
}

#[test]
fn interrupted_calls_without_partial_results_say_so() {
    for command in [&["bench", "--steps", "4000000"][..], &["calibrate"]] {
        let (folder, scenario) = changed_claw(&[], &[]);
        let args = [command, &[scenario.to_str().unwrap(), "--json"]].concat();
        let child = spawn(folder.path(), &args);
        std::thread::sleep(Duration::from_millis(500));
        signal(&child, "INT");
        let called = finish(child);
        assert_eq!((called.status, &called.json()["error"]), (130, &"interrupted by SIGINT".into()), "{args:?}");
    }
}
