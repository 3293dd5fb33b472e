//! Models with which MuJoCo's compiler would crash, hang, end the process or take all memory are load errors.

use mujoco_grasp::mujoco::{Error, Model};
use std::process::Command;
#[cfg(not(mujoco3))]
use std::process::Stdio;

const BODY: &str = "<worldbody><body name='b'><freejoint/><geom size='.1'/></body></worldbody>";
/// Four corners of a tetrahedron.
const CORNERS: &str = "vertex='0 0 0 1 0 0 0 1 0 0 0 1'";

#[track_caller]
fn refused(xml: &str, parts: &[&str]) {
    let error = Model::from_xml_string(xml).unwrap_err();
    assert!(matches!(error, Error::Load { .. }), "{error:?}");
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}

fn asset(element: &str) -> String {
    format!("<mujoco><asset>{element}</asset>{BODY}</mujoco>")
}

#[test]
fn sizes_that_overflow_inside_the_compiler() {
    for size in ["body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor"] {
        let xml = format!("<mujoco>\n<size nuser_{size}='2000000000'/>{BODY}</mujoco>");
        refused(&xml, &[&format!("nuser_{size}=\"2000000000\""), "from -1 to 100000", "line 2", "the model text"]);
    }
    refused(&format!("<mujoco><size nkey='2000000000'/>{BODY}</mujoco>"), &["nkey", "at most 100000"]);
    for size in ["65536", "40000", "2000000000"] {
        let field = asset(&format!("<hfield name='h' nrow='{size}' ncol='{size}' size='1 1 1 1'/>"));
        refused(&field, &["nrow and ncol", "at most 268435456"]);
        let plane = format!("<texture name='t' type='2d' builtin='flat' width='{size}' height='{size}'/>");
        refused(&asset(&plane), &["width and height", "at most 268435456"]);
        let sky = format!("<texture name='t' type='skybox' builtin='gradient' width='{size}' height='{size}'/>");
        refused(&asset(&sky), &["width", "at most 268435456"]);
        refused(&asset(&sky.replace("type='skybox'", "")), &["width", "at most 268435456"]);
    }
    refused(&asset("<hfield name='h' nrow='-4' ncol='-4' size='1 1 1 1'/>"), &["nrow=\"-4\"", "not be negative"]);
    let grid = "<composite type='grid' count='30000 30000 1' spacing='.1'><geom size='.01'/></composite>";
    refused(&format!("<mujoco><worldbody><body>{grid}</body></worldbody></mujoco>"), &["composite", "count"]);
}

#[test]
fn corners_of_faces_that_are_no_vertices() {
    for corner in ["4", "99999999", "-1", "-99999999"] {
        let mesh = format!("<mesh name='m' {CORNERS} face='0 2 1 0 1 3 0 3 2 1 2 {corner}'/>");
        refused(&asset(&mesh), &["mesh", corner, "no vertex"]);
    }
    let good = asset(&format!("<mesh name='m' {CORNERS} face='0 2 1 0 1 3 0 3 2 1 2 3'/>"));
    Model::from_xml_string(&good).unwrap();
}

#[test]
fn options_with_which_the_first_step_never_ends_or_makes_no_sense() {
    let option = |attribute: &str| format!("<mujoco><option {attribute}/>{BODY}</mujoco>");
    for name in if cfg!(mujoco3) { ["ccd_iterations", "ccd_tolerance"] } else { ["mpr_iterations", "mpr_tolerance"] } {
        refused(&option(&format!("{name}='-1'")), &[name, "-1"]);
    }
    for name in ["iterations", "noslip_iterations"] {
        refused(&option(&format!("{name}='2000000000'")), &[name, "at most 100000"]);
    }
    for step in ["0", "-1", "nan", "inf", "-inf", " 0 "] {
        refused(&option(&format!("timestep='{step}'")), &["timestep", step, "finite and more than zero"]);
    }
    let text = "<mujoco><compiler><lengthrange inttotal='1e12'/></compiler></mujoco>";
    refused(text, &["lengthrange", "inttotal", "from 0 to 10000"]);
    Model::from_xml_string(&option("timestep='0.001' iterations='50' noslip_iterations='5'")).unwrap();
}

#[test]
fn what_is_included_or_escaped_is_looked_at_too() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    };
    let top = write("top.xml", &format!("<mujoco><include file='parts/one.xml'/>{BODY}</mujoco>"));
    write("parts/one.xml", "<mujoco>\n<include file='parts/two.xml'/>\n<include file='../top.xml'/></mujoco>");
    write("parts/two.xml", "<mujoco>\n\n<size nuser_body='20000&#48;0000'/></mujoco>");
    for error in [Model::from_xml_file(&top).unwrap_err(), Model::from_xml_file_with(&top, "<size/>").unwrap_err()] {
        let text = error.to_string();
        assert!(text.contains("two.xml") && text.contains("line 3") && text.contains("nuser_body"), "{text}");
    }
    let xml = format!("<mujoco><include file='two.xml'/>{BODY}</mujoco>");
    let error = Model::from_xml_with_assets(&xml, &[("two.xml", b"<mujoco><size nkey='2000000000'/></mujoco>")]);
    assert!(error.unwrap_err().to_string().contains("nkey"));
    let plain = write("plain.xml", &format!("<mujoco>{BODY}</mujoco>"));
    let error = Model::from_xml_file_with(&plain, "<size nkey='2000000000'/>").unwrap_err().to_string();
    assert!(error.contains("the added elements") && error.contains("nkey"), "{error}");
}

