//! The numbers of the built-in models, read from the compiled models.

use mujoco_grasp::mujoco::{GeomKind, Model};

const FINGERS: [&str; 5] = ["thumb", "index", "middle", "ring", "little"];

fn load(file: &str) -> Model {
    Model::from_xml_file(format!("{}/models/{file}", env!("CARGO_MANIFEST_DIR"))).expect("a built-in model")
}

fn close(value: f64, expected: f64, what: &str) {
    assert!((value - expected).abs() < 1e-6 * expected.abs().max(1.0), "{what} is {value}, not {expected}");
}

#[test]
fn humanoid_has_63_joint_degrees_of_freedom_and_a_fixed_pelvis() {
    for file in ["clutch.xml", "pinch.xml", "carry.xml"] {
        let model = load(file);
        assert_eq!(model.nv(), 63 + 6, "{file}: 63 and the free target");
        let pelvis = model.body("pelvis").expect("pelvis");
        assert_eq!(model.body_dofnum()[pelvis.index()], 0);
        assert_eq!(model.body_weldid()[pelvis.index()], 0, "the pelvis is welded to the world");
    }
}

/// Thesis section 5.1.
#[test]
fn arm_palm_and_fingers_have_the_masses_of_the_thesis() {
    let model = load("clutch.xml");
    let body = |name: &str| model.body(name).expect("a body").index();
    for side in ["right", "left"] {
        close(model.body_subtreemass()[body(&format!("{side}_upper_arm"))], 5.45, "arm with hand [kg]");
    }
    let palm = body("palm");
    close(model.body_mass()[palm], 0.25, "palm [kg]");
    assert_eq!(model.body_geomnum()[palm], 2, "the palm is two boxes");
    let kind = |g: usize| model.geom_kind(model.geoms().nth(g).expect("a geom")).expect("a kind");
    let first = model.body_geomadr()[palm] as usize;
    assert!((first..first + 2).all(|g| kind(g) == GeomKind::Box));
    for finger in FINGERS {
        for segment in 1..=3 {
            let link = body(&format!("{finger}_{segment}"));
            close(model.body_mass()[link], 0.02, "phalanx [kg]");
            assert_eq!(model.body_geomnum()[link], 1);
            assert_eq!(kind(model.body_geomadr()[link] as usize), GeomKind::Capsule);
        }
        close(model.body_subtreemass()[body(&format!("{finger}_1"))], 0.06, "finger [kg]");
        let tip = model.site(&format!("{finger}_tip")).expect("a fingertip site");
        assert_eq!(model.site_bodyid()[tip.index()] as usize, body(&format!("{finger}_3")));
    }
}

/// Thesis section 5.1: 0.250 N m/rad and 0.05 N m s/rad on each finger joint.
#[test]
fn finger_joints_have_the_stiffness_and_damping_of_the_thesis() {
    let model = load("clutch.xml");
    let mut joints = 0;
    for joint in model.joints() {
        let body = model.jnt_bodyid()[joint.index()] as usize;
        let name = model.body_name(model.bodies().nth(body).expect("a body")).unwrap_or_default().to_owned();
        if !FINGERS.iter().any(|f| name.starts_with(&format!("{f}_"))) {
            continue;
        }
        joints += 1;
        close(model.dof_damping()[model.jnt_dofadr()[joint.index()] as usize], 0.05, "damping [N m s/rad]");
        let actuator = (0..model.nu())
            .find(|&a| model.actuator_trnid()[2 * a] as usize == joint.index())
            .expect("a position actuator for each finger joint");
        let stride = model.actuator_biasprm().len() / model.nu();
        close(model.actuator_gainprm()[stride * actuator], 0.25, "stiffness [N m/rad]");
        close(model.actuator_biasprm()[stride * actuator + 1], -0.25, "stiffness [N m/rad]");
    }
    assert_eq!(joints, 20);
}

#[test]
fn targets_are_a_ball_of_200_g_and_a_phone_of_100_g_with_goal_sites() {
    for (file, target, mass, kind, goals) in [
        ("clutch.xml", "ball", 0.2, GeomKind::Sphere, &FINGERS[..]),
        ("pinch.xml", "phone", 0.1, GeomKind::Box, &FINGERS[..2]),
    ] {
        let model = load(file);
        let body = model.body(target).expect("the target");
        close(model.body_mass()[body.index()], mass, "target [kg]");
        assert!(model.free_joint_of(body).is_some());
        let geom = model.geoms().nth(model.body_geomadr()[body.index()] as usize).expect("a geom");
        assert_eq!(model.geom_kind(geom), Some(kind));
        let named = |prefix: &str| {
            model.sites().filter(|&s| model.site_name(s).is_some_and(|name| name.starts_with(prefix))).count()
        };
        assert_eq!(named("goal_"), goals.len());
        for finger in goals {
            let site = model.site(&format!("goal_{finger}")).expect("a goal site");
            assert_eq!(model.site_bodyid()[site.index()] as usize, body.index());
        }
    }
    // the pinch's goals lie opposite each other, through the centre of mass
    let model = load("pinch.xml");
    for finger in ["thumb", "index"] {
        let site = model.site(&format!("goal_{finger}")).expect("a goal site").index();
        let [x, _, z] = [0, 1, 2].map(|k| model.site_pos()[3 * site + k]);
        assert!(x.hypot(z) < 1e-3, "goal_{finger} is {} m beside the centre", x.hypot(z));
    }
}

/// Ours: models/README.md.
#[test]
fn carry_has_a_bottle_of_150_g_on_four_feet_that_only_it_makes_contacts_with() {
    let model = load("carry.xml");
    let bottle = model.body("bottle").expect("the bottle");
    close(model.body_mass()[bottle.index()], 0.15, "bottle [kg]");
    assert!(model.free_joint_of(bottle).is_some());
    let first = model.body_geomadr()[bottle.index()] as usize;
    let kinds = (first..first + model.body_geomnum()[bottle.index()] as usize).map(|g| {
        let geom = model.geoms().nth(g).expect("a geom");
        model.geom_kind(geom).expect("a kind")
    });
    let expected = [GeomKind::Capsule, GeomKind::Sphere, GeomKind::Sphere, GeomKind::Sphere, GeomKind::Sphere];
    assert_eq!(kinds.collect::<Vec<_>>(), expected);
    // table and block belong to the world, and only the bottle has contype 1
    for (g, &contype) in model.geom_contype().iter().enumerate() {
        assert_eq!(contype == 1, model.geom_bodyid()[g] as usize == bottle.index(), "geom {g}");
    }
    // as they stand in the keyframe: the bottle upright, its feet on the table
    let height = model.key_qpos()[model.key_qpos().len() - 5];
    assert!((height - (1.05 + 0.08)).abs() < 1e-4, "the bottle's middle is at {height} m");
}

/// The whole man: 73.0 kg of de Leva (1996), within what the thesis's own arms and hands change.
#[test]
fn humanoid_is_an_average_adult_male() {
    let model = load("clutch.xml");
    let pelvis = model.body("pelvis").expect("pelvis").index();
    let mass = model.body_subtreemass()[pelvis];
    assert!((70.0..78.0).contains(&mass), "{mass} kg");
}
