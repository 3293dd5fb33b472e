//! Engine faults, full buffers, divergence and bad controls are errors; nothing is printed and nobody waits for a key.

#[cfg(not(mujoco3))]
use mujoco_grasp::mujoco::Buffer;
use mujoco_grasp::mujoco::{Error, Model, Simulation, WarningKind};
use std::process::{Command, Stdio};

fn simulation(xml: &str) -> Simulation {
    Simulation::new(&Model::from_xml_string(xml).unwrap()).unwrap()
}

/// `balls` balls that lie on a plane; `size` are the attributes of `<size>`.
fn balls(balls: usize, size: &str) -> String {
    let bodies: String =
        (0..balls).map(|i| format!("<body pos='{i} 0 0.099'><freejoint/><geom size='0.1'/></body>")).collect();
    format!("<mujoco><size {size}/><worldbody><geom type='plane' size='9 9 1'/>{bodies}</worldbody></mujoco>")
}

/// Falls onto a plane at t = 0.2 s; the contacts then need more stack than there is.
const SMALL_STACK: &str = r#"<mujoco><size nstack="400"/><worldbody><geom type="plane" size="9 9 1"/>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1"/>
    <body pos=".5 0 0"><joint/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="0 .5 0"><joint/><geom type="box" size=".1 .1 .1"/></body></body></worldbody></mujoco>"#;

fn step_until_error(sim: &mut Simulation) -> Error {
    (0..2000).find_map(|_| sim.step().err()).expect("no error in 2000 steps")
}

#[test]
#[cfg(not(mujoco3))] // sizes and messages of 2.2.2; 3.x has arena
fn a_fault_in_a_step_comes_back_and_interrupts_the_simulation() {
    let mut sim = simulation(SMALL_STACK);
    let start = sim.save();
    let error = step_until_error(&mut sim);
    assert!(matches!(error, Error::Engine { call: "mj_step", .. }), "{error:?}");
    assert!(error.to_string().contains("nstack"), "{error}");
    assert!(sim.time() > 0.05, "the fault is that of the contacts, at {}", sim.time());
    // Half-done results are not built upon, in a copy neither.
    assert!(matches!(sim.step(), Err(Error::Interrupted { .. })));
    assert!(matches!(sim.clone().forward(), Err(Error::Interrupted { .. })));
    assert_eq!((sim.contact_count(), sim.nefc()), (0, 0));
    // A reset or a restored state ends it, and the stack is clean: the same fall gives the same fault at the same time.
    let first = sim.time();
    sim.restore(&start).unwrap();
    sim.step().unwrap();
    step_until_error(&mut sim);
    assert_eq!(sim.time(), first);
    sim.reset().unwrap();
    sim.step().unwrap();
}

#[test]
#[cfg(not(mujoco3))] // sizes and messages of 2.2.2; 3.x has arena
fn a_fault_in_the_cpp_loader_comes_back() {
    // An include with a name that is too long faults in the virtual file system, below the C++ parser.
    let xml = format!("<mujoco><include file='{}.xml'/></mujoco>", "x".repeat(1200));
    for _ in 0..2 {
        let error = Model::from_xml_string(&xml).unwrap_err();
        assert!(matches!(error, Error::Engine { call: "mj_loadXML", .. }), "{error:?}");
        assert!(error.to_string().contains("Filename too long in VFS"), "{error}");
    }
    // The loader's lock was released on the way: loading still works, here and in another thread.
    Model::from_xml_string(&balls(1, "")).unwrap();
    std::thread::spawn(|| Model::from_xml_string(&balls(1, "")).unwrap()).join().unwrap();
}

#[test]
#[cfg(not(mujoco3))] // sizes and messages of 2.2.2; 3.x has arena
fn an_engine_fault_in_the_compiler_is_a_load_error() {
    let error = Model::from_xml_string(&balls(1, "nstack='1'")).unwrap_err();
    assert!(error.to_string().contains("Stack overflow"), "{error}");
    // The compiler's own handlers are not left behind.
    a_fault_in_a_step_comes_back_and_interrupts_the_simulation();
}

