//! Loading models, and what the errors say.

use mujoco_grasp::mujoco::{Error, JointKind, Model, Simulation};
use std::fs;
use std::path::Path;

const ARM: &str = r#"<mujoco><worldbody>
  <body name="palm"><joint name="wrist" type="hinge"/><geom name="palm_geom" size="0.1"/>
    <body name="thumb_tip" pos="0.2 0 0"><joint name="thumb"/><geom size="0.02"/></body>
    <body name="index_tip" pos="0 0.2 0"><geom size="0.02"/></body></body>
  <body name="cube" pos="0 0 1"><freejoint/><geom type="box" size="0.03 0.03 0.03"/></body>
</worldbody></mujoco>"#;

fn write(path: &Path, text: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

#[test]
fn a_missing_file_is_named_with_the_systems_reason() {
    let error = Model::from_xml_file("/no/such/hand.xml").unwrap_err();
    assert!(matches!(error, Error::File { .. }));
    let text = error.to_string();
    assert!(text.contains("/no/such/hand.xml") && text.contains("No such file"), "{text}");

    let folder = tempfile::tempdir().unwrap();
    let error = Model::from_xml_file(folder.path()).unwrap_err();
    assert!(matches!(error, Error::File { .. }), "{error}");
    assert!(matches!(Model::from_xml_file_with("", "").unwrap_err(), Error::File { .. }));
}

#[test]
fn mujocos_own_load_error_is_kept() {
    for (xml, expected) in [
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "mass and inertia"),
        ("<mujoco><worldbody><geom size='-'/></worldbody></mujoco>", "size"),
        ("<mujoco><world/></mujoco>", "world"),
        ("<mujoco>", "XML parse error"),
    ] {
        let error = Model::from_xml_string(xml).unwrap_err();
        assert!(matches!(error, Error::Load { .. }), "{error:?}");
        assert!(error.to_string().contains(expected), "{error}");
    }
    assert!(matches!(Model::from_xml_string("").unwrap_err(), Error::Load { .. }));
}

#[test]
fn an_unknown_name_gives_the_close_ones() {
    let model = Model::from_xml_string(ARM).unwrap();
    let text = model.body("thum_tip").unwrap_err().to_string();
    assert!(text.contains("no body named \"thum_tip\"") && text.contains("did you mean \"thumb_tip\""), "{text}");
    let text = model.body("qqq").unwrap_err().to_string();
    assert!(!text.contains("did you mean") && text.contains("\"palm\""), "{text}");
    let text = model.keyframe("home").unwrap_err().to_string();
    assert!(text.contains("none of them has a name"), "{text}");
    assert!(model.body("").is_err(), "unnamed elements cannot be asked for");
    assert!(model.body("a\0b").is_err());
}

#[test]
fn names_counts_and_trees() {
    let model = Model::from_xml_string(ARM).unwrap();
    assert_eq!((model.nbody(), model.njnt(), model.nv(), model.nq()), (5, 3, 8, 9));
    let palm = model.body("palm").unwrap();
    assert_eq!(model.body_name(palm), Some("palm"));
    assert_eq!(model.label(model.geoms().nth(1).unwrap()), "geom 1");
    let names: Vec<_> = model.subtree(palm).unwrap().into_iter().map(|b| model.body_name(b).unwrap()).collect();
    assert_eq!(names, ["palm", "thumb_tip", "index_tip"]);
    let cube = model.body("cube").unwrap();
    let free = model.free_joint_of(cube).unwrap();
    assert_eq!(model.joint_kind(free), Some(JointKind::Free));
    assert_eq!(model.free_joint_of(palm), None);
    assert_eq!(model.free_joint_of(model.body("index_tip").unwrap()), None);
}

