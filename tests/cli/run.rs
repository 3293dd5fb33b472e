//! `run`, `quality`, `bench` and `list` as scripts use them.

use crate::program::{Called, call_in, changed_claw, data};
use mujoco_grasp::mujoco::mujoco_version;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

fn keys(value: &Value) -> BTreeSet<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

const R: [&str; 15] = [
    "outcome",
    "latched_at_s",
    "released_at_s",
    "latched_share",
    "substructured_share",
    "changes",
    "peak_motion_m",
    "peak_rotation_rad",
    "final_offset_m",
    "max_penetration_m",
    "creep_m_per_s",
    "quality_at_latch_n",
    "normal_force_total_n",
    "slip_onset_s",
    "step_us_median",
];
const C: [&str; 6] = [
    "same_outcome",
    "vacuous",
    "position_rmse_m",
    "relative_error",
    "rotation_rmse_rad",
    "normal_force_relative_error",
];

fn run(folder: &Path, scenario: &str, options: &[&str]) -> Called {
    let called = call_in(folder, &[&["run", scenario, "--json"], options].concat());
    assert_eq!(called.status, 0, "{}", called.stderr);
    called
}

fn rows(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head = lines.next().unwrap().split(',').map(str::to_owned).collect();
    (head, lines.map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect())
}

#[test]
fn both_modes_of_every_push() {
    let folder = tempfile::tempdir().unwrap();
    // From another folder, with the default place of results.
    let json = run(folder.path(), &data("claw.toml"), &[]).json();
    assert_eq!(keys(&json), BTreeSet::from(["scenario", "engine", "nv", "timestep_s", "runs", "at_onset", "warnings"]));
    assert_eq!((&json["scenario"], &json["engine"]), (&"claw".into(), &mujoco_version().into()));
    assert_eq!((json["nv"].as_u64(), json["timestep_s"].as_f64()), (Some(27), Some(0.002)));
    let runs = json["runs"].as_array().unwrap();
    assert_eq!(runs.iter().map(|r| r["push"].as_str().unwrap()).collect::<Vec<_>>(), ["along", "down", "twist"]);
    for pair in runs {
        assert_eq!(keys(pair), BTreeSet::from(["push", "full", "grasp", "compare"]));
        let (full, grasp, compare) = (&pair["full"], &pair["grasp"], &pair["compare"]);
        let with_whole_steps = BTreeSet::from_iter(R.into_iter().chain(["whole_steps"]));
        assert_eq!((keys(full), keys(grasp)), (BTreeSet::from(R), with_whole_steps));
        assert!(grasp["whole_steps"]["refresh"].as_u64().unwrap() > 3, "{grasp}");
        assert_eq!(keys(compare), BTreeSet::from(C));
        for absent in ["latched_at_s", "released_at_s", "quality_at_latch_n", "latched_share", "substructured_share"] {
            assert!(full[absent].is_null(), "{absent}: full mode never latches");
        }
        assert!(grasp["latched_at_s"].as_f64().unwrap() > 2.0 && grasp["released_at_s"].is_null());
        assert_eq!((&compare["same_outcome"], &compare["vacuous"]), (&true.into(), &false.into()));
        assert_eq!(grasp["latched_share"], 1.0);
        let frozen = grasp["substructured_share"].as_f64().unwrap();
        assert!(frozen > 0.3 && frozen < 1.0, "{frozen}");
        assert_eq!(grasp["changes"], serde_json::json!([{ "time_s": grasp["latched_at_s"], "phase": 1 }]));
        assert_eq!(full["changes"], serde_json::json!([]));
        assert!(compare["relative_error"].as_f64().unwrap() < 0.05, "{compare}");
        assert!(compare["normal_force_relative_error"].as_f64().unwrap() < 0.02, "{compare}");
        for mode in ["full", "grasp"] {
            let name = format!("out/claw/{mode}-{}.csv", pair["push"].as_str().unwrap());
            let (head, rows) = rows(&folder.path().join(name));
            assert_eq!(head[..10], ["time_s", "px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz", "phase", "quality_n"]);
            assert!(head[10..].iter().all(|h| h.starts_with("normal_force_n:f")));
            assert_eq!((rows.len(), rows[0][0], rows[2500][0]), (2501, 0.0, 5.0));
            assert!(rows.iter().flatten().all(|v| v.is_finite()));
        }
    }
}

