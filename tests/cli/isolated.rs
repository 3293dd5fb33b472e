//! `--isolated`: a model that kills MuJoCo's compiler is bad input for every subcommand that loads one.

use crate::program::{call_in, data};

#[test]
fn a_model_that_kills_the_compiler_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    // Faces of an MSH mesh whose corners are far from any vertex: 2.2.2 takes them as addresses.
    let mut mesh: Vec<u8> = [4_i32, 0, 0, 4].iter().flat_map(|n| n.to_le_bytes()).collect();
    let corners = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    mesh.extend(corners.iter().flat_map(|n| n.to_le_bytes()));
    mesh.extend([0_i32, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 99_999_999].iter().flat_map(|n| n.to_le_bytes()));
    std::fs::write(folder.path().join("deadly.msh"), mesh).unwrap();
    let xml = "<mujoco><asset><mesh name='m' file='deadly.msh'/></asset><worldbody><body name='palm'>
      <body name='object'><geom type='mesh' mesh='m'/></body></body></worldbody></mujoco>";
    std::fs::write(folder.path().join("deadly.xml"), xml).unwrap();
    let scenario = "name = \"deadly\"\nmodel = \"deadly.xml\"\n[[grasp]]\ntarget = \"object\"\npalm = \"palm\"\n
      [timeline]\nduration = 1.0\npin_until = 0.1\nmeasure_from = 0.5\n";
    std::fs::write(folder.path().join("deadly.toml"), scenario).unwrap();
    for command in ["run", "quality", "bench", "agree", "calibrate"] {
        let called = call_in(folder.path(), &[command, "deadly.toml", "--isolated", "--json"]);
        assert_eq!(called.status, 2, "{}", called.stderr);
        let json = called.json();
        let message = json["error"].as_str().unwrap();
        assert!(message.contains("deadly.toml: model") && message.contains("deadly.xml"), "{message}");
        // MuJoCo 3 looks at the corners itself.
        assert!(message.contains("MuJoCo died of signal 11") || cfg!(mujoco3), "{message}");
    }
}

#[test]
fn an_isolated_call_says_the_same_as_another() {
    let folder = tempfile::tempdir().unwrap();
    let claw = &data("claw.toml");
    let plain = call_in(folder.path(), &["quality", claw, "--json"]);
    let isolated = call_in(folder.path(), &["--isolated", "quality", claw, "--json"]);
    assert_eq!((plain.status, isolated.status), (0, 0), "{}{}", plain.stderr, isolated.stderr);
    assert_eq!(plain.stdout, isolated.stdout);
}