#[test]
fn elements_are_added_to_a_users_file_without_touching_it() {
    // The user's file names a mesh and an include relative to itself, is in another folder, and has awkward names.
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("My Models/scene & hand.xml");
    let text = r#"<mujoco><compiler meshdir="meshes"/><asset><mesh name="tet" file="tet.stl"/></asset>
      <include file="parts/hand.xml"/>
      <worldbody><body name="cube" pos="0 0 1"><freejoint/><geom type="mesh" mesh="tet"/></body></worldbody>
      <keyframe><key name="home" qpos="0 0 1 1 0 0 0 0.5"/></keyframe></mujoco>"#;
    write(&scene, text);
    write(
        &folder.path().join("My Models/parts/hand.xml"),
        r#"<mujoco><worldbody><body name="palm" pos="0 0 2"><joint/><geom size=".1"/></body></worldbody></mujoco>"#,
    );
    fs::create_dir_all(folder.path().join("My Models/meshes")).unwrap();
    fs::write(folder.path().join("My Models/meshes/tet.stl"), tetrahedron()).unwrap();

    let plain = Model::from_xml_file(&scene);
    let extra = r#"<equality><weld body1="palm" body2="cube" active="false"/></equality>"#;
    let with = Model::from_xml_file_with(&scene, extra);
    assert_eq!(fs::read_to_string(&scene).unwrap(), text);
    assert_eq!(fs::read_dir(scene.parent().unwrap()).unwrap().count(), 3, "no file is left behind");
    let (plain, with) = (plain.unwrap(), with.unwrap());
    assert_eq!((plain.neq(), with.neq()), (0, 1));
    assert_eq!((plain.nbody(), plain.nq(), plain.nkey()), (with.nbody(), with.nq(), with.nkey()));
    assert_eq!(plain.key_qpos(), with.key_qpos());

    let clash = r#"<worldbody><body name="palm"/></worldbody>"#;
    let error = Model::from_xml_file_with(&scene, clash).unwrap_err().to_string();
    assert!(error.contains("repeated name"), "{error}");
}

#[test]
fn assets_come_from_memory() {
    // 2.2.2 ignores folders and case of names in memory.
    const SAME: &str = if cfg!(mujoco3) { "Tet.STL" } else { "a/tet.stl" };
    let xml = r#"<mujoco><asset><mesh name="tet" file="Tet.STL"/></asset>
      <worldbody><geom type="mesh" mesh="tet"/></worldbody></mujoco>"#;
    assert!(Model::from_xml_string(xml).is_err());
    let stl = tetrahedron();
    let model = Model::from_xml_with_assets(xml, &[("Tet.STL", &stl)]).unwrap();
    assert_eq!(model.mesh_facenum(), [4]);
    let twice = Model::from_xml_with_assets(xml, &[("Tet.STL", &stl), (SAME, &stl)]).unwrap_err();
    assert!(twice.to_string().contains("another file has this name"), "{twice}");
    assert!(Model::from_xml_with_assets(xml, &[("Tet.STL", &[])]).unwrap_err().to_string().contains("empty"));
}

#[test]
fn models_are_shared_and_simulations_have_their_own_copy() {
    fn shared<T: Send + Sync + Clone>() {}
    fn movable<T: Send + Clone>() {}
    shared::<Model>();
    movable::<Simulation>();
    let model = Model::from_xml_string(ARM).unwrap();
    let mut sim = Simulation::new(&model).unwrap();
    sim.set_timestep(0.001).unwrap();
    sim.geom_friction_mut().fill(0.25);
    let copy = sim.clone();
    sim.set_timestep(0.004).unwrap();
    assert_eq!((model.timestep(), copy.model().timestep(), sim.model().timestep()), (0.002, 0.001, 0.004));
    assert_eq!((model.geom_friction()[0], copy.model().geom_friction()[0]), (1.0, 0.25));
}

#[test]
fn a_simulation_outlives_its_model() {
    let mut sim = Simulation::new(&Model::from_xml_string(ARM).unwrap()).unwrap();
    sim.step().unwrap();
    assert_eq!(sim.time(), sim.model().timestep());
}

/// A binary STL with four triangles.
fn tetrahedron() -> Vec<u8> {
    let corners = [[0.0_f32, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]];
    let mut stl = vec![0_u8; 80];
    stl.extend(4_u32.to_le_bytes());
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        stl.extend([0_u8; 12]);
        stl.extend(face.iter().flat_map(|&i: &usize| corners[i]).flat_map(f32::to_le_bytes));
        stl.extend([0_u8; 2]);
    }
    stl
}