#[test]
#[cfg(not(mujoco3))] // sizes and messages of 2.2.2; 3.x has arena
fn dropped_contacts_are_an_error_in_every_step() {
    let mut sim = simulation(&balls(3, "nconmax='2'"));
    for _ in 0..3 {
        let time = sim.time();
        match sim.step() {
            Err(Error::BufferFull { buffer: Buffer::Contacts, size: 2, time: at }) => assert_eq!(at, time),
            other => panic!("{other:?}"),
        }
    }
    let warnings = sim.take_warnings();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert_eq!((warnings[0].kind, warnings[0].count), (WarningKind::ContactsFull, 3));
    assert!(sim.take_warnings().is_empty());
    assert!(matches!(sim.collision(), Err(Error::BufferFull { .. })));
    let text = sim.step().unwrap_err().to_string();
    assert!(text.contains("nconmax") && text.contains("2 places"), "{text}");
}

#[test]
#[cfg(not(mujoco3))] // sizes and messages of 2.2.2; 3.x has arena
fn dropped_constraint_rows_are_an_error() {
    let mut sim = simulation(&balls(3, "njmax='7'"));
    sim.kinematics().unwrap();
    sim.inertia().unwrap();
    sim.collision().unwrap();
    let error = sim.make_constraint().unwrap_err();
    assert!(matches!(error, Error::BufferFull { buffer: Buffer::Constraints, size: 7, .. }), "{error:?}");
    assert!(error.to_string().contains("njmax"), "{error}");
}

#[test]
fn a_reset_by_the_engine_is_noticed_each_time() {
    let xml = "<mujoco><worldbody><body name='pendulum'><joint name='hinge'/><geom size='.1' pos='0 0 1'/></body>
      <body pos='5 0 0'><freejoint name='float'/><geom size='.1'/></body></worldbody></mujoco>";
    let mut sim = simulation(xml);
    // Twice: the engine's own counter is back at one after each reset.
    for _ in 0..2 {
        sim.step().unwrap();
        let time = sim.time();
        sim.qpos_mut()[3] = f64::NAN;
        match sim.step().unwrap_err() {
            Error::Diverged { quantity: "qpos", index: 3, element, time: at } => {
                assert!(element.contains("\"float\""), "{element}");
                assert_eq!(at, time);
            }
            other => panic!("{other:?}"),
        }
    }
    sim.reset().unwrap();
    sim.qvel_mut()[0] = 1e12;
    let text = sim.step().unwrap_err().to_string();
    assert!(text.contains("qvel[0]") && text.contains("\"hinge\"") && text.contains("\"pendulum\""), "{text}");
    sim.reset().unwrap();
    sim.qfrc_applied_mut()[0] = 1e15;
    let error = sim.step().unwrap_err();
    assert!(matches!(error, Error::Diverged { quantity: "qacc", index: 0, .. }), "{error:?}");
    assert!(matches!(sim.step(), Ok(())), "the reset has cleared the force");
}

#[test]
fn a_diverging_simulation_says_when() {
    // An undamped negative spring: grows by itself.
    let mut sim = simulation(
        "<mujoco><worldbody><body><joint type='slide' axis='1 0 0'/><geom size='.1'/></body></worldbody></mujoco>",
    );
    sim.jnt_stiffness_mut()[0] = -1e5;
    sim.qpos_mut()[0] = 1e-3;
    let mut last = 0.0;
    let error = (0..10_000)
        .find_map(|_| {
            last = sim.time();
            sim.step().err()
        })
        .expect("it diverges");
    match error {
        Error::Diverged { time, .. } => assert_eq!(time, last),
        other => panic!("{other:?}"),
    }
    assert!(last > 0.0 && sim.time() <= sim.model().timestep());
}

