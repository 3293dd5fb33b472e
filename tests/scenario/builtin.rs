//! The scenarios that the program carries with it.

use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use mujoco_grasp::scenario::{builtin, source};

#[test]
fn the_built_in_scenarios_load_from_memory() {
    for (listed, builtin) in source::list().unwrap().iter().zip(builtin::ALL) {
        assert_eq!(listed.name, builtin.name);
        assert!(!listed.about.is_empty(), "{} says nothing about itself", listed.name);
        let plan = Plan::load(builtin.name).unwrap();
        assert_eq!(plan.name, builtin.name);
        // The same model as from the files.
        let from_file = Plan::load(builtin.path).unwrap();
        assert_eq!(plan.model.qpos0(), from_file.model.qpos0());
        assert_eq!(plan.model.body_mass(), from_file.model.body_mass());
        for push in &plan.pushes {
            Runner::new(&plan, Mode::Grasp, Some(push)).unwrap();
        }
    }
}

#[test]
fn every_scenario_file_of_the_repository_loads() {
    let mut names = Vec::new();
    for file in std::fs::read_dir("scenarios").unwrap() {
        let path = file.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            let plan = Plan::load(path.to_str().unwrap()).unwrap();
            Runner::new(&plan, Mode::Full, None).unwrap();
            names.push(plan.name);
        }
    }
    for builtin in builtin::ALL {
        assert!(names.iter().any(|n| n == builtin.name), "{} has no file", builtin.name);
    }
}
