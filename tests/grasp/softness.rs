//! The grasp's contact softness against the engine's own rows: `R`, stiffness, damping, reference acceleration and
//! force, contact by contact, on random scenes. What the grasp layer replaces has to be what MuJoCo solves.

use mujoco_grasp::grasp::contact::cost::{ActiveSet, Cost};
use mujoco_grasp::grasp::contact::softness::{ConeKind, Softness, SolverOptions, softness};
use mujoco_grasp::grasp::{GraspContact, GraspId, GraspSpec, Grasps};
use mujoco_grasp::mujoco::{Cone, Contact, DISABLE_REFSAFE, JacobianStorage, Model, Simulation, Solver};
use proptest::prelude::Rng;
use proptest::test_runner::{RngAlgorithm, TestRng};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Relative to the largest term of what is compared.
const EXACT: f64 = 1e-12;

struct Dice(TestRng);

impl Dice {
    fn new(seed: u64) -> Self {
        let mut bytes = [3u8; 32];
        bytes[..8].copy_from_slice(&seed.to_le_bytes());
        Dice(TestRng::from_seed(RngAlgorithm::ChaCha, &bytes))
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.0.next_u32()) / f64::from(u32::MAX)
    }

    /// Evenly distributed in the logarithm.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    fn flip(&mut self) -> bool {
        self.0.next_u32().is_multiple_of(2)
    }

    fn one_of<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.0.next_u32() as usize % items.len()]
    }

    /// `solref` in one of its two formats, or wrongly a mixture of both, which the engine replaces by its default.
    fn solref(&mut self) -> String {
        let kind = self.uniform(0.0, 1.0);
        if kind < 0.05 {
            format!("{} {}", self.scale(5e-4, 0.1), -self.scale(0.1, 500.0))
        } else if kind < 0.5 {
            format!("{} {}", self.scale(5e-4, 0.1), self.scale(0.1, 3.0))
        } else {
            format!("{} {}", -self.scale(1.0, 5e4), -self.scale(0.1, 500.0))
        }
    }

    /// `solimp`, values beyond the engine's clamps among them.
    fn solimp(&mut self) -> String {
        let [low, high] = [self.one_of(&[0.0, 0.2, 0.6, 0.9]), self.one_of(&[0.5, 0.9, 0.95, 1.0])];
        let width = self.one_of(&[0.0, 0.001, 0.004, 0.02]);
        format!("{low} {high} {width} {} {}", self.uniform(0.0, 1.0), self.one_of(&[0.5, 1.0, 2.0, 3.3]))
    }
}

/// Half of the target's size [m].
const TARGET: f64 = 0.03;
const LINK: f64 = 0.01;
const FACES: [[f64; 3]; 6] = [[1., 0., 0.], [-1., 0., 0.], [0., 1., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]];

/// Contact attributes that geoms and pairs share.
fn contact_attributes(dice: &mut Dice) -> String {
    format!(
        r#"condim="{}" solref="{}" solimp="{}" margin="{}" gap="{}""#,
        dice.one_of(&[1, 3, 4, 6]),
        dice.solref(),
        dice.solimp(),
        dice.uniform(0.0, 0.006),
        dice.uniform(0.0, 0.003)
    )
}