#[test]
fn both_modes_are_the_same_simulation_until_the_latch() {
    for scenario in ["claw4.toml", "claw_goals.toml"] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("o");
        let json = run(folder.path(), &data(scenario), &["--push", "along", "--out", out.to_str().unwrap()]).json();
        let latched = json["runs"][0]["grasp"]["latched_at_s"].as_f64().unwrap();
        let (full, grasp) = (rows(&out.join("full-along.csv")).1, rows(&out.join("grasp-along.csv")).1);
        let before = full.iter().take_while(|r| r[0] < latched).count();
        assert!(before > 1000);
        assert!(full[..before] == grasp[..before], "{scenario}");
        assert!(full.iter().all(|r| r[8] == 0.0));
        assert!(grasp.iter().all(|r| (r[8] >= 1.0) == (r[0] >= latched - 1e-9)));
        assert_eq!(json["runs"][0]["compare"]["same_outcome"], true);
    }
}

#[test]
fn one_mode_and_one_push() {
    let folder = tempfile::tempdir().unwrap();
    let json = run(folder.path(), &data("claw.toml"), &["--mode", "grasp", "--push", "down", "--out", "o"]).json();
    let runs = json["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 1);
    assert!(runs[0]["full"].is_null() && runs[0]["compare"].is_null());
    assert_eq!((&runs[0]["push"], &runs[0]["grasp"]["outcome"]), (&"down".into(), &"held".into()));
    let files: Vec<_> = std::fs::read_dir(folder.path().join("o")).unwrap().map(|f| f.unwrap().file_name()).collect();
    assert!(files.iter().any(|f| f == "grasp-down.csv") && !files.iter().any(|f| f == "full-down.csv"));
}

#[test]
fn a_push_that_is_too_strong_loses_the_target_in_both_modes() {
    let folder = tempfile::tempdir().unwrap();
    let json = run(folder.path(), &data("claw.toml"), &["--push", "along", "--scale-push", "4", "--out", "o"]).json();
    let pair = &json["runs"][0];
    assert_eq!((&pair["full"]["outcome"], &pair["grasp"]["outcome"]), (&"lost".into(), &"lost".into()));
    assert!(pair["grasp"]["released_at_s"].as_f64().unwrap() > 3.0);
    assert!(pair["full"]["creep_m_per_s"].is_null());
}

#[test]
fn pushes_scaled_to_their_onset_are_held_below_it_and_not_above() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = |share: &str| {
        let options = ["--push", "along", "--mode", "full", "--at-onset", share, "--out", "o"];
        run(folder.path(), &data("claw.toml"), &options).json()["runs"][0]["full"]["outcome"].clone()
    };
    assert_eq!(outcome("0.95"), "held");
    assert_ne!(outcome("1.05"), "held");
}

#[test]
fn the_onset_that_was_found_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--push", "along", "--mode", "full", "--at-onset", "0.5", "--no-pictures", "--out", "o"];
    let found = run(folder.path(), &data("claw.toml"), &options).json()["at_onset"].clone();
    assert_eq!((&found["share"], &found["pushes"][0]["push"]), (&0.5.into(), &"along".into()));
    assert_eq!(found["pushes"].as_array().unwrap().len(), 1);
    let factor = found["pushes"][0]["onset_factor"].as_f64().unwrap();
    // The scenario's push is 3 N along x, and is held.
    assert!(factor > 1.0);
    let force = found["pushes"][0]["force_n"][0].as_f64().unwrap();
    assert!((force - 0.5 * factor * 3.0).abs() < 1e-9, "{found}");
    let text = call_in(folder.path(), &[&["run", &data("claw.toml")], &options[..]].concat()).stdout;
    assert!(
        text.contains("smallest push that full mode does not hold") && text.contains(&format!("{factor:.4}")),
        "{text}"
    );
}

