//! Islands and sleeping (MuJoCo 3) are the model's own affair: only a step with a latched grasp goes without.

use crate::bits::bits;
use crate::claw::Claw;
use mujoco_grasp::grasp::{GraspId, Grasps, Phase};
use mujoco_grasp::mujoco::{Model, Simulation};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};

/// A stack, a box beside it, and one that leans on nothing: islands of their own.
const BOXES: &str = "
    <body name='low' pos='.3 0 .03'><freejoint/><geom type='box' size='.03 .03 .03' mass='.1'/></body>
    <body name='high' pos='.31 0 .092'><freejoint/><geom type='box' size='.03 .03 .03' mass='.3'/></body>
    <body name='alone' pos='0 .3 .05'><freejoint/><geom type='box' size='.03 .02 .04' mass='.1'/></body>
  </worldbody>";

/// The claw beside the boxes, with a solver that stops early and the flags of `flags`.
fn claw_and_boxes(iterations: usize, flags: &str) -> String {
    let claw = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/claw.xml")).unwrap();
    let key = claw.find("0 0 0.3 1 0 0 0\"").expect("the keyframe's ball") + "0 0 0.3 1 0 0 0".len();
    let boxes = " .3 0 .03 1 0 0 0 .31 0 .092 1 0 0 0 0 .3 .05 1 0 0 0";
    let (before, after) = claw.split_at(key);
    let option =
        format!("<option iterations=\"{iterations}\" timestep=\"0.002\" cone=\"elliptic\"><flag {flags}/></option>");
    format!("{before}{boxes}{after}")
        .replace("<option timestep=\"0.002\" cone=\"elliptic\" noslip_iterations=\"50\"/>", &option)
        .replace("</worldbody>", BOXES)
}

/// What MuJoCo 3 knows besides.
const SLEEP: &str = if cfg!(mj_sleep) { "energy='enable' fwdinv='enable' sleep='enable'" } else { "fwdinv='enable'" };

fn model(iterations: usize, flags: &str) -> Model {
    Model::from_xml_string(&claw_and_boxes(iterations, flags)).unwrap()
}

fn flags(sim: &Simulation) -> (u32, u32) {
    (sim.model().disable_flags(), sim.model().enable_flags())
}

#[test]
fn full_mode_with_few_iterations_is_the_users_mujoco() {
    let folder = tempfile::tempdir().unwrap();
    let toml = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/claw.toml")).unwrap();
    std::fs::write(folder.path().join("claw.xml"), claw_and_boxes(1, "energy='enable'")).unwrap();
    std::fs::write(folder.path().join("claw.toml"), toml.replace("pin_until = 2.0", "pin_until = 0.0")).unwrap();
    let plan = Plan::load(folder.path().join("claw.toml").to_str().unwrap()).unwrap();
    let mut full = Runner::new(&plan, Mode::Full, None).unwrap();
    let start = |flags: &str| {
        let mut sim = Simulation::new(&model(1, flags)).unwrap();
        let key = sim.model().keyframe("open").unwrap();
        sim.reset_to_keyframe(key).unwrap();
        sim
    };
    let mut plain = start("energy='enable'");
    let mut joined = start(if cfg!(mujoco3) { "energy='enable' island='disable'" } else { "energy='enable'" });
    assert_eq!(plain.model().has_islands(), cfg!(mujoco3), "the scene says nothing about islands");
    assert_eq!(flags(full.sim()), flags(&plain));
    assert!(!joined.model().has_islands());
    for step in 0..1500 {
        full.step().unwrap();
        for sim in [&mut plain, &mut joined] {
            sim.ctrl_mut().copy_from_slice(full.sim().ctrl());
            sim.step().unwrap();
        }
        assert!(bits(full.sim(), &Grasps::new()) == bits(&plain, &Grasps::new()), "step {step}");
    }
    assert_eq!(flags(full.sim()), flags(&plain));
    assert_eq!(
        bits(&plain, &Grasps::new()) != bits(&joined, &Grasps::new()),
        cfg!(mujoco3),
        "islands must matter here, or nothing was shown"
    );
}

#[test]
fn before_the_first_latch_a_grasp_step_is_mujocos_bit_for_bit() {
    for options in ["energy='enable'", SLEEP] {
        let mut claw = Claw::closed_from(&model(2, options), |_, spec| spec.latch_time = 0.2);
        let mut plain = claw.sim.clone();
        let mut steps = 0;
        while claw.grasp().phase() == Phase::Ungrasped {
            claw.step();
            plain.step().unwrap();
            assert!(bits(&claw.sim, &Grasps::new()) == bits(&plain, &Grasps::new()), "{options}: step {steps}");
            steps += 1;
            assert!(steps < 1000, "{options}: it never latched");
        }
        assert!(steps > 50, "{options}: {steps} steps are too few to tell");
        // and from the start: the hand's own grasp may not latch
        let fresh = || {
            let mut sim = Simulation::new(&model(2, options)).unwrap();
            let key = sim.model().keyframe("open").unwrap();
            sim.reset_to_keyframe(key).unwrap();
            sim
        };
        let (mut stepped, mut plain) = (fresh(), fresh());
        claw.grasps[GraspId::FIRST].release();
        claw.grasps[GraspId::FIRST].allow_latch(false);
        for step in 0..1000 {
            claw.grasps.step(&mut stepped).unwrap();
            plain.step().unwrap();
            assert!(
                bits(&stepped, &Grasps::new()) == bits(&plain, &Grasps::new()),
                "{options}: step {step} from the start"
            );
        }
    }
}

#[test]
fn a_latched_step_leaves_the_users_flags() {
    let mut claw = Claw::closed_from(&model(50, SLEEP), |_, _| {});
    let users = flags(&claw.sim);
    assert_eq!(claw.sim.model().has_sleeping(), cfg!(mj_sleep));
    let mut latched = 0;
    for _ in 0..300 {
        claw.step();
        assert_eq!(flags(&claw.sim), users);
        latched += usize::from(claw.grasp().phase() == Phase::Grasped);
    }
    assert!(latched > 200, "{latched}");
    claw.sim.ctrl_mut()[0] = f64::NAN;
    claw.try_step().unwrap_err();
    assert_eq!(flags(&claw.sim), users, "after an error");
}

/// Trees that slept before the latch are awake while it lasts, stay where they are, and sleep again after it.
#[test]
#[cfg(mj_sleep)]
fn what_sleeps_is_awake_while_a_grasp_is_latched() {
    let mut claw = Claw::closed_from(&model(50, SLEEP), |_, _| {});
    let alone = claw.sim.model().body("alone").unwrap();
    let dof = claw.sim.model().body_dofadr()[alone.index()] as usize;
    let asleep = |sim: &Simulation| sim.qvel()[dof..dof + 6].iter().all(|v| *v == 0.0);
    assert!(asleep(&claw.sim), "the box should sleep after three seconds");
    let place = claw.sim.body_position(alone);
    claw.run(0.5);
    assert_eq!(claw.grasp().phase(), Phase::Grasped);
    assert!(!asleep(&claw.sim), "a latched step has everything awake");
    assert!((claw.sim.body_position(alone) - place).norm() < 1e-4);
    claw.open();
    claw.run(2.0);
    assert_eq!(claw.grasp().phase(), Phase::Ungrasped);
    assert!(asleep(&claw.sim), "it sleeps again");
    assert!((claw.sim.body_position(alone) - place).norm() < 1e-4);
}