/// A ball or box, with a link of some shape near each of its six sides, touching or almost.
fn scene(dice: &mut Dice) -> String {
    let cone = dice.one_of(&["elliptic", "pyramidal"]);
    let refsafe = dice.one_of(&["enable", "disable"]);
    let replace = if dice.uniform(0.0, 1.0) < 0.2 {
        let margin = dice.uniform(0.0, 0.005);
        format!(r#"o_margin="{margin}" o_solref="{}" o_solimp="{}""#, dice.solref(), dice.solimp())
    } else {
        String::new()
    };
    let flag = if replace.is_empty() { "disable" } else { "enable" };
    let mut links = String::new();
    let mut pairs = String::new();
    let palm_moves = dice.flip();
    for (i, face) in FACES.iter().enumerate() {
        // a plane cannot move, and more than one overflow the engine's broad phase
        let plane = i == 4 && !palm_moves;
        let shape = if plane { "plane" } else { dice.one_of(&["sphere", "box", "capsule"]) };
        let gap = dice.uniform(-0.004, 0.004) + if plane { 0.0 } else { LINK };
        let at: Vec<f64> = face.iter().map(|x| x * (TARGET + gap)).collect();
        let size = match shape {
            "box" => format!("{LINK} {LINK} {LINK}"),
            "capsule" => format!("{LINK} 0.02"),
            "plane" => "1 1 1".to_owned(),
            _ => format!("{LINK}"),
        };
        // the geom's z axis looks at the target
        let inward: Vec<f64> = face.iter().map(|x| -x + 0.0).collect();
        let tilt = if plane { 0.0 } else { dice.uniform(-0.1, 0.1) };
        let explicit = dice.flip();
        let attributes = contact_attributes(dice);
        let own = if explicit {
            let mu: Vec<String> = (0..5).map(|_| dice.scale(1e-3, 2.0).to_string()).collect();
            let link = format!("g{i}");
            let [first, second] = if dice.flip() { ["target", &link] } else { [&link, "target"] };
            writeln!(pairs, r#"<pair geom1="{first}" geom2="{second}" friction="{}" {attributes}/>"#, mu.join(" "))
                .unwrap();
            String::new()
        } else {
            let mu = [dice.scale(0.1, 2.0), dice.scale(1e-3, 0.1), dice.scale(1e-4, 0.01)];
            format!(r#"conaffinity="1" friction="{} {} {}" {attributes} priority="{}""#, mu[0], mu[1], mu[2], i % 3)
        };
        let joint = if plane { "" } else { r#"<joint axis="0.3 0.5 0.7" pos="0.01 0.04 -0.02" armature="1e-3"/>"# };
        writeln!(
            links,
            r#"<body name="link{i}" pos="{} {} {}">{joint}<geom name="g{i}" type="{shape}" size="{size}" zaxis="{} {} {}" mass="{}" {own}/></body>"#,
            at[0], at[1], at[2], inward[0] + tilt, inward[1], inward[2] + 0.5 * tilt, dice.scale(0.005, 0.5)
        )
        .unwrap();
    }
    let shape = dice.one_of(&["sphere", "box"]);
    let target = contact_attributes(dice);
    let slide = if palm_moves { r#"<joint type="slide" axis="0 0 1"/><geom size="0.02" pos="0 0 0.3"/>"# } else { "" };
    let (impratio, timestep) = (dice.scale(0.1, 30.0), dice.scale(5e-4, 0.01));
    format!(
        r#"<mujoco><option timestep="{timestep}" cone="{cone}" impratio="{impratio}" iterations="200" {replace}>
<flag refsafe="{refsafe}" override="{flag}"/></option><default><geom contype="0" conaffinity="0"/></default>
<worldbody><body name="palm">{slide}{links}</body><body name="target"><freejoint/>
<geom name="target" type="{shape}" size="{TARGET} {TARGET} {TARGET}" mass="{}" contype="1" {target}/></body></worldbody>
<contact>{pairs}</contact></mujoco>"#,
        dice.scale(0.02, 2.0)
    )
}

fn simulation(dice: &mut Dice, xml: &str) -> Simulation {
    let mut sim = Simulation::new(&Model::from_xml_string(xml).unwrap_or_else(|e| panic!("{e}\n{xml}"))).unwrap();
    sim.set_solver(dice.one_of(&[Solver::Newton, Solver::Newton, Solver::Pgs, Solver::Cg])).unwrap();
    sim.set_jacobian_storage(dice.one_of(&[JacobianStorage::Dense, JacobianStorage::Sparse])).unwrap();
    for v in sim.qvel_mut() {
        *v = dice.uniform(-1.0, 1.0);
    }
    sim.forward().unwrap();
    sim
}

fn options(sim: &Simulation) -> SolverOptions {
    let model = sim.model();
    SolverOptions {
        timestep: model.timestep(),
        refsafe: model.disable_flags() & DISABLE_REFSAFE == 0,
        impratio: model.impratio(),
        cone: if model.cone() == Cone::Elliptic { ConeKind::Elliptic } else { ConeKind::Pyramidal },
    }
}

#[track_caller]
fn assert_exact(what: &str, ours: f64, engine: f64, scale: f64, context: &dyn Fn() -> String) {
    let error = (ours - engine).abs();
    assert!(error <= EXACT * scale.abs().max(engine.abs()), "{what}: {ours:e} is not {engine:e}\n{}", context());
}

/// The regularisation of the engine's rows that a law stands for.
fn regularisations(law: &Cost, rows: usize) -> Vec<f64> {
    match *law {
        Cost::Unilateral { stiffness } | Cost::Pyramidal { stiffness, .. } => vec![1.0 / stiffness; rows],
        Cost::Elliptic { stiffness, cone, friction } => {
            let friction_row = |j: usize| cone * cone / (friction[j] * friction[j]);
            (0..rows).map(|j| if j == 0 { 1.0 } else { friction_row(j - 1) } / stiffness).collect()
        }
        Cost::Slip { .. } | Cost::Bounded { .. } | Cost::Still => {
            panic!("not the law of a contact in MuJoCo's main solve")
        }
    }
}

/// Rows that the engine makes for a contact.
fn row_count(condim: usize, cone: ConeKind) -> usize {
    match (condim, cone) {
        (1, _) => 1,
        (_, ConeKind::Pyramidal) => 2 * (condim - 1),
        (_, ConeKind::Elliptic) => condim,
    }
}

fn assert_rows(sim: &Simulation, contact: &Contact, soft: &Softness, cone: ConeKind, context: &dyn Fn() -> String) {
    let first = contact.efc_address.expect("a contact in the solve has rows");
    let rows = row_count(contact.condim, cone);
    let expected = regularisations(&soft.cost, rows);
    for (j, r) in expected.iter().enumerate() {
        let row = first + j;
        assert_exact("R", *r, sim.efc_R()[row], 0.0, context);
        let kbip = &sim.efc_KBIP()[4 * row..4 * row + 4];
        assert_exact("B", soft.damping, kbip[1], 0.0, context);
        // an elliptic cone's friction rows have no spring
        let spring = if j == 0 || cone == ConeKind::Pyramidal { soft.spring } else { 0.0 };
        let depth = sim.efc_pos()[row] - sim.efc_margin()[row];
        assert_exact("K I (pos - margin)", spring, kbip[0] * kbip[2] * depth, 0.0, context);
        let damper = soft.damping * sim.efc_vel()[row];
        let scale = damper.abs().max(spring.abs());
        assert_exact("aref", -damper - spring, sim.efc_aref()[row], scale, context);
    }
    assert_exact("R of the softness", soft.regularisation, sim.efc_R()[first], 0.0, context);
}

/// Residual `J qacc - aref` of a contact's engine rows, and the largest terms in it.
fn residual(sim: &Simulation, first: usize, rows: usize) -> (Vec<f64>, f64) {
    let mut jacobian = vec![0.0; sim.model().nv()];
    let mut scale = 0.0f64;
    let jar = (first..first + rows).map(|row| {
        sim.row_jacobian(row, &mut jacobian).unwrap();
        let terms = jacobian.iter().zip(sim.qacc()).map(|(j, a)| j * a);
        scale = scale.max(terms.clone().fold(sim.efc_aref()[row].abs(), |m, t| m.max(t.abs())));
        terms.sum::<f64>() - sim.efc_aref()[row]
    });
    (jar.collect(), scale)
}

/// The law at the engine's own accelerations gives the engine's own forces.
fn assert_force(
    sim: &Simulation,
    contact: &Contact,
    soft: &Softness,
    cone: ConeKind,
    context: &dyn Fn() -> String,
) -> ActiveSet {
    let first = contact.efc_address.expect("a contact in the solve has rows");
    let rows = row_count(contact.condim, cone);
    let (jar, scale) = residual(sim, first, rows);
    let edges = contact.condim > 1 && cone == ConeKind::Pyramidal;
    let (jar, engine) = if edges {
        // edges n +- mu_j t_j: residuals of the contact's own rows, and forces along them
        let force = &sim.efc_force()[first..first + rows];
        let (mut own, mut along) = (vec![0.5 * (jar[0] + jar[1])], vec![force.iter().sum::<f64>()]);
        for j in 0..contact.condim - 1 {
            own.push(0.5 * (jar[2 * j] - jar[2 * j + 1]) / contact.friction[j]);
            along.push(contact.friction[j] * (force[2 * j] - force[2 * j + 1]));
        }
        (own, along)
    } else {
        (jar, sim.efc_force()[first..first + rows].to_vec())
    };
    let response = soft.cost.respond(&jar);
    let ours = response.force;
    // the engine updates its residuals from step to step of its solver: that rounding, through 1 / R
    let stiffest = regularisations(&soft.cost, rows).into_iter().fold(0.0f64, |m, r| m.max(1.0 / r));
    let largest = contact.friction.iter().fold(1.0f64, |m, mu| m.max(*mu));
    for (j, f) in engine.iter().enumerate() {
        let tolerance = 1e-9 * scale * stiffest * largest * largest;
        assert!((ours[j] - f).abs() <= tolerance, "force {j}: {ours:?} is not {engine:?}\n{}", context());
    }
    response.active_set
}

fn grasp_contacts(sim: &Simulation) -> Vec<GraspContact> {
    let [target, palm] = ["target", "palm"].map(|name| sim.model().body(name).unwrap());
    let mut grasps = Grasps::of(sim, &GraspSpec::new(target, palm)).unwrap();
    grasps.monitor(sim).unwrap();
    grasps[GraspId::FIRST].contacts().to_vec()
}

#[test]
fn rows_and_forces_are_the_engines() {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut count = |what: String| *seen.entry(what).or_default() += 1;
    for seed in 0..400 {
        let mut dice = Dice::new(seed);
        let xml = scene(&mut dice);
        let sim = simulation(&mut dice, &xml);
        let options = options(&sim);
        let contacts = grasp_contacts(&sim);
        let solved = sim.contacts().filter(|c| !c.excluded).count();
        assert_eq!(contacts.len(), solved, "seed {seed}: contacts in the grasp and in the solve\n{xml}");
        sim.contacts().filter(|c| c.excluded).for_each(|_| count("in the gap".into()));
        for ours in &contacts {
            let engine = sim.contact(ours.index).unwrap();
            let context = || format!("seed {seed}: {engine:?}\n{options:?}\n{xml}");
            let soft = softness(&ours.parameters, &options);
            assert_rows(&sim, &engine, &soft, options.cone, &context);
            if sim.model().solver() == Solver::Newton {
                let zone = match assert_force(&sim, &engine, &soft, options.cone, &context) {
                    ActiveSet::Facet(_) => "Facet".to_owned(),
                    zone => format!("{zone:?}"),
                };
                count(format!("{:?} law: {zone}", options.cone));
            }
            count(format!("{:?} condim {}", options.cone, engine.condim));
            let kind = match engine.solref.map(|x| x > 0.0) {
                [true, true] => "standard",
                [false, false] => "direct",
                _ => "mixed",
            };
            count(format!("{kind} solref"));
            if engine.solref[0] > 0.0 && engine.solref[0] < 2.0 * options.timestep {
                count(format!("too stiff for the time step, refsafe {}", options.refsafe));
            }
            if sim.model().overrides_contacts() {
                count("override".into());
            }
            count(format!("target first: {}", ours.target_first));
        }
    }
    println!("{seen:#?}");
    assert!(seen.len() >= 23 && seen.values().all(|n| *n >= 20), "too few cases of a kind: {seen:#?}");
}
