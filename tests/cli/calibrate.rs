//! `calibrate` as scripts use it, checked with `run`.

use crate::program::{call_in, changed_claw, data};
use serde_json::Value;
use std::path::Path;

#[track_caller]
fn calibrate(folder: &Path, scenario: &str) -> Value {
    let called = call_in(folder, &["calibrate", scenario, "--json"]);
    assert_eq!(called.status, 0, "{}", called.stderr);
    let json = called.json();
    let tried = json["tried"].as_array().unwrap();
    assert!(!tried.is_empty());
    for t in tried {
        assert!(t["quality"].as_f64().unwrap() >= 0.0 && t["held"].is_boolean());
        assert!(t["held"] == false || t["slip_m"].as_f64().unwrap() < 1e-3);
    }
    json
}

/// The least quality that holds is one that was tried, and what presses a little less does not hold.
#[track_caller]
fn thresholds(json: &Value) -> (f64, f64) {
    let (latch, release) = (json["latch_quality"].as_f64().unwrap(), json["release_quality"].as_f64().unwrap());
    assert!(0.0 < release && release < 0.5 * latch, "{latch} {release}");
    let tried = json["tried"].as_array().unwrap();
    let at = tried.iter().position(|t| t["held"] == true && t["quality"] == json["latch_quality"]).unwrap();
    assert_eq!(tried[at - 1]["held"], false);
    let below = tried[at - 1]["quality"].as_f64().unwrap();
    assert!((below - latch).abs() < 0.1 * latch, "{below} {latch}");
    (latch, release)
}

#[test]
fn a_hand_that_closes_by_its_controls() {
    let folder = tempfile::tempdir().unwrap();
    let json = calibrate(folder.path(), &data("claw.toml"));
    let (latch, release) = thresholds(&json);
    let slip = json["slip_quality"].as_f64().expect("an opening hand drops the ball");
    assert!(release < slip && slip < 2.0 * latch, "{release} {slip} {latch}");
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "calibrate writes no files");

    // Half the weight takes less quality.
    let (light, scenario) = changed_claw(&[("mass=\"0.2\"", "mass=\"0.1\"")], &[]);
    let (lighter, _) = thresholds(&calibrate(light.path(), scenario.to_str().unwrap()));
    assert!(lighter < 0.8 * latch, "{lighter} {latch}");
}

#[test]
fn fingertips_that_press_for_a_quality() {
    let folder = tempfile::tempdir().unwrap();
    let (latch, _) = thresholds(&calibrate(folder.path(), &data("claw_goals.toml")));
    // `run` with fingers that press for a little more, and for a little less; watched from where the pin goes.
    let text = std::fs::read_to_string(data("claw_goals.toml")).unwrap();
    std::fs::copy(data("claw.xml"), folder.path().join("claw.xml")).unwrap();
    let slips = |quality: f64| {
        let changed = text
            .replace("latch_quality = 0.8", &format!("latch_quality = {quality}"))
            .replace("measure_from = 4.0", "measure_from = 3.0");
        assert_ne!(text, changed);
        let path = folder.path().join("pressed.toml");
        std::fs::write(&path, changed).unwrap();
        let options = ["--mode", "full", "--push", "none", "--no-pictures", "--json"];
        let called = call_in(folder.path(), &[&["run", path.to_str().unwrap()], &options[..]].concat());
        let json = called.json();
        let full = &json["runs"][0]["full"];
        !full["slip_onset_s"].is_null() || full["outcome"] == "lost"
    };
    assert!(!slips(1.05 * latch));
    assert!(slips(0.93 * latch));
}

#[test]
fn a_target_that_nothing_holds_has_no_thresholds() {
    let (folder, scenario) = changed_claw(&[("mass=\"0.2\"", "mass=\"20\"")], &[]);
    let called = call_in(folder.path(), &["calibrate", scenario.to_str().unwrap(), "--json"]);
    assert_eq!(called.status, 0, "{}", called.stderr);
    let json = called.json();
    assert!(json["latch_quality"].is_null() && json["release_quality"].is_null(), "{json}");
    assert!(json["tried"].as_array().unwrap().iter().all(|t| t["held"] == false));
    assert!(called.stderr.contains("warning") && called.stderr.contains("no threshold"), "{}", called.stderr);
}

#[test]
fn nothing_to_press_with_is_bad_input() {
    let text = std::fs::read_to_string(data("claw.toml")).unwrap();
    let (before, after) = (text.find("[[control]]").unwrap(), text.find("[[push]]").unwrap());
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(data("claw.xml"), folder.path().join("claw.xml")).unwrap();
    let path = folder.path().join("still.toml");
    std::fs::write(&path, format!("{}{}", &text[..before], &text[after..])).unwrap();
    let called = call_in(folder.path(), &["calibrate", path.to_str().unwrap(), "--json"]);
    assert_eq!(called.status, 2, "{}", called.stdout);
    for part in ["still.toml", "control", "[[goal]]"] {
        assert!(called.json()["error"].as_str().unwrap().contains(part), "{}", called.stdout);
    }
    let called = call_in(folder.path(), &["calibrate"]);
    assert_eq!(called.status, 2);
}
