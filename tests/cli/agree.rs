//! `agree` as scripts use it, and what it rests on: a push from a saved state is the push of a whole run, and an onset is
//! where holding ends.

use crate::page::{collect, named, section};
use crate::program::{Called, call_in, data};
use mujoco_grasp::scenario::agree::{Ground, Onset, Trial};
use mujoco_grasp::scenario::checkpoint::Checkpoint;
use mujoco_grasp::scenario::compare::compare;
use mujoco_grasp::scenario::draw::directions;
use mujoco_grasp::scenario::outcome::Outcome;
use mujoco_grasp::scenario::plan::{Plan, Push};
use mujoco_grasp::scenario::run::{Observer, Options, run};
use mujoco_grasp::scenario::runner::Mode;
use mujoco_grasp::scenario::tally::{Tally, write_trials};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

const TRIALS: &str = "8";

fn keys(value: &Value) -> BTreeSet<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[track_caller]
fn agree(folder: &Path, options: &[&str]) -> Called {
    let called = call_in(folder, &[&["agree", &data("claw.toml"), "--trials", TRIALS], options].concat());
    assert_eq!(called.status, 0, "{}", called.stderr);
    called
}

fn vector(value: &Value) -> Vector3<f64> {
    let v: Vec<f64> = value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    Vector3::new(v[0], v[1], v[2])
}

/// One call, looked at from all sides: finding 104 onsets takes its time.
#[test]
fn random_pushes_on_the_claw() {
    let folder = tempfile::tempdir().unwrap();
    let json = agree(folder.path(), &["--seed", "3", "--json"]).json();
    the_fields_of_the_reference(&json);
    all_is_on_the_reference_page(&json, &folder.path().join("out/claw"));
    tables_and_pictures(&folder.path().join("out/claw"), &json);
    an_onset_is_where_holding_ends(&json);

    on_one_thread_and_fewer(&folder.path().join("out/claw/agree-trials.csv"), &json);
}

fn all_is_on_the_reference_page(json: &Value, out: &Path) {
    let mut names = BTreeSet::new();
    collect(json, &mut names);
    named(&section("### agree"), names);
    for file in ["agree-onsets.csv", "agree-trials.csv"] {
        let text = std::fs::read_to_string(out.join(file)).unwrap();
        named(&section("## Files"), text.lines().next().unwrap().split(',').map(str::to_owned));
    }
}

/// Trials are the same on one thread, and fewer are the first of more.
fn on_one_thread_and_fewer(all: &Path, json: &Value) {
    let plan = Plan::load(&data("claw.toml")).unwrap();
    let onsets: Vec<Onset> = directions()
        .into_iter()
        .zip(json["onsets"].as_array().unwrap())
        .map(|(direction, o)| Onset { direction, full: o["full"].as_f64(), grasp: o["grasp"].as_f64() })
        .collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let trials = pool.install(|| Ground::new(&plan, Options::default()).unwrap().trials(&onsets, 3, 3, &|| ()));
    let one = all.with_file_name("one.csv");
    write_trials(&onsets, &trials, &one).unwrap();
    let (all, one) = (std::fs::read_to_string(all).unwrap(), std::fs::read_to_string(one).unwrap());
    assert_eq!(one.lines().count(), 4);
    assert!(all.starts_with(&one), "{one}\n{all}");
}

