//! Models that are compiled in a child process: what kills or hangs the compiler is a load error. A program of its own, as the
//! whole process compiles so from then on.

use mujoco_grasp::mujoco::{Error, Model, Simulation, isolate_loading};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A file that kills 2.2.2: faces of an MSH mesh whose corners are far from any vertex.
fn deadly(folder: &Path) -> PathBuf {
    let mut mesh: Vec<u8> = [4_i32, 0, 0, 4].iter().flat_map(|n| n.to_le_bytes()).collect();
    let corners = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    mesh.extend(corners.iter().flat_map(|n| n.to_le_bytes()));
    mesh.extend([0_i32, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 99_999_999].iter().flat_map(|n| n.to_le_bytes()));
    std::fs::write(folder.join("deadly.msh"), mesh).unwrap();
    let path = folder.join("deadly.xml");
    let xml = r#"<mujoco><asset><mesh name="m" file="deadly.msh"/></asset>
      <worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>"#;
    std::fs::write(&path, xml).unwrap();
    path
}

#[test]
fn a_file_that_kills_the_compiler_is_a_load_error() {
    isolate_loading(Some(Duration::from_secs(60)));
    let folder = tempfile::tempdir().unwrap();
    let path = deadly(folder.path());
    for _ in 0..2 {
        let error = Model::from_xml_file(&path).unwrap_err();
        assert!(matches!(error, Error::Load { .. }), "{error:?}");
        let text = error.to_string();
        assert!(text.contains("deadly.xml"), "{text}");
        // MuJoCo 3 looks at the corners itself.
        assert!(text.contains("MuJoCo died of signal 11") || cfg!(mujoco3), "{text}");
    }
}

#[test]
fn a_file_with_which_the_compiler_never_ends_is_a_load_error() {
    isolate_loading(Some(Duration::from_secs(1)));
    let xml = "<mujoco><compiler><lengthrange inttotal='10000' timestep='1e-9' mode='all'/></compiler>
      <worldbody><body><joint name='j' range='-1 1' limited='true'/><geom size='.1' pos='.5 0 0'/></body></worldbody>
      <actuator><muscle joint='j'/></actuator></mujoco>";
    let text = Model::from_xml_string(xml).unwrap_err().to_string();
    assert!(text.contains("has not loaded within 1 s"), "{text}");
}

#[test]
fn an_isolated_model_is_the_same_as_one_that_is_not() {
    let xml = r#"<mujoco><option cone="elliptic" timestep="0.001"/><size nuser_body="2"/>
      <asset><mesh name="tet" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/></asset>
      <worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="9 9 1"/>
        <body name="arm" pos="0 0 1"><joint name="elbow"/><geom size=".1" pos=".3 0 0"/></body>
        <body name="tet" pos="1 0 .2"><freejoint/><geom type="mesh" mesh="tet"/></body></worldbody>
      <actuator><position name="servo" joint="elbow" kp="3"/></actuator>
      <keyframe><key name="home" qpos="1 1 0 .2 1 0 0 0"/></keyframe></mujoco>"#;
    let plain = Model::from_xml_string(xml).unwrap();
    isolate_loading(Some(Duration::from_secs(60)));
    let isolated = Model::from_xml_string(xml).unwrap();
    assert_eq!(isolated.warnings(), plain.warnings());
    assert_eq!(format!("{isolated:?}"), format!("{plain:?}").replace("\0", ""));
    let end = |model: &Model| {
        let mut sim = Simulation::new(model).unwrap();
        sim.reset_to_keyframe(model.keyframe("home").unwrap()).unwrap();
        sim.ctrl_mut()[model.actuator("servo").unwrap().index()] = 0.5;
        (0..500).for_each(|_| sim.step().unwrap());
        sim.save()
    };
    assert_eq!(end(&isolated), end(&plain));
    // MuJoCo's own refusals come through, and files of a user's folder are found.
    let text = Model::from_xml_string("<mujoco><worldbody><frob/></worldbody></mujoco>").unwrap_err().to_string();
    assert!(text.contains("the model text does not load") && text.contains("frob"), "{text}");
    assert!(matches!(Model::from_xml_file("/no/such/file.xml"), Err(Error::File { .. })));
}
