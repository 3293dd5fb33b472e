//! What a saved state is good for beyond a replay at once: text without loss, another process, and what is refused.
#![cfg_attr(mujoco3, allow(unused_imports, dead_code))] // one test less

use crate::bits::{Format, bits, through};
use crate::claw::Claw;
use mujoco_grasp::grasp::{self, Error, Grasp, GraspId, GraspSpec, Grasps, GraspsState, Limits, Phase, Snapshot};
use mujoco_grasp::mujoco::{Clearance, GeomId, Model, PairCollider, Simulation, State};
use nalgebra::Vector3;
use proptest::prelude::*;
use serde_json::Value;
use std::process::Command;
use std::sync::OnceLock;

const DEFAULT_JOINT: &str = r#"<joint damping="0.05" armature="0"/>"#;
const FRICTION_LOSS: &str = r#"<joint damping="0.05" armature="0" frictionloss="0.003"/>"#;

/// `claw.xml` with other text in the place of some.
fn model(changes: &[(&str, &str)]) -> Model {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    let mut xml = std::fs::read_to_string(path).expect("the claw");
    for (from, to) in changes {
        assert!(xml.contains(from), "no {from} in claw.xml");
        xml = xml.replace(from, to);
    }
    Model::from_xml_string(&xml).expect("a model")
}

/// Latched, with joint friction beside the contacts, under a push.
fn held(model: &Model) -> Claw {
    let mut claw = Claw::closed_from(model, |_, _| {});
    claw.push(Vector3::new(1.5, 0.5, -2.0));
    claw.run(0.2);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    claw
}

fn fresh(model: &Model, change: impl Fn(&mut GraspSpec)) -> (Simulation, Grasps) {
    let sim = Simulation::new(model).expect("a simulation");
    let body = |name| sim.model().body(name).expect("a body");
    let mut spec = GraspSpec::new(body("object"), body("palm"));
    change(&mut spec);
    let grasps = Grasps::of(&sim, &spec).expect("a grasp");
    (sim, grasps)
}

fn numbers<'a>(value: &'a mut Value, out: &mut Vec<&'a mut Value>) {
    match value {
        Value::Number(n) if n.is_f64() => out.push(value),
        Value::Array(items) => items.iter_mut().for_each(|item| numbers(item, out)),
        Value::Object(fields) => fields.values_mut().for_each(|item| numbers(item, out)),
        _ => {}
    }
}

fn any_finite() -> impl Strategy<Value = f64> {
    any::<u64>().prop_map(f64::from_bits).prop_filter("finite", |x| x.is_finite())
}

/// The bits of every number in it, by a path that knows no text.
fn float_bits<T: serde::Serialize>(state: &T) -> Vec<u8> {
    let mut bytes = Vec::new();
    ciborium::into_writer(state, &mut bytes).expect("CBOR");
    bytes
}

/// A latched state, as JSON.
fn sample() -> &'static Value {
    static SAMPLE: OnceLock<Value> = OnceLock::new();
    SAMPLE.get_or_init(|| {
        let claw = held(&model(&[(DEFAULT_JOINT, FRICTION_LOSS)]));
        serde_json::to_value(claw.grasps.save()).expect("a value")
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn states_survive_text_bit_for_bit(time in any_finite(), values in proptest::collection::vec(any_finite(), 1..50)) {
        let mut state = State::default();
        state.time = time;
        state.qpos.clone_from(&values);
        state.qacc_warmstart.extend(values.iter().rev());
        state.eq_active = vec![0, 1];
        let text = serde_json::to_string(&state).expect("JSON");
        let read: State = serde_json::from_str(&text).expect("the same from JSON");
        prop_assert_eq!(float_bits(&read), float_bits(&state));

        let mut value = sample().clone();
        let mut places = Vec::new();
        numbers(&mut value, &mut places);
        prop_assert!(places.len() > 300, "{} numbers", places.len());
        for (place, x) in places.into_iter().zip(values.iter().cycle()) {
            *place = Value::from(*x);
        }
        let state: GraspsState = serde_json::from_value(value).expect("a state");
        let text = serde_json::to_string(&state).expect("JSON");
        let read: GraspsState = serde_json::from_str(&text).expect("the same from JSON");
        prop_assert_eq!(float_bits(&read), float_bits(&state));
    }
}

const CHILD: &str = "MUJOCO_GRASP_TEST_SNAPSHOT";

fn go_on(sim: &mut Simulation, grasps: &mut Grasps) -> Vec<Vec<u64>> {
    let one = |_| {
        grasps.step(sim).expect("a step");
        bits(sim, grasps)
    };
    (0..200).map(one).collect()
}

/// This test runs itself in a second process, which gets nothing but the file with the snapshot.
#[test]
fn another_process_goes_on_where_this_one_was() {
    let model = model(&[(DEFAULT_JOINT, FRICTION_LOSS)]);
    if let Some(path) = std::env::var_os(CHILD) {
        let snapshot: Snapshot = serde_json::from_slice(&std::fs::read(&path).expect("a file")).expect("a snapshot");
        let (mut sim, mut grasps) = fresh(&model, |_| {});
        snapshot.restore(&mut sim, &mut grasps).expect("a restored state");
        let replay = serde_json::to_vec(&go_on(&mut sim, &mut grasps)).expect("JSON");
        std::fs::write(path, replay).expect("a written file");
        return;
    }
    let mut claw = held(&model);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("snapshot.json");
    std::fs::write(&path, serde_json::to_vec(&Snapshot::take(&claw.sim, &claw.grasps)).expect("JSON")).expect("a file");
    let here = go_on(&mut claw.sim, &mut claw.grasps);
    let child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "saved_state::another_process_goes_on_where_this_one_was"])
        .env(CHILD, &path)
        .output()
        .expect("a second process");
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
    let there: Vec<Vec<u64>> = serde_json::from_slice(&std::fs::read(&path).expect("a file")).expect("bits");
    assert!(here == there, "the second process computes something else");
}