#[test]
fn a_comparison_in_which_nothing_was_latched_is_marked_as_saying_nothing() {
    let (folder, scenario) = changed_claw(&[], &[("palm = \"palm\"", "palm = \"palm\"\nlatch_quality = 100.0")]);
    let options = ["--push", "none", "--no-pictures"];
    let called = run(folder.path(), scenario.to_str().unwrap(), &options);
    let pair = &called.json()["runs"][0];
    assert_eq!((&pair["compare"]["vacuous"], &pair["compare"]["same_outcome"]), (&true.into(), &true.into()));
    assert_eq!((&pair["grasp"]["latched_share"], &pair["grasp"]["substructured_share"]), (&0.0.into(), &Value::Null));
    assert_eq!(called.json()["warnings"].as_array().unwrap().len(), 1);
    let text = call_in(folder.path(), &[&["run", scenario.to_str().unwrap()], &options[..]].concat()).stdout;
    assert!(text.contains("says nothing: grasp mode was latched for none"), "{text}");
}

#[test]
fn a_quality_that_only_the_pin_gave_is_not_reported_as_reached() {
    // The pin goes after the fingers have opened again.
    let open = "[[control]]\ntime = 1.9\nall = 0.0\n\n[[push]]\nname = \"along\"";
    let (folder, scenario) = changed_claw(&[], &[("[[push]]\nname = \"along\"", open)]);
    let called = run(folder.path(), scenario.to_str().unwrap(), &["--push", "none", "--no-pictures"]);
    assert!(called.stderr.contains("its quality reached 0.0000 N"), "{}", called.stderr);
}

#[test]
fn full_mode_that_creeps_without_noslip_is_named_with_the_option_that_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--push", "none", "--no-pictures", "--duration", "30", "--noslip", "0"];
    let text = call_in(folder.path(), &[&["run", "clutch"], &options[..]].concat()).stdout;
    assert!(text.contains("full mode runs without noslip iterations") && text.contains("--noslip 100"), "{text}");
    let text = call_in(folder.path(), &["run", &data("claw.toml"), "--push", "none", "--no-pictures"]).stdout;
    assert!(!text.contains("--noslip"), "the claw's full mode does not creep: {text}");
}

#[test]
fn a_hand_that_never_touches_is_a_result_with_a_warning() {
    let (folder, scenario) = changed_claw(&[], &[("set = {", "set = {} #")]);
    let called = run(folder.path(), scenario.to_str().unwrap(), &["--push", "none"]);
    let pair = &called.json()["runs"][0];
    assert_eq!((&pair["full"]["outcome"], &pair["grasp"]["outcome"]), (&"lost".into(), &"lost".into()));
    assert!(pair["grasp"]["latched_at_s"].is_null() && pair["grasp"]["quality_at_latch_n"].is_null());
    assert_eq!(pair["full"]["normal_force_total_n"], 0.0);
    assert!(pair["compare"]["normal_force_relative_error"].is_null());
    assert!(called.stderr.contains("never latched") && called.stderr.contains("no effector"), "{}", called.stderr);
}

#[test]
fn contacts_that_the_model_switches_off_are_named() {
    let options = r#"noslip_iterations="50"/>"#;
    let flag = r#"noslip_iterations="50"><flag contact="disable"/></option>"#;
    let (folder, scenario) = changed_claw(&[(options, flag)], &[]);
    let called = run(folder.path(), scenario.to_str().unwrap(), &["--push", "none", "--mode", "grasp"]);
    assert!(called.stderr.contains("never latched") && called.stderr.contains("flags"), "{}", called.stderr);
}

#[test]
fn text_for_people_goes_to_standard_output_and_names_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let called = call_in(folder.path(), &["run", &data("claw.toml"), "--push", "twist", "--mode", "grasp"]);
    assert_eq!(called.status, 0, "{}", called.stderr);
    assert!(called.stdout.contains("twist") && called.stdout.contains("out/claw"), "{}", called.stdout);
    assert_eq!(called.stderr, "", "no bar without a terminal");
}