/// What 2.2.2 asks for the number of processors: many, so that its compiler would use threads on any machine.
#[cfg(not(mujoco3))]
#[allow(unsafe_code)] // a name that the loader looks up, and nothing else
#[unsafe(no_mangle)]
pub extern "C" fn get_nprocs() -> i32 {
    8
}

/// In a thread that looks for length ranges, a fault would print, wait for a key and exit.
#[test]
#[cfg(not(mujoco3))] // 3.x asks the system for the number of processors
fn a_fault_while_length_ranges_are_looked_for_is_a_load_error() {
    // The stack is enough for the compiler's own thread until the muscle's length is limited.
    let model = |stack: usize, muscles: usize| {
        let muscles = "<muscle joint='j'/>".repeat(muscles);
        format!(
            "<mujoco><size nstack='{stack}'/><worldbody><body><joint name='j' range='-1 1' limited='true'/>
             <geom size='.1' pos='.5 0 0'/></body></worldbody><actuator>{muscles}</actuator></mujoco>"
        )
    };
    if let Some(stack) = std::env::var_os("HOSTILE_MODELS_STACK") {
        let stack = stack.to_str().unwrap().parse().unwrap();
        match Model::from_xml_string(&model(stack, 8)) {
            Ok(model) => println!("loaded {} actuators", model.nu()),
            Err(error) => println!("refused: {error}"),
        }
        return;
    }
    let mut refused = 0;
    for stack in (0..16).map(|i| 8 << i) {
        let child = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "hostile_models::a_fault_while_length_ranges_are_looked_for_is_a_load_error",
                "--nocapture",
                "--quiet",
            ])
            .env("HOSTILE_MODELS_STACK", stack.to_string())
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let out = String::from_utf8_lossy(&child.stdout);
        assert!(child.status.success(), "stack {stack}: {:?} {out}", child.status);
        assert!(out.contains("loaded 8 actuators") || out.contains("Stack overflow"), "stack {stack}: {out}");
        refused += usize::from(out.contains("Stack overflow"));
    }
    assert!((1..16).contains(&refused), "{refused} were too small");
}

/// With an address space of 1 GB, 2 GB of user data do not fit: the compiler throws `std::bad_alloc`.
#[test]
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
fn a_cpp_exception_of_the_compiler_is_a_load_error() {
    if std::env::var_os("HOSTILE_MODELS_MEMORY").is_some() {
        let bodies = "<body><joint/><geom size='.1'/></body>".repeat(2500);
        let xml = format!("<mujoco><size nuser_body='100000'/><worldbody>{bodies}</worldbody></mujoco>");
        for _ in 0..2 {
            println!("{}", Model::from_xml_string(&xml).unwrap_err());
        }
        // The compiler's lock is free, though what it had allocated is lost.
        let _ = Model::from_xml_string(&format!("<mujoco>{BODY}</mujoco>"));
        println!("lives on");
        return;
    }
    let test = "hostile_models::a_cpp_exception_of_the_compiler_is_a_load_error";
    let child = Command::new("sh")
        .args(["-c", &format!("ulimit -v 1048576; exec \"$0\" --exact {test} --nocapture --quiet")])
        .arg(std::env::current_exe().unwrap())
        .env("HOSTILE_MODELS_MEMORY", "1")
        .output()
        .unwrap();
    let (out, err) = (String::from_utf8_lossy(&child.stdout), String::from_utf8_lossy(&child.stderr));
    assert!(out.contains("lives on"), "{:?} {out} {err}", child.status);
    assert_eq!(out.matches("needs more memory than there is").count(), 2, "{out}");
}

#[test]
fn mujocos_text_appears_once_and_in_one_line() {
    let text = Model::from_xml_string("<mujoco><worldbody><frob/></worldbody></mujoco>").unwrap_err().to_string();
    assert!(!text.contains('\n') && text.contains("frob"), "{text}");
    assert_eq!(text.matches("unrecognized element").count(), 1, "{text}");
    assert!(!text.contains("MUJOCO_DIR"), "no version knows it: {text}");
}

#[test]
#[cfg(not(mujoco3))]
fn what_only_mujoco_3_knows_says_how_to_build_with_it() {
    for xml in [
        "<mujoco><option integrator='implicitfast'/></mujoco>",
        "<mujoco><option><flag island='enable'/></option></mujoco>",
        "<mujoco><worldbody><frame pos='1 0 0'/></worldbody></mujoco>",
        "<mujoco><worldbody><flexcomp name='f'/></worldbody></mujoco>",
        "<mujoco><worldbody><body gravcomp='1'/></worldbody></mujoco>",
        "<mujoco><worldbody><attach model='m'/></worldbody></mujoco>",
        "<mujoco><size memory='1M'/></mujoco>",
    ] {
        refused(xml, &["this needs MuJoCo 3: build with MUJOCO_DIR="]);
    }
}
