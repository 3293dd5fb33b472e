//! Bad usage and bad input: exit status 2, one message that names file, field and what would be right; what was computed
//! before a failure is kept.

use crate::program::{call_in, changed_claw, data};
use std::path::Path;

/// The call ends with status 2 and an error with all `parts`, on standard error and, with --json, as one object.
#[track_caller]
fn refused(folder: &Path, args: &[&str], parts: &[&str]) {
    let called = call_in(folder, args);
    assert_eq!(called.status, 2, "{} {}", called.stdout, called.stderr);
    assert_eq!(called.stdout, "");
    let called = call_in(folder, &[args, &["--json"]].concat());
    assert_eq!(called.status, 2);
    let json = called.json();
    let message = json["error"].as_str().unwrap();
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in: {message}");
        assert!(called.stderr.contains(part), "{part:?} is not in: {}", called.stderr);
    }
    assert!(!message.contains("panicked"));
    let left: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().file_name()).filter(|f| f == "out").collect();
    assert!(left.is_empty(), "bad input leaves no folder of results");
}

#[track_caller]
fn refused_claw(model: &[(&str, &str)], scenario: &[(&str, &str)], parts: &[&str]) {
    let (folder, path) = changed_claw(model, scenario);
    for command in ["run", "quality", "bench", "agree", "calibrate"] {
        refused(folder.path(), &[command, path.to_str().unwrap()], parts);
    }
}

#[test]
fn a_scenario_that_does_not_exist() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["run", "clatch"], &["clatch", "built in are"]);
    refused(folder.path(), &["run", "missing/claw.toml"], &["missing/claw.toml"]);
    refused(folder.path(), &["quality", folder.path().to_str().unwrap()], &["cannot be read"]);
}

#[test]
fn a_model_in_the_place_of_a_scenario() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["run", &data("claw.xml")], &["claw.xml: is XML", "a scenario file", "`model`"]);
}

#[test]
fn a_usage_error_in_json_is_the_bare_message() {
    let called = call_in(&std::env::temp_dir(), &["run", &data("claw.toml"), "--frob", "--json"]);
    assert!(called.json()["error"].as_str().unwrap().starts_with("unexpected argument"), "{}", called.stdout);
}

#[test]
fn bad_usage() {
    let folder = tempfile::tempdir().unwrap();
    let claw = &data("claw.toml");
    refused(folder.path(), &["run", claw, "--mode", "both_of_them"], &["--mode", "full, grasp, both"]);
    refused(folder.path(), &["run", claw, "--push", "sideways"], &["claw.toml", "push", "\"sideways\"", "\"along\""]);
    refused(folder.path(), &["run", claw, "--scale-push", "nan"], &["--scale-push", "finite"]);
    refused(folder.path(), &["run", claw, "--at-onset", "inf"], &["--at-onset", "finite"]);
    // Its own tests are those of the feature.
    #[cfg(not(feature = "rerun"))]
    refused(folder.path(), &["run", claw, "--rerun", "a.rrd"], &["--rerun is a.rrd", "--features rerun"]);
    refused(folder.path(), &["run", claw, "--duration", "2"], &["--duration", "measure_from"]);
    refused(folder.path(), &["run", claw, "--noslip", "5000"], &["--noslip", "5000"]);
    refused(folder.path(), &["run", claw, "--noslip", "-1"], &["--noslip", "-1", "0..=1000"]);
    refused(folder.path(), &["run", claw, "--duration", "-1"], &["--duration is -1", "measure_from"]);
    refused(folder.path(), &["bench", claw, "--steps", "-1"], &["--steps", "-1", "not in 1.."]);
    refused(folder.path(), &["run", claw, "--frozen-tolerance", "0.5"], &["--frozen-tolerance is 0.5", "0 to 0.1 rad"]);
    refused(folder.path(), &["run", claw, "--frob"], &["--frob"]);
    refused(folder.path(), &["run"], &["SCENARIO"]);
    refused(folder.path(), &["frobnicate"], &["frobnicate"]);
}

#[test]
fn help_and_version_are_no_errors() {
    let folder = tempfile::tempdir().unwrap();
    for args in [&["--help"][..], &["--version"], &["run", "--help"]] {
        let called = call_in(folder.path(), args);
        assert_eq!((called.status, called.stderr.as_str()), (0, ""));
        assert!(!called.stdout.is_empty());
    }
}