#[test]
fn quality_of_a_firm_grasp() {
    let folder = tempfile::tempdir().unwrap();
    let called = call_in(folder.path(), &["quality", &data("claw.toml"), "--json"]);
    assert_eq!(called.status, 0, "{}", called.stderr);
    let json = called.json();
    let names = [
        "min_singular_value_n",
        "ferrari_canny_n",
        "hull_volume",
        "isotropy",
        "force_closure",
        "holds_own_weight",
        "contacts",
    ];
    assert_eq!(keys(&json), BTreeSet::from(names));
    assert_eq!(
        (&json["force_closure"], &json["holds_own_weight"], &json["contacts"]),
        (&true.into(), &true.into(), &5.into())
    );
    for positive in ["min_singular_value_n", "ferrari_canny_n", "hull_volume", "isotropy"] {
        assert!(json[positive].as_f64().unwrap() > 0.0, "{positive}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "quality writes nothing");
}

#[test]
fn quality_of_no_grasp_is_zero_with_a_warning() {
    let (folder, scenario) = changed_claw(&[], &[("set = {", "set = {} #")]);
    let called = call_in(folder.path(), &["quality", scenario.to_str().unwrap(), "--json"]);
    assert_eq!(called.status, 0, "{}", called.stderr);
    let json = called.json();
    assert_eq!((&json["min_singular_value_n"], &json["contacts"]), (&0.0.into(), &0.into()));
    assert_eq!((&json["force_closure"], &json["holds_own_weight"]), (&false.into(), &false.into()));
    assert!(called.stderr.contains("warning"), "{}", called.stderr);
}

#[test]
fn bench_times_all_variants() {
    let folder = tempfile::tempdir().unwrap();
    let called = call_in(folder.path(), &["bench", &data("claw_goals.toml"), "--json", "--steps", "500"]);
    assert_eq!(called.status, 0, "{}", called.stderr);
    let json = called.json();
    for name in ["scenario", "engine", "nv", "still", "pushed", "ik_us"] {
        assert!(json.get(name).is_some(), "{name}");
    }
    assert!(json["ik_us"].as_f64().unwrap() > 0.0);
    for phase in ["still", "pushed"] {
        let b = &json[phase];
        assert_eq!(b["steps"], 500);
        let time = |variant: &str, part: &str| b[variant][part].as_f64().unwrap();
        // MuJoCo 3 steps full with the model's islands, which leaves its contact part untold; on frozen geometry it is, too
        let staged = ["full", "full_noslip", "exact", "floor"].into_iter().filter(|v| *v == "exact" || !cfg!(mujoco3));
        for variant in staged {
            assert!(time(variant, "step_us") > time(variant, "contact_us"), "{phase} {variant}");
        }
        assert!(time("floor", "step_us") < time("full", "step_us"));
        assert_eq!((&b["grasp"]["unlatched_steps"], &b["exact"]["unlatched_steps"]), (&0.into(), &0.into()));
        assert!(b["grasp"]["substructured_steps"].as_u64().unwrap() > 150, "{b}");
        assert_eq!(b["exact"]["substructured_steps"], 0);
        assert!(b["grasp"]["contact_us"].is_null());
        assert!(b["ratio"]["contact"].is_null() && b["ratio"]["contact_noslip"].is_null());
        let close = |ratio: &str, value: f64| assert!((b["ratio"][ratio].as_f64().unwrap() - value).abs() < 1e-9);
        if cfg!(mujoco3) {
            for variant in ["full", "full_noslip", "floor"] {
                assert!(b[variant]["contact_us"].is_null(), "{phase} {variant}");
            }
        } else {
            assert!(time("floor", "contact_us") < 0.5 * time("full", "contact_us"), "{b}");
        }
        close("step", time("full", "step_us") / time("grasp", "step_us"));
        close("step_noslip", time("full_noslip", "step_us") / time("grasp", "step_us"));
        close("step_over_floor", time("grasp", "step_us") / time("floor", "step_us"));
        let cheapest = time("full", "step_us").min(time("full_default", "step_us"));
        close("step_default", cheapest / time("grasp", "step_us"));
        let mean = |variant: &str| time(variant, "step_mean_us");
        close("mean_default", mean("full").min(mean("full_default")) / mean("grasp"));
        close("mean_noslip", mean("full_noslip") / mean("grasp"));
        for variant in ["full", "full_noslip", "full_default", "grasp", "exact", "floor"] {
            let added = time(variant, "step_us") - time("floor", "step_us");
            assert!((time(variant, "added_us") - added).abs() < 1e-9, "{phase} {variant}");
        }
        // on frozen geometry a step may cost less than the floor's, which computes every step whole
        if time("grasp", "added_us") > 0.0 {
            close("added", time("full", "added_us") / time("grasp", "added_us"));
        } else {
            assert!(b["ratio"]["added"].is_null() && b["ratio"]["added_noslip"].is_null(), "{b}");
        }
        for variant in ["full", "full_noslip"] {
            let solver = b[variant]["solver"].as_str().unwrap();
            let known = ["newton", "cg", "pgs", "the model's own"];
            assert!(known.iter().any(|s| solver.starts_with(s)), "{solver}");
        }
    }
}

/// A scene that includes a file of a subfolder, with a mesh of another, all by relative names.
#[test]
fn a_relative_scenario_path_finds_the_model_its_includes_and_its_meshes() {
    let root = tempfile::tempdir().unwrap();
    let at = |path: &str| root.path().join(path);
    for folder in ["robot/parts", "robot/meshes", "scenarios/deep"] {
        std::fs::create_dir_all(at(folder)).unwrap();
    }
    std::fs::copy(data("claw.xml"), at("robot/claw.xml")).unwrap();
    let scene = "<mujoco><compiler meshdir=\"meshes\"/><include file=\"claw.xml\"/><include file=\"parts/wedge.xml\"/></mujoco>";
    std::fs::write(at("robot/scene.xml"), scene).unwrap();
    let wedge = "<mujoco><asset><mesh name=\"wedge\" file=\"wedge.stl\"/></asset>\
                 <worldbody><geom type=\"mesh\" mesh=\"wedge\" pos=\"0 3 0\"/></worldbody></mujoco>";
    std::fs::write(at("robot/parts/wedge.xml"), wedge).unwrap();
    std::fs::write(at("robot/meshes/wedge.stl"), tetrahedron()).unwrap();
    let toml = std::fs::read_to_string(data("claw.toml")).unwrap();
    std::fs::write(at("robot/claw.toml"), toml.replace("claw.xml", "scene.xml")).unwrap();
    std::fs::write(at("scenarios/claw.toml"), toml.replace("claw.xml", "../robot/scene.xml")).unwrap();
    for (working_in, scenario) in [
        ("robot", "claw.toml"),
        ("robot", "./claw.toml"),
        (".", "robot/claw.toml"),
        ("robot/parts", "../claw.toml"),
        ("scenarios/deep", "../claw.toml"),
        ("scenarios/deep", "../../robot/parts/../claw.toml"),
    ] {
        // Both ways of loading: as it is, and with a weld beside it.
        for limits in ["cones", "box"] {
            let options = ["--limits", limits, "--push", "none", "--mode", "grasp", "--no-pictures", "--out", "o"];
            let json = run(&at(working_in), scenario, &options).json();
            assert_eq!(json["runs"][0]["grasp"]["outcome"], "held", "{scenario} in {working_in}, {limits}");
        }
    }
}

/// Binary STL.
fn tetrahedron() -> Vec<u8> {
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut stl = vec![0; 80];
    stl.extend(4_u32.to_le_bytes());
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        stl.extend(
            [0.0_f32, 0.0, 1.0].into_iter().chain(face.into_iter().flat_map(|i| corners[i])).flat_map(f32::to_le_bytes),
        );
        stl.extend([0, 0]);
    }
    stl
}

#[test]
fn a_target_that_starts_inside_the_hand_is_warned_of_once() {
    // The ball, put into the fingers.
    let (folder, scenario) = changed_claw(&[("0 0 0.3 1 0 0 0", "0 0 0.36 1 0 0 0")], &[]);
    let called = run(folder.path(), scenario.to_str().unwrap(), &["--push", "none", "--no-pictures"]);
    assert_eq!(called.stderr.matches("inside the hand").count(), 1, "{}", called.stderr);
    assert!(called.stderr.contains("full-none, grasp-none: "), "{}", called.stderr);
    let warnings = called.json()["warnings"].clone();
    assert!(warnings[0].as_str().unwrap().contains("inside the hand"), "{warnings}");
}

#[test]
fn a_target_that_leaves_when_the_pin_goes_is_warned_of_with_the_cause() {
    // One finger alone presses on the pinned ball.
    let one = ("set = {", "set = { f0_mcp = 0.6, f0_pip = 1.0 } #");
    let (folder, scenario) = changed_claw(&[], &[one]);
    let called = run(folder.path(), scenario.to_str().unwrap(), &["--push", "none", "--no-pictures"]);
    assert!(called.stderr.contains("within 0.1 s of pin_until = 2 s the target moved"), "{}", called.stderr);
    let claw = run(folder.path(), &data("claw.toml"), &["--push", "none", "--no-pictures"]);
    assert_eq!((claw.stderr.as_str(), &claw.json()["warnings"]), ("", &serde_json::json!([])));
}
