//! A hand that closes on a target and is pushed, in full mode and in grasp mode from the same state.

use super::one_step;
use mujoco_grasp::grasp::{Grasp, GraspId, GraspSpec, Grasps, Phase};
use mujoco_grasp::mujoco::{BodyId, Model, Simulation};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::collections::BTreeMap;

/// Iterations of the reference's friction pass.
pub const NOSLIP: usize = 100;

/// Until when the fingers close, the target is held in place, and the grasp is at rest \[s\].
const CLOSED: f64 = 0.8;
const FREE: f64 = 1.0;
const AT_REST: f64 = 1.5;
/// For how long both modes then run before the push \[s\].
const LATCHING: f64 = 0.2;
/// For how long the target is watched after the push \[s\].
const AFTERWARDS: f64 = 0.3;
/// Peaks smaller than this do not make a relative error larger \[m\], as in `scenario::compare`.
const SMALLEST_PEAK: f64 = 2e-3;

/// A model with bodies "object" and "palm", and what happens to it.
#[derive(Clone)]
pub struct Scene {
    pub xml: String,
    /// Where actuators go as the hand closes, by a part of their name; the others stay at what they are.
    pub closed: Vec<(String, f64)>,
    /// Forces at the target's centre of mass, each in a run of its own \[N\].
    pub pushes: [[f64; 3]; 2],
    /// How long a push lasts \[s\].
    pub push_time: f64,
    /// `None`: the default.
    pub latch_quality: Option<f64>,
}

impl Scene {
    /// With other text in the place of some, everywhere.
    pub fn with(mut self, from: &str, to: &str) -> Scene {
        assert!(self.xml.contains(from), "no {from} in the model");
        self.xml = self.xml.replace(from, to);
        self
    }

    /// With attributes added to the first element that begins with `element`.
    pub fn set(self, element: &str, attributes: &str) -> Scene {
        self.with(element, &format!("{element} {attributes}"))
    }
}

/// A simulation with its grasp.
#[derive(Clone)]
pub struct Held {
    pub sim: Simulation,
    pub grasps: Grasps,
    target: BodyId,
    palm: BodyId,
    /// Iterations of the friction pass that the model asks for.
    own_noslip: usize,
}

/// Where the target is in the palm.
#[derive(Clone, Copy)]
pub struct Pose {
    offset: Vector3<f64>,
    rotation: Matrix3<f64>,
}

impl Held {
    /// Closed around the target by the engine's own solve, at rest.
    pub fn closed(scene: &Scene) -> Held {
        let model = Model::from_xml_string(&scene.xml).expect("a model");
        let mut sim = Simulation::new(&model).expect("a simulation");
        if let Ok(key) = sim.model().keyframe("open") {
            sim.reset_to_keyframe(key).expect("a reset");
        }
        let (target, palm) = (sim.model().body("object").expect("object"), sim.model().body("palm").expect("palm"));
        let mut spec = GraspSpec::new(target, palm);
        spec.latch_quality = scene.latch_quality;
        let grasps = Grasps::of(&sim, &spec).expect("a grasp");
        let own_noslip = sim.model().noslip_iterations();
        let mut held = Held { sim, grasps, target, palm, own_noslip };
        held.grasps[GraspId::FIRST].allow_latch(false);
        held.sim.set_noslip_iterations(NOSLIP).expect("a number of iterations");
        held.close(scene);
        held
    }

    fn close(&mut self, scene: &Scene) {
        let model = self.sim.model();
        let joint = model.free_joint_of(self.target).expect("a free joint").index();
        let (q, v) = (model.jnt_qposadr()[joint] as usize, model.jnt_dofadr()[joint] as usize);
        let start = self.sim.qpos()[q..q + 7].to_vec();
        let open = self.sim.ctrl().to_vec();
        let mut goal = open.clone();
        for actuator in model.actuators() {
            let name = model.label(actuator);
            if let Some((_, value)) = scene.closed.iter().find(|(part, _)| name.contains(part.as_str())) {
                goal[actuator.index()] = *value;
            }
        }
        while self.sim.time() < AT_REST {
            let part = (self.sim.time() / CLOSED).min(1.0);
            for (k, ctrl) in self.sim.ctrl_mut().iter_mut().enumerate() {
                *ctrl = open[k] + part * (goal[k] - open[k]);
            }
            if self.sim.time() < FREE {
                self.sim.qpos_mut()[q..q + 7].copy_from_slice(&start);
                self.sim.qvel_mut()[v..v + 6].fill(0.0);
            }
            self.step();
        }
    }

    pub fn step(&mut self) {
        self.grasps.step(&mut self.sim).expect("a step");
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..self.steps(seconds) {
            self.step();
        }
    }

    fn steps(&self, seconds: f64) -> usize {
        (seconds / self.sim.model().timestep()).round() as usize
    }

    pub fn grasp(&self) -> &Grasp {
        &self.grasps[GraspId::FIRST]
    }

    pub fn push(&mut self, force: [f64; 3]) {
        self.sim.set_body_wrench(self.target, &Vector3::from(force), &Vector3::zeros()).expect("a wrench");
    }

    pub fn pose(&self) -> Pose {
        let to_palm = self.sim.body_rotation(self.palm).transpose();
        let offset = to_palm * (self.sim.body_position(self.target) - self.sim.body_position(self.palm));
        Pose { offset, rotation: to_palm * self.sim.body_rotation(self.target) }
    }

    /// Sum of the normal forces on each link that touches the target, and on the palm.
    fn normal_forces(&self) -> BTreeMap<usize, f64> {
        let mut forces = BTreeMap::new();
        for contact in self.grasp().contacts() {
            *forces.entry(contact.link).or_default() += contact.normal_force();
        }
        forces
    }
}

