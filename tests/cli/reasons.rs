//! What was not found, and why: said as it is.

use crate::program::{call_in, changed_claw, data};
use std::path::Path;

/// What the call says on standard error and on standard output.
#[track_caller]
fn said(folder: &Path, args: &[&str]) -> [String; 2] {
    let called = call_in(folder, args);
    assert_eq!(called.status, 0, "{}", called.stderr);
    [called.stderr, called.stdout]
}

#[test]
fn a_quality_that_did_not_last_for_latch_time() {
    let (folder, scenario) = changed_claw(&[], &[("palm = \"palm\"", "palm = \"palm\"\nlatch_time = 100.0")]);
    let args = ["run", scenario.to_str().unwrap(), "--push", "none", "--mode", "grasp", "--no-pictures"];
    let [warned, _] = said(folder.path(), &args);
    assert!(
        warned.contains("never latched") && warned.contains("for 100.0 s without a break (latch_time)"),
        "{warned}"
    );
}

#[test]
fn a_run_whose_comparisons_all_say_nothing() {
    let open = "[[control]]\ntime = 2.1\nset = { f0_mcp = 0.45 }\n\n[[control]]\ntime = 2.2\nall = 0.0\n\n[[push]]\nname = \"along\"";
    let (folder, scenario) = changed_claw(&[], &[("[[push]]\nname = \"along\"", open)]);
    let called =
        call_in(folder.path(), &["run", scenario.to_str().unwrap(), "--push", "none", "--no-pictures", "--json"]);
    let pair = &called.json()["runs"][0];
    assert!(pair["grasp"]["latched_at_s"].is_number() && pair["compare"]["vacuous"] == true, "{}", called.stdout);
    assert!(called.stderr.contains("all comparisons say nothing"), "{}", called.stderr);
}

#[test]
fn a_push_of_no_size_has_the_onset_that_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["run", &data("claw.toml"), "--push", "along", "--mode", "full", "--at-onset", "0", "--no-pictures"];
    let [_, text] = said(folder.path(), &args);
    assert!(text.contains("onset, times the push") && !text.contains("NaN") && !text.contains("inf"), "{text}");
}

#[test]
fn a_target_that_is_lost_without_a_push_has_no_onset() {
    let (folder, scenario) = changed_claw(&[], &[("set = {", "set = {} #")]);
    let scenario = scenario.to_str().unwrap();
    let onset = ["run", scenario, "--push", "along", "--mode", "full", "--at-onset", "0.5", "--no-pictures"];
    for args in [&onset[..], &["bench", scenario, "--steps", "10"]] {
        let [warned, _] = said(folder.path(), args);
        assert!(warned.contains("push along has no onset: the target is lost even without a push"), "{warned}");
    }
}

/// Frictionless fingers resist nothing but what comes along their normals: the quality is 0 however hard they press.
const ON_THE_FLOOR: &str = r#"<mujoco><default><geom condim="1"/></default><worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="palm" pos="0 0 .2"><joint type="slide" axis="0 0 1" stiffness="1000" damping="10"/><geom size=".01" mass=".1"/>
      <body pos="-.05 0 -.18"><joint name="a" type="slide" axis="1 0 0" damping="5"/><geom size=".01" mass=".05"/></body>
      <body pos=".05 0 -.18"><joint name="b" type="slide" axis="-1 0 0" damping="5"/><geom size=".01" mass=".05"/></body>
    </body>
    <body name="cube" pos="0 0 .02"><freejoint/><geom type="box" size=".02 .02 .02" mass=".05"/></body>
  </worldbody>
  <actuator><position name="a" joint="a" kp="50"/><position name="b" joint="b" kp="50"/></actuator></mujoco>"#;

#[test]
fn a_target_that_the_floor_carries_has_no_thresholds() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("floor.xml"), ON_THE_FLOOR).unwrap();
    let scenario = "name = \"floor\"\nmodel = \"floor.xml\"\n[[grasp]]\ntarget = \"cube\"\npalm = \"palm\"\n[timeline]\n\
        duration = 1.5\nmeasure_from = 0.5\n[[control]]\ntime = 0.3\nall = 0.03\n";
    std::fs::write(folder.path().join("floor.toml"), scenario).unwrap();
    let called = call_in(folder.path(), &["calibrate", "floor.toml", "--json"]);
    let json = called.json();
    assert!(json["tried"].as_array().unwrap().iter().any(|tried| tried["held"] == true), "{json}");
    assert!(json["latch_quality"].is_null() && json["release_quality"].is_null(), "{json}");
    assert!(called.stderr.contains("held with quality 0: something else carries it"), "{}", called.stderr);
}
