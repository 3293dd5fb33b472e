//! Scenario files: what is accepted, and that each thing that is wrong is named with what would be right.

use std::path::Path;

use mujoco_grasp::grasp::Limits;
use mujoco_grasp::mujoco::{BodyId, Model};
use mujoco_grasp::scenario::Error;
use mujoco_grasp::scenario::file::ScenarioFile;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};

const FULL: &str = r#"
name = "claw"
about = "everything at once"
model = "claw.xml"
keyframe = "open"

[[grasp]]
target = "object"
effectors = ["f0_3", "f1_3"]
palm = "palm"
latch_quality = 0.2
release_quality = 0.05
latch_time = 0.1
limits = "box"
relaxed = ["x", "rz"]
axes = [2.0, 0.0, 0.0, 0.0]
solref = [0.01, 0.9]
relaxed_solimp = [0.8, 0.95, 0.002, 0.4, 3.0]

[timeline]
duration = 6.0
pin_until = 3.0
measure_from = 4.0

[[control]]
time = 1.6
all = 0.0
set = { f0_mcp = 0.45, f0_pip = 0.75 }

[[goal]]
effector_site = "f0_tip"
target_site = "goal0"

[[push]]
name = "fp1"
target = "object"
start = 4.5
duration = 1.0
force = [0.0, -9.5, 0]
torque = [0.0, 0.0, 0.0]
"#;

const SHORT: &str = r#"
name = "short"
model = "claw.xml"
[[grasp]]
target = "object"
palm = "palm"
[timeline]
duration = 1
"#;

fn parse(text: &str) -> Result<ScenarioFile, Error> {
    ScenarioFile::parse(text, Path::new("dir/test.toml"))
}

fn plan(text: &str) -> Result<Plan, Error> {
    let file = parse(text)?;
    let model = Model::from_xml_file("tests/data/claw.xml")?;
    Plan::new(&file, Path::new("dir/test.toml"), model)
}

