//! The scenarios that the program carries with it.

use std::collections::BTreeSet;

use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use mujoco_grasp::scenario::{builtin, source};

#[test]
fn every_scenario_of_the_repository_is_built_in_and_loads_from_memory() {
    let files: BTreeSet<String> = std::fs::read_dir("scenarios")
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    let built_in: BTreeSet<String> = builtin::ALL
        .iter()
        .map(|b| format!("{}.toml", b.name))
        .collect();
    assert_eq!(files, built_in);
    for (listed, builtin) in source::list().unwrap().iter().zip(builtin::ALL) {
        assert_eq!(listed.name, builtin.name);
        assert!(
            !listed.about.is_empty(),
            "{} says nothing about itself",
            listed.name
        );
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