fn the_fields_of_the_reference(json: &Value) {
    for key in ["trials", "same_outcome", "agreement", "held", "slid", "lost", "onset_relative_error_median"] {
        assert!(keys(json).contains(key), "{key}");
    }
    for (group, fields) in [
        ("held", &["count", "median_relative_error", "p90_relative_error"][..]),
        ("slid", &["count", "median_final_offset_relative_error"]),
        ("lost", &["count"]),
    ] {
        assert!(fields.iter().all(|f| keys(&json[group]).contains(f)), "{group}");
    }
    let number = |v: &Value| v.as_f64().unwrap();
    assert_eq!(json["trials"], 8);
    let counted: f64 = ["held", "slid", "lost"].iter().map(|g| number(&json[g]["count"])).sum();
    assert_eq!(counted + number(&json["failed"]), 8.0);
    assert_eq!(number(&json["agreement"]), number(&json["same_outcome"]) / 8.0);
    let disagreements = json["disagreements"].as_array().unwrap();
    assert_eq!(disagreements.len() as f64, 8.0 - number(&json["same_outcome"]));
    for d in disagreements {
        for key in ["trial", "force_n", "torque_nm", "duration_s", "full", "grasp"] {
            assert!(keys(d).contains(key), "{key}");
        }
        assert!(d["full"] != d["grasp"] || !d["error"].is_null());
    }
    assert!(number(&json["agreement"]) >= 0.75, "{json}");
    // The claw is latched before the push, and stays so in most trials.
    assert_eq!(json["vacuous_trials"], 0);
    assert!(number(&json["latched_share"]["median"]) > 0.9 && number(&json["latched_share"]["p10"]) > 0.0, "{json}");
    let frozen = number(&json["substructured_share"]["median"]);
    assert!(frozen > 0.3 && frozen < 1.0, "{frozen}");
    assert_eq!(json["noslip_iterations"], 50);
    let chaotic = disagreements.iter().filter(|d| d["chaotic"] == true).count();
    assert_eq!(json["chaotic_trials"], chaotic);
    let held = &json["held"];
    assert!(number(&held["worst_relative_error"]) >= number(&held["median_relative_error"]));
    for error in ["rotation_relative_error", "normal_force_relative_error"] {
        assert!((0.0..0.1).contains(&number(&held[error])), "{error}: {held}");
    }
    assert!(number(&json["onset_relative_error_median"]) < 0.05);
    assert!(number(&json["held"]["median_relative_error"]) < 0.05);
    // The scenario's first push starts at 3 s; the scenario ends at 5 s.
    assert_eq!((number(&json["push_start_s"]), number(&json["end_s"])), (3.0, 5.0));
    let onsets = json["onsets"].as_array().unwrap();
    assert_eq!(onsets.len(), 52);
    assert_eq!(onsets.iter().filter(|o| o["kind"] == "force").count(), 26);
}

fn tables_and_pictures(out: &Path, json: &Value) {
    let mut onsets = csv::Reader::from_path(out.join("agree-onsets.csv")).unwrap();
    assert_eq!(onsets.records().count(), 52);
    let mut trials = csv::Reader::from_path(out.join("agree-trials.csv")).unwrap();
    let head = trials.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = trials.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 8);
    let cell = |row: &csv::StringRecord, name: &str| row[head.iter().position(|h| h == name).unwrap()].to_owned();
    for row in &rows {
        let number = |name: &str| cell(row, name).parse::<f64>().unwrap();
        let share = number("size_over_onset");
        assert!((0.3..0.9).contains(&share) || (1.1..1.6).contains(&share));
        assert!((0.2..1.0).contains(&number("duration_s")));
        let force = Vector3::new(number("force_x_n"), number("force_y_n"), number("force_z_n"));
        let torque = Vector3::new(number("torque_x_nm"), number("torque_y_nm"), number("torque_z_nm"));
        let onset = &json["onsets"][number("direction") as usize];
        let (pushed, other) = if onset["kind"] == "force" { (force, torque) } else { (torque, force) };
        assert!((pushed - vector(&onset["direction"]) * share * onset["full"].as_f64().unwrap()).norm() < 1e-9);
        assert_eq!(other.norm(), 0.0);
        assert_eq!(cell(row, "same_outcome") == "true", cell(row, "full") == cell(row, "grasp"));
    }
    for picture in ["agree-peak.svg", "agree-final.svg"] {
        let svg = std::fs::read_to_string(out.join(picture)).unwrap();
        assert!(svg.contains("<circle") && svg.contains("grasp: "), "{picture}");
    }
}