/// Whether MuJoCo's collision stage is left out of a step depends on what the grasp measured long before, which is not
/// saved. Here something beside the hand hits the floor at times, and a grasp that is restored into a fresh one before every
/// step decides otherwise after that than one that goes on: the bits are the same.
#[test]
#[cfg(not(mujoco3))] // there the stage is never left out
fn a_collision_stage_left_out_or_not_gives_the_same_bits() {
    let bystander = r#"<body pos="0.5 0 0.08"><joint type="slide" axis="0 0 1" stiffness="50" damping="0.05"/>
      <geom size="0.02" mass="0.05"/></body></worldbody>"#;
    let model = model(&[("</worldbody>", bystander), (r#"0 0 0.3 1 0 0 0""#, r#"0 0 0.3 1 0 0 0 0""#)]);
    let mut claw = Claw::closed_from(&model, |_, _| {});
    let bystander = claw.sim.model().nv() - 1;
    claw.run(0.2);
    let (hand, target) = geoms(&claw.sim);
    let watch = |sim: &Simulation| {
        Clearance::new(sim, &PairCollider::new(sim, &hand, &target).expect("a collider")).expect("of one model")
    };
    // as in the grasp, from the step on in which it latched
    let mut going_on = watch(&claw.sim);
    let mut decisions = [[0; 2]; 2];
    for k in 0..1500 {
        if k % 150 == 0 {
            claw.sim.qvel_mut()[bystander] = -3.0;
        }
        claw.push(Vector3::new(0.0, 0.0, -7.0 * (0.01 * k as f64).sin()));
        let snapshot = Snapshot::take(&claw.sim, &claw.grasps);
        let (mut sim, mut grasps) = fresh(&model, |_| {});
        snapshot.restore(&mut sim, &mut grasps).expect("a restored state");
        grasps.step(&mut sim).expect("a step");
        claw.step();
        let left_out = [watch(&sim).certifies(&sim), going_on.certifies(&claw.sim)];
        let [fresh, going_on] = left_out.map(|certain| usize::from(certain.expect("an answer")));
        decisions[fresh][going_on] += 1;
        assert!(bits(&sim, &grasps) == bits(&claw.sim, &claw.grasps), "step {k}: {fresh} {going_on}");
    }
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    println!("the stage was left out of {} steps by both, of {} by one", decisions[1][1], decisions[1][0]);
    assert!(decisions[1][1] > 200 && decisions[1][0] > 20, "{decisions:?}");
}

/// Of the hand and of the target.
fn geoms(sim: &Simulation) -> (Vec<GeomId>, Vec<GeomId>) {
    let model = sim.model();
    let below = |name| {
        let bodies = model.subtree(model.body(name).expect("a body")).expect("a tree");
        let of = |geom: &GeomId| bodies.iter().any(|body| body.index() as i32 == model.geom_bodyid()[geom.index()]);
        model.geoms().filter(of).collect()
    };
    (below("palm"), below("object"))
}

/// A grasp that was latched before and one that never was latch alike.
#[test]
fn a_release_forgets_the_last_latched_step() {
    for limits in [Limits::Cones, Limits::Box] {
        let model = Model::from_xml_file_with(
            format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR")),
            &grasp::weld_xml("object", None),
        )
        .expect("the claw");
        let mut claw = Claw::closed_from(&model, |sim, spec| {
            spec.limits = limits;
            sim.dof_frictionloss_mut()[1..20].fill(0.003);
        });
        claw.run(0.2);
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        claw.grasps[GraspId::FIRST].release();
        claw.grasps.restore_settings(&mut claw.sim).expect("the user's settings");
        let spec = |spec: &mut GraspSpec| spec.limits = limits;
        let mut other = claw.clone();
        other.grasps = fresh(&model, spec).1;
        for k in 0..100 {
            claw.step();
            other.step();
            assert!(bits(&claw.sim, &claw.grasps)[1..] == bits(&other.sim, &other.grasps)[1..], "{limits:?}: step {k}");
        }
        assert_eq!(claw.grasp().phase(), Phase::Grasped);
        assert_eq!(claw.grasps.save(), other.grasps.save());
    }
}

/// Refuses with a message that has `says` in it, and changes nothing.
#[track_caller]
fn refused(snapshot: &Snapshot, (sim, grasps): (&mut Simulation, &mut Grasps), says: &str) {
    let before = Snapshot::take(sim, grasps);
    let error = snapshot.restore(sim, grasps).expect_err("an error");
    assert!(error.to_string().contains(says), "\"{error}\" does not say \"{says}\"");
    assert_eq!(Snapshot::take(sim, grasps), before, "something was changed");
}

#[test]
fn states_of_something_else_are_refused() {
    let plain = model(&[]);
    let mut claw = held(&plain);
    let snapshot = Snapshot::take(&claw.sim, &claw.grasps);
    let no_ball = r#"<geom name="f0_3" class="link""#;
    let other_models = [
        (vec![(no_ball, r#"<geom class="link" fromto="0 0 0 0 0 -0.01"/><geom name="f0_3" class="link""#)], "geoms"),
        (vec![(r#"<geom name="palm" type="cylinder""#, r#"<geom name="palm" type="capsule""#)], "structure"),
    ];
    for (changes, says) in other_models {
        let (mut sim, mut grasps) = fresh(&model(&changes), |_| {});
        refused(&snapshot, (&mut sim, &mut grasps), says);
    }
    type Change = Box<dyn Fn(&mut GraspSpec)>;
    let mut specs: Vec<(&str, Change)> = vec![
        ("latch_quality", Box::new(|spec| spec.latch_quality = Some(0.123))),
        ("latch_time", Box::new(|spec| spec.latch_time = 0.1)),
    ];
    let tips: Vec<_> = ["f0_3", "f1_3", "f2_3"].map(|name| claw.sim.model().body(name).expect("a link")).into();
    specs.push(("effectors", Box::new(move |spec| spec.effectors.clone_from(&tips))));
    for (says, change) in specs {
        let (mut sim, mut grasps) = fresh(&plain, change);
        refused(&snapshot, (&mut sim, &mut grasps), says);
    }
    let (mut sim, _) = fresh(&plain, |_| {});
    refused(&snapshot, (&mut sim, &mut Grasps::new()), "number of grasps");
    let mut short = snapshot.clone();
    short.sim.qpos.pop();
    refused(&short, (&mut claw.sim, &mut claw.grasps), "qpos");
    let mut infinite = snapshot.clone();
    infinite.sim.ctrl[3] = f64::NAN;
    refused(&infinite, (&mut claw.sim, &mut claw.grasps), "ctrl of the state is NaN");
}

/// Damaged files: a number that none is, a geom that is not there, parts that do not go together.
#[test]
fn damaged_states_are_refused() {
    let model = model(&[(DEFAULT_JOINT, FRICTION_LOSS)]);
    let mut claw = held(&model);
    let sound = serde_json::to_value(claw.grasps.save()).expect("a value");
    let mut restore = |damage: &dyn Fn(&mut Value)| {
        let mut value = sound.clone();
        damage(&mut value);
        let state: GraspsState = serde_json::from_value(value).expect("a state");
        let before = claw.grasps.save();
        let result = claw.grasps.restore(&state);
        assert!(result.is_ok() || claw.grasps.save() == before, "something was changed");
        result
    };
    assert!(restore(&|_| {}).is_ok());
    type Damage<'a> = (&'a str, &'a dyn Fn(&mut Value));
    let damages: [Damage; 7] = [
        ("time of good", &|state| state["grasps"][0]["counted"] = Value::from(-1.0)),
        ("contacts", &|state| state["grasps"][0]["contacts"][0]["geoms"][1] = Value::from(9999)),
        ("constraints", &|state| state["grasps"][0]["coupled"][0]["rows"] = Value::from(7)),
        ("constraints", &|state| state["grasps"][0]["coupled"][0]["rows"] = Value::from(0)),
        ("memory", &|state| state["grasps"][0]["phase"] = Value::from("ungrasped")),
        ("merged", &|state| {
            let zero = serde_json::json!([0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
            state["grasps"][0]["merged"] = serde_json::json!({
                "contacts": [], "wrench": zero, "bounds": { "force": 0.0, "torque": 0.0 },
                "soft": {
                    "position": [0.0, 0.0, 0.0], "orientation": [0.0, 0.0, 0.0, 1.0], "yielded": zero, "preload": zero,
                    "solref": [0.02, 1.0], "solimp": [0.9, 0.95, 0.001, 0.5, 2.0]
                }
            });
        }),
        ("settings", &|state| {
            state["settings"] = serde_json::json!({ "noslip_iterations": 3, "jacobian": { "other": 99 } });
        }),
    ];
    for (says, damage) in damages {
        match restore(damage) {
            Err(error @ Error::BadState(_)) => assert!(error.to_string().contains(says), "{error}"),
            other => panic!("{says}: {other:?}"),
        }
    }
    // infinity has no JSON, but other formats have it
    let mut bytes = Vec::new();
    ciborium::into_writer(&claw.grasps.save(), &mut bytes).expect("CBOR");
    let mut value: ciborium::Value = ciborium::from_reader(bytes.as_slice()).expect("a value");
    let fields = value.as_map_mut().expect("fields");
    let list = fields.iter_mut().find(|(key, _)| key.as_text() == Some("grasps")).expect("a list");
    let fields = list.1.as_array_mut().expect("grasps")[0].as_map_mut().expect("fields");
    let warm = fields.iter_mut().find(|(key, _)| key.as_text() == Some("warm_start")).expect("a warm start");
    warm.1.as_array_mut().expect("passes")[0].as_array_mut().expect("numbers")[0] =
        ciborium::Value::Float(f64::INFINITY);
    let state: GraspsState = value.deserialized().expect("a state");
    assert!(matches!(claw.grasps.restore(&state), Err(Error::BadState("warm start"))));
}

/// The settings that a merged grasp changes are given back, whichever way its state has come.
#[test]
fn settings_come_back_after_a_restored_merged_grasp() {
    let path = format!("{}/tests/data/claw.xml", env!("CARGO_MANIFEST_DIR"));
    let model = Model::from_xml_file_with(path, &grasp::weld_xml("object", None)).expect("the claw");
    let user = Simulation::new(&model).expect("a simulation").model().noslip_iterations();
    let spec = |spec: &mut GraspSpec| spec.limits = Limits::Box;
    let mut claw = Claw::closed_from(&model, |_, s| spec(s));
    let ungrasped = Snapshot::take(&claw.sim, &claw.grasps);
    claw.run(0.2);
    assert_eq!((claw.grasp().phase(), claw.sim.model().noslip_iterations()), (Phase::Grasped, 0));
    let latched = through(Format::Json, &Snapshot::take(&claw.sim, &claw.grasps));

    // into a fresh simulation, a copy of this one with a new grasp, and this one itself
    let (mut sim, mut grasps) = fresh(&model, spec);
    latched.restore(&mut sim, &mut grasps).expect("a restored state");
    grasps.step(&mut sim).expect("a step");
    assert_eq!(sim.model().noslip_iterations(), 0);
    let copy = (claw.sim.clone(), fresh(&model, spec).1);
    for (mut sim, mut grasps) in [(sim, grasps), copy] {
        latched.restore(&mut sim, &mut grasps).expect("a restored state");
        grasps[GraspId::FIRST].release();
        grasps.step(&mut sim).expect("a step");
        assert_eq!(sim.model().noslip_iterations(), user);
    }
    ungrasped.restore(&mut claw.sim, &mut claw.grasps).expect("a restored state");
    claw.step();
    assert_eq!(claw.sim.model().noslip_iterations(), user);
}

#[test]
fn what_users_hold_can_change_threads() {
    fn sends<T: Send + std::fmt::Debug>() {}
    fn shares<T: Send + Sync + Clone + std::fmt::Debug>() {}
    fn error<T: std::error::Error + Send + Sync + 'static>() {}
    sends::<Simulation>();
    shares::<Model>();
    shares::<Grasp>();
    shares::<GraspSpec>();
    shares::<Snapshot>();
    error::<Error>();
    error::<mujoco_grasp::mujoco::Error>();
    error::<mujoco_grasp::scenario::Error>();
}