/// How far one run is from the full solve's.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fidelity {
    /// How far full's target gets from where it was, in the palm, and the palm in the world \[m\].
    pub peak: f64,
    pub palm_peak: f64,
    /// RMS distance of the two targets, each in its palm \[m\], and RMS angle \[rad\].
    pub apart: f64,
    pub turned: f64,
    /// RMS over links of the difference of their normal forces, over RMS of full's.
    pub forces: f64,
    /// Most contacts on one link at a time.
    pub contacts: usize,
    /// Links (and palm) that touch the target at the start, and the most at a time.
    pub links: [usize; 2],
    /// Largest difference of a normal force from that of the engine's converged solve of the same step, relative to the
    /// largest one; in one step of 25.
    pub one_step: f64,
    /// Steps in which a pass of the grasp's solve did not converge, and most iterations of a pass.
    pub unsolved: usize,
    pub iterations: usize,
}

impl Fidelity {
    pub fn relative(&self) -> f64 {
        self.apart / self.peak.max(SMALLEST_PEAK)
    }

    /// The worse of the two in each respect; peaks are the smaller ones.
    pub fn worse(&self, other: &Fidelity) -> Fidelity {
        Fidelity {
            peak: self.peak.min(other.peak),
            palm_peak: self.palm_peak.min(other.palm_peak),
            apart: self.apart.max(other.apart),
            turned: self.turned.max(other.turned),
            forces: self.forces.max(other.forces),
            contacts: self.contacts.max(other.contacts),
            links: [self.links[0].min(other.links[0]), self.links[1].max(other.links[1])],
            one_step: self.one_step.max(other.one_step),
            unsolved: self.unsolved.max(other.unsolved),
            iterations: self.iterations.max(other.iterations),
        }
    }
}

/// The full solve with `noslip` iterations.
pub fn full(rest: &Held, noslip: usize) -> Held {
    let mut full = rest.clone();
    full.sim.set_noslip_iterations(noslip).expect("a number of iterations");
    full.run(LATCHING);
    full
}

/// Grasp mode with the model's own settings, latched.
pub fn latched(rest: &Held) -> Held {
    let mut latched = rest.clone();
    latched.sim.set_noslip_iterations(rest.own_noslip).expect("a number of iterations");
    latched.grasps[GraspId::FIRST].allow_latch(true);
    for _ in 0..latched.steps(LATCHING) {
        let solved = latched.grasp().phase() == Phase::Grasped;
        latched.step();
        let status = latched.grasp().solve_status();
        assert!(!solved || status.main.converged && status.noslip.converged, "{status:?}");
    }
    let grasp = latched.grasp();
    let (quality, needed) = (grasp.quality(), grasp.latch_quality());
    assert_eq!(grasp.phase(), Phase::Grasped, "never latched: quality {quality} N of {needed} N");
    latched
}

/// Pushes both and lets go; `other` must stay in the phase that it is in.
pub fn compare(full: &Held, other: &Held, push: [f64; 3], push_time: f64) -> Fidelity {
    let (mut full, mut other) = (full.clone(), other.clone());
    let phase = other.grasp().phase();
    let (start, palm) = (full.pose(), full.sim.body_position(full.palm));
    let mut found = Fidelity::default();
    let (mut differences, mut forces) = (0.0, 0.0);
    let (steps, pushed) = (full.steps(push_time + AFTERWARDS), full.steps(push_time));
    for k in 0..steps {
        let force = if k < pushed { push } else { [0.0; 3] };
        full.push(force);
        full.step();
        other.push(force);
        let exact = (k % 25 == 0 && phase == Phase::Grasped).then(|| one_step::engine(&other.sim));
        other.step();
        if let Some(exact) = exact {
            found.one_step = found.one_step.max(one_step::difference(&exact, other.grasp().contacts()));
        }
        assert_eq!(other.grasp().phase(), phase, "no longer {phase:?} after {k} steps of the push {push:?}");
        let (a, b) = (full.pose(), other.pose());
        found.peak = found.peak.max((a.offset - start.offset).norm());
        found.palm_peak = found.palm_peak.max((full.sim.body_position(full.palm) - palm).norm());
        found.apart += (a.offset - b.offset).norm_squared();
        found.turned += Rotation3::from_matrix(&(a.rotation.transpose() * b.rotation)).angle().powi(2);
        let (a, b) = (full.normal_forces(), other.normal_forces());
        for link in a.keys().chain(b.keys().filter(|link| !a.contains_key(link))) {
            let force = |forces: &BTreeMap<usize, f64>| forces.get(link).copied().unwrap_or(0.0);
            differences += (force(&a) - force(&b)).powi(2);
            forces += force(&a).powi(2);
            found.contacts = found.contacts.max(full.grasp().contacts().iter().filter(|c| c.link == *link).count());
        }
        if k == 0 {
            found.links[0] = a.len();
        }
        found.links[1] = found.links[1].max(a.len());
        if phase == Phase::Grasped {
            let status = other.grasp().solve_status();
            found.iterations = found.iterations.max(status.main.iterations).max(status.noslip.iterations);
            found.unsolved += usize::from(!(status.main.converged && status.noslip.converged));
        }
    }
    found.apart = (found.apart / steps as f64).sqrt();
    found.turned = (found.turned / steps as f64).sqrt();
    found.forces = (differences / forces).sqrt();
    found
}

/// Grasp mode against the full solve with `noslip` iterations, the worse of the two pushes.
pub fn fidelity(scene: &Scene, noslip: usize) -> Fidelity {
    let rest = Held::closed(scene);
    let (full, grasped) = (full(&rest, noslip), latched(&rest));
    let [a, b] = scene.pushes.map(|push| compare(&full, &grasped, push, scene.push_time));
    a.worse(&b)
}