/// Whole runs with sizes close together, from far below the onset to far above, in a direction of force and one of torque.
fn an_onset_is_where_holding_ends(json: &Value) {
    let plan = Plan::load(&data("claw.toml")).unwrap();
    for index in [17, 40] {
        let entry = &json["onsets"][index];
        let unit = vector(&entry["direction"]);
        for (mode, found) in [(Mode::Full, &entry["full"]), (Mode::Grasp, &entry["grasp"])] {
            let found = found.as_f64().unwrap();
            let shares: Vec<f64> = (0..10).map(|k| 0.91 + 0.02 * k as f64).collect();
            let held: Vec<bool> = shares
                .par_iter()
                .map(|share| {
                    let mut push = Push { end: 3.6, ..plan.pushes[0].scaled(0.0) };
                    let size = unit * found * *share;
                    if index < 26 {
                        push.force = size
                    } else {
                        push.torque = size
                    }
                    let run = run(&plan, mode, Some(&push), Options::default(), &Observer::NOBODY).unwrap();
                    run.summary.outcome == Some(Outcome::Held)
                })
                .collect();
            // The largest sizes below 97 % hold, the smallest above 100 % does not.
            assert!(held[..3].iter().all(|h| *h), "{mode:?} {index}: {held:?}");
            assert!(!held[5], "{mode:?} {index}: {held:?}");
        }
    }
}

#[test]
fn a_push_from_a_saved_state_is_that_of_a_whole_run() {
    for scenario in ["claw.toml", "claw_goals.toml"] {
        // what geometry is frozen is no part of a saved state
        let plan = Plan::load(&data(scenario)).unwrap().with_frozen_tolerance(Some(0.0)).unwrap();
        let push = &plan.pushes[0];
        for mode in [Mode::Full, Mode::Grasp] {
            let saved = Checkpoint::new(&plan, mode, push, Options::default()).unwrap();
            assert_eq!(saved.is_latched(), mode == Mode::Grasp);
            let whole = run(&plan, mode, Some(push), Options::default(), &Observer::NOBODY).unwrap();
            let from = whole.trajectory.index_at(plan.timeline.measure_from()).unwrap();
            // Also after another push has been made from the same state.
            saved.push(&push.scaled(-2.0));
            let pushed = saved.push(push);
            assert_eq!(pushed.summary.outcome, whole.summary.outcome);
            assert_eq!(pushed.summary.final_offset_m, whole.summary.final_offset_m);
            let (a, b) = (pushed.trajectory.samples(), &whole.trajectory.samples()[from..]);
            assert_eq!(a.len(), b.len());
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                assert_eq!((a.time, a.position, a.rotation), (b.time, b.position, b.rotation), "{mode:?}");
                assert_eq!((a.grasped, a.quality, a.slip), (b.grasped, b.quality, b.slip), "{mode:?} at {}", a.time);
                assert_eq!(pushed.trajectory.normal_forces(i), whole.trajectory.normal_forces(from + i));
            }
        }
    }
}

#[test]
fn a_simulation_that_fails_counts_with_its_cause_and_harms_no_other() {
    let plan = Plan::load(&data("claw.toml")).unwrap();
    let push = Push { force: Vector3::new(1e12, 0.0, 0.0), ..plan.pushes[0].clone() };
    let small = push.scaled(1e-13);
    let start = [Mode::Full, Mode::Grasp].map(|m| Checkpoint::new(&plan, m, &push, Options::default()).unwrap());
    let trial = |number: u64, push: &Push| {
        let [full, grasp] = [start[0].push(push), start[1].push(push)];
        let compare = compare((&full.trajectory, &full.summary), (&grasp.trajectory, &grasp.summary), 2.5);
        let (full, grasp, push) = (full.ending(), grasp.ending(), push.clone());
        Trial { trial: number, direction: 0, share: 1.0, push, full, grasp, compare, chaotic: None }
    };
    let trials = [trial(0, &push), trial(1, &small)];
    for (mode, ending) in [("full", &trials[0].full), ("grasp", &trials[0].grasp)] {
        let error = ending.error.as_ref().expect("1e12 N cannot be simulated");
        assert!(error.contains(mode) && error.contains("diverged"), "{error}");
        assert!(ending.outcome.is_none());
    }
    assert!(!start[0].holds(&push) && start[0].holds(&small), "the saved state has not suffered");
    let tally = serde_json::to_value(Tally::new(&[], &trials, 50)).unwrap();
    assert_eq!((&tally["trials"], &tally["same_outcome"], &tally["failed"]), (&2.into(), &1.into(), &1.into()));
    assert_eq!(tally["held"]["count"], 1);
    let d = &tally["disagreements"][0];
    named(&section("### agree"), d.as_object().unwrap().keys().cloned());
    assert!(d["full"].is_null() && d["grasp"].is_null() && d["error"].as_str().unwrap().contains("diverged"), "{d}");
}