/// `from` becomes `to` in the full file: the message must name the file and hold each of `parts`.
#[track_caller]
fn refused(from: &str, to: &str, parts: &[&str]) {
    assert!(FULL.contains(from), "the test replaces nothing: {from}");
    let error = plan(&FULL.replacen(from, to, 1)).expect_err("must be refused");
    assert!(error.is_bad_input(), "{error}");
    let message = error.to_string();
    for part in [&["dir/test.toml"], parts].concat() {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

#[test]
fn every_field_is_read() {
    let plan = plan(FULL).unwrap();
    let model = &plan.model;
    assert_eq!(plan.name, "claw");
    assert_eq!(plan.keyframe, Some(model.keyframe("open").unwrap()));
    let grasp = &plan.grasps[0];
    assert_eq!(grasp.target, model.body("object").unwrap());
    assert_eq!(grasp.effectors, [model.body("f0_3").unwrap(), model.body("f1_3").unwrap()]);
    assert_eq!(grasp.palm, Some(model.body("palm").unwrap()));
    assert_eq!((grasp.latch_quality, grasp.release_quality), (Some(0.2), Some(0.05)));
    assert_eq!((grasp.latch_time, grasp.limits), (0.1, Limits::Box));
    assert_eq!(grasp.relaxed, [true, false, false, false, false, true]);
    assert!(grasp.axes.angle() < 1e-15);
    assert_eq!((grasp.solref, grasp.solimp, grasp.relaxed_solref), (Some([0.01, 0.9]), None, None));
    assert_eq!(grasp.relaxed_solimp, Some([0.8, 0.95, 0.002, 0.4, 3.0]));
    assert_eq!((plan.timeline.duration, plan.timeline.pin_until, plan.timeline.measure_from()), (6.0, 3.0, 4.0));
    let index = |name: &str| model.actuator(name).unwrap().index();
    assert_eq!(plan.controls[0].all, Some(0.0));
    assert_eq!(plan.controls[0].set, [(index("f0_mcp"), 0.45), (index("f0_pip"), 0.75)]);
    assert_eq!(plan.goals[0].tip, model.site("f0_tip").unwrap());
    assert_eq!(plan.goals[0].goal, model.site("goal0").unwrap());
    // Tracking starts with the last control entry before the pin goes.
    assert_eq!(plan.goals[0].start, 1.6);
    let push = &plan.pushes[0];
    assert_eq!((push.start, push.end), (4.5, 5.5));
    assert_eq!(push.force.as_slice(), [0.0, -9.5, 0.0]);
}

#[test]
fn what_is_left_out_has_its_default() {
    let plan = plan(SHORT).unwrap();
    assert_eq!((plan.keyframe, plan.grasps.len()), (None, 1));
    assert_eq!(plan.grasps[0].limits, Limits::Cones);
    assert_eq!(plan.grasps[0].relaxed, [true; 6]);
    assert_eq!((plan.grasps[0].latch_quality, plan.grasps[0].latch_time), (None, 0.05));
    assert_eq!((plan.timeline.pin_until, plan.timeline.measure_from()), (0.0, 0.0));
    assert_eq!(plan.select_pushes("all").unwrap().len(), 1);
    assert!(plan.select_pushes("all").unwrap()[0].is_none());
}

#[test]
fn the_palm_is_the_lowest_common_ancestor_of_the_effectors() {
    let with = |effectors: &str| {
        let plan = plan(&SHORT.replace("palm = \"palm\"", &format!("effectors = {effectors}"))).unwrap();
        plan.model.body_name(plan.grasps[0].palm.unwrap()).unwrap().to_owned()
    };
    assert_eq!(with(r#"["f0_3", "f3_1"]"#), "palm");
    assert_eq!(with(r#"["f0_3"]"#), "f0_2");
    assert_eq!(with("[]"), "palm", "the only hand");
    // An effector is never its own palm.
    assert_eq!(with(r#"["f0_3", "f0_2"]"#), "f0_1");
}

#[test]
fn several_grasps_need_pushes_that_name_a_target() {
    let two = format!(
        "{SHORT}\n[[push]]\nname = \"p\"\nstart = 0.1\nduration = 0.1\n[[grasp]]\ntarget = \"other\"\npalm = \"palm\"\n"
    );
    let message = parse(&two).unwrap_err().to_string();
    assert!(message.contains("push[0].target is missing") && message.contains("\"other\""), "{message}");
}

#[test]
fn text_that_is_no_scenario() {
    refused("name = \"claw\"", "name = ", &["line 2"]);
    refused("keyframe", "keyfrane", &["unknown field `keyfrane`", "expected one of", "`keyframe`"]);
    refused("latch_quality", "latchquality", &["unknown field `latchquality`", "`latch_quality`"]);
    refused("all = 0.0", "al = 0.0", &["unknown field `al`"]);
    refused("torque", "troque", &["unknown field `troque`"]);
    refused("limits = \"box\"", "limits = \"cone\"", &["cone", "`cones`", "`rigid`"]);
    refused("\"x\", \"rz\"", "\"x\", \"r\"", &["unknown variant `r`", "`rx`"]);
    refused("[0.0, -9.5, 0]", "[0.0, -9.5]", &["force", "3"]);
    refused("model = \"claw.xml\"", "", &["missing field `model`"]);
    refused("duration = 6.0", "duration = \"long\"", &["duration", "string \"long\""]);
}

#[test]
fn names_that_do_not_exist_list_close_ones() {
    refused("keyframe = \"open\"", "keyframe = \"opened\"", &["keyframe", "\"opened\"", "\"open\""]);
    refused("target = \"object\"", "target = \"objekt\"", &["grasp[0].target", "\"objekt\"", "\"object\""]);
    refused("\"f0_3\", ", "\"f0_4\", ", &["grasp[0].effectors[0]", "\"f0_4\"", "\"f0_3\""]);
    refused("palm = \"palm\"", "palm = \"plam\"", &["grasp[0].palm", "\"palm\""]);
    refused("f0_mcp", "f0_mpc", &["control[0].set", "\"f0_mpc\"", "\"f0_mcp\""]);
    refused("\"f0_tip\"", "\"f0_top\"", &["goal[0].effector_site", "\"f0_tip\""]);
    refused("\"goal0\"", "\"gaol0\"", &["goal[0].target_site", "\"goal0\""]);
    refused("target = \"object\"\nstart", "target = \"objekt\"\nstart", &["push[0].target", "\"object\""]);
    let none = plan(FULL).unwrap().select_pushes("fp2").unwrap_err().to_string();
    assert!(none.contains("\"fp2\"") && none.contains("\"fp1\""), "{none}");
}

#[test]
fn bodies_in_the_wrong_place() {
    refused("\"f0_3\", ", "\"object\", ", &["grasp[0].effectors[0]", "\"object\" is the target itself"]);
    refused("\"f0_3\", \"f1_3\"", "\"f0_3\", \"f0_3\"", &["grasp[0].effectors[1]", "twice"]);
    refused("palm = \"palm\"", "palm = \"object\"", &["grasp[0].palm", "the target itself"]);
    refused("palm = \"palm\"", "palm = \"f2_1\"", &["grasp[0].palm", "\"f2_1\" is not above", "\"palm\""]);
    refused("target = \"object\"\neff", "target = \"f2_3\"\neff", &["grasp[0].palm", "carries the target"]);
    refused("target = \"object\"\neff", "target = \"world\"\neff", &["grasp[0].target", "is the world"]);
    refused("target = \"object\"\nstart", "target = \"palm\"\nstart", &["push[0].target", "no target of a grasp"]);
    refused("\"f0_tip\"", "\"goal1\"", &["goal[0].effector_site", "not below the palm"]);
    refused("\"goal0\"", "\"f1_tip\"", &["goal[0].target_site", "no target of a grasp"]);
}

#[test]
fn numbers_that_make_no_sense() {
    for bad in ["nan", "-1.0", "0.0", "inf"] {
        refused("duration = 6.0", &format!("duration = {bad}"), &["timeline.duration", "above 0"]);
        refused("duration = 1.0", &format!("duration = {bad}"), &["push[0].duration", "above 0"]);
        refused("latch_quality = 0.2", &format!("latch_quality = {bad}"), &["grasp[0].latch_quality", "above 0"]);
    }
    for bad in ["nan", "-1.0", "inf"] {
        refused("pin_until = 3.0", &format!("pin_until = {bad}"), &["timeline.pin_until", "0 or above"]);
        refused("measure_from = 4.0", &format!("measure_from = {bad}"), &["timeline.measure_from", "0 or above"]);
        refused("time = 1.6", &format!("time = {bad}"), &["control[0].time", "0 or above"]);
        refused("start = 4.5", &format!("start = {bad}"), &["push[0].start", "0 or above"]);
        refused("release_quality = 0.05", &format!("release_quality = {bad}"), &["grasp[0].release_quality"]);
        refused("latch_time = 0.1", &format!("latch_time = {bad}"), &["grasp[0].latch_time", "0 or above"]);
    }
    for bad in ["nan", "inf", "-inf"] {
        refused("f0_mcp = 0.45", &format!("f0_mcp = {bad}"), &["control[0].set.f0_mcp", "finite"]);
        refused("all = 0.0", &format!("all = {bad}"), &["control[0].all", "finite"]);
        refused("-9.5, 0]", &format!("{bad}, 0]"), &["push[0].force[1] (y)", "finite"]);
        refused("torque = [0.0, ", &format!("torque = [{bad}, "), &["push[0].torque[0] (x)", "finite"]);
    }
    refused("axes = [2.0,", "axes = [0.0,", &["grasp[0].axes", "not zero"]);
    refused("[0.01, 0.9]", "[0.01, -0.9]", &["grasp[0].solref", "-0.9", "damping ratio", "-stiffness"]);
    refused("[0.8, 0.95,", "[0.8, 1.95,", &["grasp[0].relaxed_solimp", "1.95", "between 0 and 1"]);
    refused("0.4, 3.0]", "0.4, 0.5]", &["grasp[0].relaxed_solimp", "power at least 1"]);
}

#[test]
fn values_that_contradict_each_other() {
    refused("pin_until = 3.0", "pin_until = 4.5", &["timeline.measure_from", "before pin_until = 4.5"]);
    refused("measure_from = 4.0", "measure_from = 6.0", &["timeline.measure_from", "duration = 6"]);
    refused("start = 4.5", "start = 5.5", &["push[0].duration", "end at 6.5 s", "timeline.duration = 6"]);
    refused("release_quality = 0.05", "release_quality = 0.2", &["grasp[0].release_quality", "below latch_quality"]);
    refused("limits = \"box\"\n", "", &["grasp[0].relaxed", "limits = \"box\""]);
    let short =
        |key: &str, limits: &str| SHORT.replace("[timeline]", &format!("limits = \"{limits}\"\n{key}\n[timeline]"));
    for (key, limits, right) in [
        ("solref = [0.02, 1.0]", "cones", "\"box\" or \"rigid\""),
        ("relaxed_solref = [0.02, 1.0]", "rigid", "limits = \"box\""),
    ] {
        let error =
            ScenarioFile::parse(&short(key, limits), Path::new("short.toml")).expect_err("no meaning").to_string();
        assert!(error.contains(right) && error.contains("solref"), "{error}");
    }
    refused("all = 0.0\nset = { f0_mcp = 0.45, f0_pip = 0.75 }", "", &["control[0].set", "must set something"]);
    refused("name = \"fp1\"", "name = \"all\"", &["push[0].name", "--push"]);
    refused("name = \"fp1\"", "name = \"a/b\"", &["push[0].name", "names files"]);
    refused("name = \"claw\"", "name = \"\"", &["name", "names files"]);
    let twice = "[[push]]\nname = \"fp1\"\nstart = 0.1\nduration = 0.1\n";
    let message = parse(&format!("{FULL}\n{twice}")).unwrap_err().to_string();
    assert!(message.contains("push[1].name") && message.contains("\"fp1\""), "{message}");
    let goal = "[[goal]]\neffector_site = \"f0_tip\"\ntarget_site = \"goal1\"\n";
    let message = parse(&format!("{FULL}\n{goal}")).unwrap_err().to_string();
    assert!(message.contains("goal[1].effector_site"), "{message}");
    let message =
        parse(&SHORT.replace("[[grasp]]\ntarget = \"object\"\npalm = \"palm\"\n", "")).unwrap_err().to_string();
    assert!(message.contains("grasp is missing"), "{message}");
}

#[test]
fn two_grasps_of_one_target_whose_hands_share_fingers() {
    let two = format!("{SHORT}[[grasp]]\ntarget = \"object\"\npalm = \"f0_1\"\n");
    let error = Runner::new(&plan(&two).unwrap(), Mode::Full, None).map(|_| ()).expect_err("must be refused");
    assert!(error.is_bad_input(), "{error}");
    let message = error.to_string();
    for part in
        ["dir/test.toml: grasp[1]: body \"f0_1\"", "body \"object\"", "palm body \"palm\"", "one grasp of a target"]
    {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

#[test]
fn effectors_that_are_none() {
    refused("\"f0_3\", ", "\"world\", ", &["grasp[0].effectors[0]", "is the world"]);
    refused("\"x\", \"rz\"", "\"x\", \"rz\", \"x\"", &["grasp[0].relaxed[2]", "\"x\" is listed twice"]);
}

#[test]
fn a_push_that_no_step_feels() {
    // the claw's time step is 2 ms
    let between = "start = 4.5011\nduration = 0.0009";
    refused("start = 4.5\nduration = 1.0", between, &["push[0].duration", "0.0009 s", "middle of no step", "0.002"]);
    let short = FULL.replace("start = 4.5\nduration = 1.0", "start = 4.5008\nduration = 0.0009");
    plan(&short).expect("the middle of a step is in it");
}

#[test]
fn names_that_no_file_can_have() {
    for (bad, parts) in [
        ("a".repeat(400), ["400 bytes long", "200"]),
        ("..".into(), ["\"..\"", "parent"]),
        ("a\\nb".into(), ["\"a\\nb\"", "line break"]),
    ] {
        refused("name = \"claw\"", &format!("name = \"{bad}\""), &["name is", "names files", parts[0], parts[1]]);
    }
}

#[test]
fn a_frozen_tolerance_of_a_wide_turn() {
    for bad in ["0.2", "-0.1", "nan", "1e300"] {
        let with = format!("keyframe = \"open\"\nfrozen_tolerance = {bad}");
        refused("keyframe = \"open\"", &with, &["frozen_tolerance is", "0 to 0.1 rad"]);
    }
}

#[test]
fn huge_numbers_are_not_written_out() {
    refused("start = 4.5", "start = 1e300", &["1e300 s; it must end by"]);
}

#[test]
fn a_push_may_end_with_the_scenario() {
    // 0.1 + 0.2 is larger than 0.3 in binary.
    let push = "[[push]]\nname = \"p\"\nstart = 0.1\nduration = 0.2\n";
    let text = SHORT.replace("duration = 1", "duration = 0.3") + push;
    let push = &parse(&text).unwrap().push[0];
    assert!(push.end() > 0.3);
    let late = text.replace("start = 0.1", "start = 0.101");
    assert!(parse(&late).is_err());
}

#[test]
fn a_target_that_cannot_move_is_refused() {
    let file = parse(&SHORT.replace("\"object\"", "\"block\"")).unwrap();
    let xml = "<mujoco><worldbody><body name='palm'><joint/><geom size='.1'/></body><body name='block'><geom size='.1'/></body></worldbody></mujoco>";
    let message = Plan::new(&file, Path::new("t.toml"), Model::from_xml_string(xml).unwrap()).unwrap_err().to_string();
    assert!(message.contains("grasp[0].target") && message.contains("<freejoint/>"), "{message}");
}

#[test]
fn fingers_that_stand_on_the_world_have_it_as_their_palm() {
    let text = SHORT.replace("palm = \"palm\"", "effectors = [\"a\", \"b\"]");
    let xml = "<mujoco><worldbody><body name='a'><joint/><geom size='.1'/></body><body name='b' pos='1 0 0'><joint/><geom size='.1'/></body>
        <body name='object' pos='0 0 1'><freejoint/><geom size='.1'/></body></worldbody></mujoco>";
    let plan = Plan::new(&parse(&text).unwrap(), Path::new("t.toml"), Model::from_xml_string(xml).unwrap()).unwrap();
    assert_eq!(plan.grasps[0].palm, Some(BodyId::WORLD));
}