#[test]
fn an_mjcf_that_is_missing_or_malformed() {
    refused_claw(&[], &[("claw.xml", "clown.xml")], &["claw.toml", "model", "clown.xml"]);
    refused_claw(&[("<worldbody>", "<worldbody")], &[], &["claw.toml", "model", "claw.xml"]);
    refused_claw(&[("<freejoint name", "<freejoin name")], &[], &["claw.toml", "claw.xml", "freejoin"]);
}

#[test]
fn unknown_names_in_the_scenario() {
    refused_claw(&[], &[("\"object\"", "\"objct\"")], &["claw.toml", "grasp[0].target", "\"objct\"", "\"object\""]);
    refused_claw(&[], &[("keyframe", "keyfarme")], &["claw.toml", "keyfarme"]);
}

#[test]
fn an_effector_that_is_the_target() {
    let with = ("palm = \"palm\"", "effectors = [\"f0_3\", \"object\"]");
    refused_claw(&[], &[with], &["claw.toml", "grasp[0].effectors[1]", "is the target itself"]);
}

#[test]
fn nan_in_a_control() {
    refused_claw(&[], &[("f0_mcp = 0.45", "f0_mcp = nan")], &["claw.toml", "control[0].set.f0_mcp", "finite"]);
}

#[test]
fn a_time_step_with_which_no_time_passes() {
    for bad in ["0", "-0.002", "nan", "inf", "10"] {
        let step = format!("timestep=\"{bad}\"");
        refused_claw(&[("timestep=\"0.002\"", &step)], &[], &["claw.toml", "model", "timestep", "must"]);
    }
}

#[test]
fn a_run_too_long_for_the_memory() {
    for (duration, steps) in [("1e300", "5.000e302 steps"), ("1e15", "5.000e17 steps")] {
        let changed = format!("duration = {duration}");
        let parts = ["claw.toml", "timeline.duration", steps, "GiB", "give less than"];
        refused_claw(&[], &[("duration = 5.0", &changed)], &parts);
    }
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["run", &data("claw.toml"), "--duration", "1e15"], &["duration", "5.000e17 steps", "GiB"]);
}

#[test]
fn a_push_that_its_factor_makes_infinite() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["run", &data("claw.toml"), "--scale-push", "1e308"], &["--scale-push", "finite"]);
}

#[test]
fn an_integrator_whose_step_cannot_be_taken_apart() {
    refused_claw(&[("<option", "<option integrator=\"RK4\"")], &[], &["claw.toml", "grasp[0]", "RK4"]);
}

/// The run fails with status 1, says why, and keeps what it had.
#[track_caller]
fn dies(model: &[(&str, &str)], scenario: &[(&str, &str)], parts: &[&str], least_rows: usize) {
    let (folder, path) = changed_claw(model, scenario);
    let called = call_in(folder.path(), &["run", path.to_str().unwrap(), "--push", "along", "--json"]);
    assert_eq!(called.status, 1, "{}", called.stderr);
    let json = called.json();
    for part in parts {
        assert!(json["error"].as_str().unwrap().contains(part), "{part:?} is not in: {}", json["error"]);
        assert!(called.stderr.contains(part), "{}", called.stderr);
    }
    assert!(json["runs"][0]["full"]["outcome"].is_null());
    assert_eq!(json["runs"][0]["compare"]["same_outcome"], false);
    for mode in ["full", "grasp"] {
        let text = std::fs::read_to_string(folder.path().join(format!("out/claw/{mode}-along.csv"))).unwrap();
        assert!(text.lines().count() > least_rows, "{mode} kept {} lines", text.lines().count());
    }
    assert!(!folder.path().join("MUJOCO_LOG.TXT").exists());
}

#[test]
#[cfg(not(mujoco3))] // sizes and messages of 2.2.2; 3.x has arena
fn buffers_too_small_for_the_contacts() {
    let small = ("<default>", "<size nconmax=\"2\" njmax=\"200\"/><default>");
    dies(&[small], &[], &["full mode, push along", "contact buffer is full", "nconmax"], 100);
    let small = ("<default>", "<size nconmax=\"50\" njmax=\"8\"/><default>");
    dies(&[small], &[], &["constraint buffer is full", "njmax"], 100);
}

#[test]
fn a_time_step_that_makes_the_simulation_diverge() {
    let unstable = [("timestep=\"0.002\"", "timestep=\"0.05\""), ("kp=\"0.25\"", "kp=\"2500\"")];
    dies(&unstable, &[], &["diverged", "smaller time step"], 1);
}