#[test]
fn a_bad_control_names_its_actuator() {
    let mut sim = simulation(
        "<mujoco><worldbody><body><joint name='j'/><geom size='.1'/></body></worldbody>
         <actuator><motor name='good' joint='j'/><motor name='grip' joint='j'/></actuator></mujoco>",
    );
    sim.ctrl_mut()[1] = f64::NAN;
    let error = sim.step().unwrap_err();
    assert!(matches!(error, Error::BadControl { .. }), "{error:?}");
    assert!(error.to_string().contains("\"grip\"") && error.to_string().contains("NaN"), "{error}");
    sim.ctrl_mut()[1] = 1.0;
    sim.step().unwrap();
}

#[test]
fn bad_arguments_are_errors() {
    let mut sim = simulation(&balls(1, ""));
    assert!(matches!(sim.set_timestep(0.0), Err(Error::Value { .. })));
    assert!(matches!(sim.set_timestep(f64::NAN), Err(Error::Value { .. })));
    assert!(sim.set_iterations(0).is_err() && sim.set_iterations(1001).is_err());
    assert!(sim.contact(0).is_err() && sim.contact_force(0).is_err() && sim.exclude_contact(0).is_err());
    assert!(matches!(sim.solve_mass(&mut [0.0; 5]), Err(Error::Length { .. })));
    let beyond = mujoco_grasp::mujoco::BodyId::from_index(2);
    assert!(matches!(sim.jac_body(beyond, &mut [0.0; 36]), Err(Error::OutOfRange { .. })));
    assert!(sim.reset_to_keyframe(mujoco_grasp::mujoco::KeyframeId::from_index(0)).is_err());
}

/// Everything above that warns or faults, in a fresh process: no output, no log file, no exit, no waiting.
#[test]
fn nothing_is_printed_logged_or_waited_for() {
    if std::env::var_os("BINDING_FAULTS_CHILD").is_some() {
        // What is too small for contacts, for rows and for the stack: of 3.x see arena. 3.17 needs 17 kB of stack
        // for this scene; 4.0.1 runs with 12 kB, and is short of contacts, rows or stack with these.
        let small = [balls(3, "nconmax='2'"), balls(3, "njmax='7'"), SMALL_STACK.into()];
        let small_arena = [balls(3, "memory='2000'"), balls(3, "memory='6000'"), balls(3, "memory='9000'")];
        for xml in if cfg!(mujoco3) { small_arena } else { small } {
            let simulation = Model::from_xml_string(&xml).and_then(|model| Simulation::new(&model));
            simulation.map_or_else(|error| error, |mut sim| step_until_error(&mut sim));
        }
        let long = format!("<mujoco><include file='{}.xml'/></mujoco>", "x".repeat(1200));
        Model::from_xml_string(&long).unwrap_err();
        // A solref with mixed signs: a warning that no counter counts.
        let mut sim = simulation(&balls(1, "").replace("size='0.1'", "size='0.1' solref='0.02 1'"));
        sim.step().unwrap();
        let mut sim = simulation(&balls(1, "").replace("<geom ", "<geom solref='-100 1' solmix='1000000' "));
        sim.step().unwrap();
        let warnings = sim.take_warnings();
        assert!(
            warnings.iter().any(|w| w.kind == WarningKind::Other && w.text.contains("mixed solref")),
            "{warnings:?}"
        );
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "faults::nothing_is_printed_logged_or_waited_for", "--nocapture", "--quiet"])
        .env("BINDING_FAULTS_CHILD", "1")
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let (out, err) = (String::from_utf8_lossy(&child.stdout), String::from_utf8_lossy(&child.stderr));
    assert!(child.status.success(), "{out}{err}");
    for word in ["WARNING", "ERROR", "Press Enter", "panicked", "Stack overflow"] {
        assert!(!out.contains(word) && !err.contains(word), "{word} in {out}{err}");
    }
    assert!(out.contains("1 passed"), "{out}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "a log file was written");
}

#[test]
#[cfg(not(mujoco3))] // sizes and messages of 2.2.2; 3.x has arena
fn sizes_beyond_the_engines_range_are_errors() {
    for size in ["njmax='100000'", "njmax='20000'"] {
        let model = Model::from_xml_string(&balls(1, size));
        let simulation = model.and_then(|model| Simulation::new(&model));
        assert!(simulation.is_err(), "{size}");
    }
}