/// A grasp that is not latched when the push starts is the same simulation in both modes.
#[test]
fn trials_without_a_latched_step_say_nothing() {
    let plan = Plan::load(&data("claw.toml")).unwrap();
    let mut never = plan.clone();
    never.grasps[0].latch_quality = Some(1e3);
    let push = plan.pushes[0].clone();
    let trial = |plan: &Plan, number| {
        let [full, grasp] = [Mode::Full, Mode::Grasp]
            .map(|mode| Checkpoint::new(plan, mode, &push, Options::default()).unwrap().push(&push));
        let compare = compare((&full.trajectory, &full.summary), (&grasp.trajectory, &grasp.summary), 2.5);
        let (full, grasp, push) = (full.ending(), grasp.ending(), push.clone());
        Trial { trial: number, direction: 0, share: 1.0, push, full, grasp, compare, chaotic: None }
    };
    let trials = [trial(&plan, 0), trial(&never, 1), trial(&never, 2)];
    let tally = serde_json::to_value(Tally::new(&[], &trials, 0)).unwrap();
    assert_eq!((&tally["trials"], &tally["vacuous_trials"], &tally["same_outcome"]), (&3.into(), &2.into(), &1.into()));
    assert_eq!((&tally["agreement"], &tally["held"]["count"]), (&1.0.into(), &3.into()));
    // What the empty ones would halve.
    assert_eq!(tally["held"]["worst_relative_error"].as_f64(), trials[0].compare.relative_error);
    // Of three held trials one was latched: half of them are at 0.
    assert_eq!(tally["latched_share"], serde_json::json!({ "median": 0.0, "p10": 0.0 }));
    assert!(tally["chaotic_trials"].is_null(), "no noslip iterations to take ten times");
    let none = serde_json::to_value(Tally::new(&[], &trials[1..], 50)).unwrap();
    assert!(none["agreement"].is_null() && none["held"]["worst_relative_error"].is_null(), "{none}");
    assert_eq!(none["substructured_share"], serde_json::json!({ "median": null, "p10": null }));
}

#[test]
fn bad_usage_ends_with_status_2_and_leaves_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let claw = data("claw.toml");
    for (options, part) in [
        (&["--trials", "0"][..], "--trials"),
        (&["--trials", "many"], "--trials"),
        (&["--trials", "-3"], "--trials"),
        (&["--seed", "1.5"], "--seed"),
        (&["--noslip", "5000"], "--noslip"),
        (&["--limits", "none"], "--limits"),
        (&["--frob"], "--frob"),
    ] {
        let called = call_in(folder.path(), &[&["agree", &claw, "--json"], options].concat());
        assert_eq!(called.status, 2, "{options:?}");
        assert!(called.json()["error"].as_str().unwrap().contains(part), "{}", called.stdout);
        assert!(called.stderr.contains(part));
    }
    let called = call_in(folder.path(), &["agree", "missing.toml"]);
    assert_eq!((called.status, called.stdout.as_str()), (2, ""));
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "nothing is left behind");
}
