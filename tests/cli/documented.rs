//! `docs/reference.md` names all that scripts can meet: options, scenario keys, JSON keys (those of `agree`, and its columns, in `agree`). `docs/wrapping.md` shows the
//! files of its example as they are, and they do what it says.

use crate::page::{collect, named, page, section};
use crate::program::{call_in, data};
use mujoco_grasp::scenario::file::ScenarioFile;
use std::collections::BTreeSet;
use std::path::Path;

/// Every key of the object that a call prints is in its section (or in that of `run`, whose R and C others share).
#[track_caller]
fn keys_are_named(command: &str, calls: &[&[&str]]) {
    let folder = tempfile::tempdir().unwrap();
    let mut keys = BTreeSet::new();
    for args in calls {
        let called = call_in(folder.path(), &[&[command, "--json"], *args].concat());
        assert_eq!(called.status, 0, "{}", called.stderr);
        collect(&called.json(), &mut keys);
    }
    assert!(!keys.is_empty());
    named(&section(&format!("### {command}")), keys);
}

#[test]
fn every_key_of_list_quality_and_calibrate_is_on_the_page() {
    keys_are_named("list", &[&[]]);
    keys_are_named("quality", &[&[&data("claw.toml")]]);
    keys_are_named("calibrate", &[&[&data("claw.toml")]]);
}

#[test]
fn every_key_of_run_is_on_the_page() {
    let claw = data("claw.toml");
    let two = ["two-hands", "--push", "side", "--no-pictures"];
    keys_are_named("run", &[&[&claw, "--at-onset", "0.5", "--push", "along", "--no-pictures"], &two]);
}

#[test]
fn every_key_of_bench_is_on_the_page() {
    keys_are_named("bench", &[&[&data("claw.toml"), "--steps", "100"]]);
}

#[test]
fn every_option_is_on_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let help = call_in(folder.path(), &["--help"]).stdout;
    let section = section("## Command line");
    let commands = ["list", "run", "report", "view", "bench", "agree", "quality", "calibrate", "sweep"];
    for line in help.split("Commands:").nth(1).unwrap().lines().skip(1).take_while(|l| !l.is_empty()) {
        let command = line.split_whitespace().next().unwrap();
        assert!(commands.contains(&command) || command == "help", "{command} has no test here");
    }
    for command in commands {
        assert!(section.contains(&format!("| `{command}")), "{command}");
        let help = call_in(folder.path(), &[command, "--help"]).stdout;
        let options =
            help.lines().filter_map(|l| l.trim_start().split("--").nth(1).filter(|_| l.trim_start().starts_with('-')));
        for option in options.map(|o| o.split([' ', '=']).next().unwrap()) {
            assert!(section.contains(&format!("`--{option}")), "--{option} of {command}");
        }
    }
}

/// A key that no table has is refused with all that it could be.
#[test]
fn every_scenario_key_is_on_the_page() {
    let goals = std::fs::read_to_string(data("claw_goals.toml")).unwrap();
    let text = format!("{goals}\n[[control]]\ntime = 0.1\nall = 0.0\n");
    let section = section("## Scenario file");
    let mut tables = 0;
    for table in ["", "[[grasp]]", "[timeline]", "[[control]]", "[[goal]]", "[[push]]"] {
        let wrong = match table {
            "" => format!("not_a_key = 1\n{text}"),
            table => {
                assert!(text.contains(table), "{table}");
                text.replacen(table, &format!("{table}\nnot_a_key = 1"), 1)
            }
        };
        let error = ScenarioFile::parse(&wrong, Path::new("a.toml")).unwrap_err().to_string();
        let expected = error.split("expected one of ").nth(1).unwrap_or_else(|| panic!("{error}"));
        let keys: Vec<String> = expected.split('`').skip(1).step_by(2).map(str::to_owned).collect();
        assert!(keys.len() >= 3, "{error}");
        named(&section, keys);
        tables += 1;
    }
    assert_eq!(tables, 6);
}

#[test]
fn the_wrapped_arm_picks_its_can_as_the_page_says() {
    let folder = tempfile::tempdir().unwrap();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/wrapping");
    let page = page("wrapping.md");
    for file in ["pick.xml", "pick.toml"] {
        let text = std::fs::read_to_string(example.join(file)).unwrap();
        let shown = text.split_once("-->\n<mujoco").map_or(text.clone(), |(_, rest)| format!("<mujoco{rest}"));
        assert!(page.contains(shown.trim()), "{file} is another on the page");
    }
    let scenario = example.join("pick.toml");
    let called = call_in(folder.path(), &["run", scenario.to_str().unwrap(), "--json", "--no-pictures"]);
    assert_eq!((called.status, called.stderr.as_str()), (0, ""));
    let pair = &called.json()["runs"][0];
    assert_eq!((&pair["full"]["outcome"], &pair["grasp"]["outcome"]), (&"held".into(), &"held".into()));
    assert_eq!((&pair["grasp"]["latched_share"], &pair["compare"]["vacuous"]), (&1.0.into(), &false.into()));
    assert!(pair["compare"]["relative_error"].as_f64().unwrap() < 0.05, "{}", pair["compare"]);
}
