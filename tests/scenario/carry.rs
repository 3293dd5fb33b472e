//! The built-in scenario `carry`: reach, grasp, lift, move fast, set down on a block, open, withdraw; the same story in
//! both modes. The bottle touches the table, and then the block, while it is grasped.

use std::collections::BTreeSet;
use std::ops::Range;
use std::time::{Duration, Instant};

use mujoco_grasp::mujoco::BodyId;
use mujoco_grasp::scenario::outcome::{Motion, Outcome, Summary, summarize};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::{Mode, Runner};
use mujoco_grasp::scenario::trajectory::Trajectory;
use nalgebra::Vector3;

/// Nothing but the hand holds the bottle: after the lift-off, and until just before the block \[s\].
const CARRY: Range<f64> = 2.05..4.75;
/// The fast move to the left \[s\].
const MOVE: Range<f64> = 3.0..3.7;
/// The bottle's place in the world, its frame being in its middle: at the start, at the end \[m\].
const START: [f64; 3] = [0.27, 0.33, 1.05 + 0.08];
const END: [f64; 3] = [-0.13, 0.33, 1.1 + 0.08];

/// What happened in one run.
struct Story {
    trajectory: Trajectory,
    summary: Summary,
    /// When the grasp latched or was released \[s\].
    changes: Vec<f64>,
    /// The bottle in the world in each step: its middle, how far its axis is upright, and whether table or block touch it.
    centre: Vec<Vector3<f64>>,
    upright: Vec<f64>,
    supported: Vec<bool>,
    /// During [`CARRY`]: fewest bodies of the hand that press on the bottle at a time, and steps with a contact of hand and
    /// bottle in MuJoCo's solve.
    holding: usize,
    engine_steps: usize,
}

impl Story {
    fn of(plan: &Plan, mode: Mode) -> Story {
        let mut runner = Runner::new(plan, mode, None).unwrap();
        let (palm, bottle) = (runner.grasp().palm(), runner.grasp().target());
        let hand: Vec<BodyId> = runner.grasp().links().iter().copied().chain([palm]).collect();
        let mut story = Story {
            trajectory: runner.trajectory(),
            summary: summarize(&runner.trajectory(), 0.0, None),
            changes: Vec::new(),
            centre: Vec::new(),
            upright: Vec::new(),
            supported: Vec::new(),
            holding: usize::MAX,
            engine_steps: 0,
        };
        let mut grasped = false;
        while !runner.is_over() {
            let sample = runner.step().unwrap();
            let sim = runner.sim();
            if sample.grasped != grasped {
                grasped = sample.grasped;
                story.changes.push(sample.time);
            }
            let partners: Vec<(BodyId, bool)> =
                sim.contacts().filter_map(|c| c.other_body(bottle).map(|other| (other, c.excluded))).collect();
            story.supported.push(partners.iter().any(|(other, _)| !hand.contains(other)));
            story.centre.push(sim.body_position(bottle));
            story.upright.push(sim.body_rotation(bottle)[(2, 2)]);
            if CARRY.contains(&sample.time) {
                let pressing = runner.grasp().contacts().iter().filter(|c| c.normal_force() > 0.0);
                story.holding = story.holding.min(pressing.map(|c| c.link).collect::<BTreeSet<_>>().len());
                let engine = partners.iter().any(|(other, excluded)| hand.contains(other) && !excluded);
                story.engine_steps += usize::from(engine);
            }
            story.trajectory.push(sample, runner.normal_forces());
        }
        story.summary = summarize(&story.trajectory, plan.timeline.measure_from(), None);
        story
    }

    fn steps(&self, times: &Range<f64>) -> Range<usize> {
        let at = |time| self.trajectory.index_at(time).unwrap();
        at(times.start)..at(times.end)
    }

    fn time(&self, step: usize) -> f64 {
        self.trajectory.samples()[step].time
    }

    /// First and last time without table and block \[s\], once the hand is there.
    fn flight(&self) -> [f64; 2] {
        let free = |step: &usize| !self.supported[*step];
        let mut steps = self.trajectory.index_at(1.0).unwrap()..self.trajectory.index_at(5.2).unwrap();
        [steps.clone().find(free), steps.rfind(free)].map(|step| self.time(step.unwrap()))
    }

    /// Largest distance of the bottle from where it was in the palm at the beginning of [`CARRY`] \[m\].
    fn motion(&self) -> f64 {
        let samples = &self.trajectory.samples()[self.steps(&CARRY)];
        samples.iter().map(|s| Motion::between(&samples[0], s).offset.norm()).fold(0.0, f64::max)
    }

    /// Largest acceleration of the bottle in the fast move, from its places 20 ms apart \[m/s^2\].
    fn acceleration(&self, timestep: f64) -> f64 {
        let (c, n) = (&self.centre, (0.02 / timestep).round() as usize);
        let change = |i: usize| c[i + n] - 2.0 * c[i] + c[i - n];
        self.steps(&MOVE).map(|i| change(i).norm() / (n as f64 * timestep).powi(2)).fold(0.0, f64::max)
    }

    fn last_place(&self) -> Vector3<f64> {
        self.centre[self.centre.len() - 1]
    }
}

/// RMS distance of the bottle's places in the palm in the two modes during [`CARRY`] \[m\].
fn rms_distance(full: &Story, grasp: &Story) -> f64 {
    let steps = full.steps(&CARRY);
    let [a, b] = [full, grasp].map(|s| &s.trajectory.samples()[steps.clone()]);
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a.position - b.position).norm_squared()).sum();
    (sum / a.len() as f64).sqrt()
}

/// Everything that was measured, for whoever has to find out why.
fn figures(full: &Story, grasp: &Story, apart: f64, timestep: f64) -> String {
    let mut text = format!("carried {:.3} mm apart\n", apart * 1e3);
    for (mode, s) in [("full", full), ("grasp", grasp)] {
        text += &format!(
            "{mode}: moves {:.3} mm in the palm while carried; phase changes at {:?} s; off the support during {:?} s; {:.2} \
             m/s^2; at least {} bodies hold it, {} steps in MuJoCo's solve; at the end at {:.5?} m, upright {:.6}; {:?}\n",
            s.motion() * 1e3,
            s.changes,
            s.flight(),
            s.acceleration(timestep),
            s.holding,
            s.engine_steps,
            s.last_place().as_slice(),
            s.upright[s.upright.len() - 1],
            s.summary
        );
    }
    text
}

#[test]
fn a_bottle_is_taken_carried_fast_and_set_down_in_both_modes() {
    let begin = Instant::now();
    let plan = Plan::load("carry").unwrap();
    let timestep = plan.model.timestep();
    let [full, grasp] = [Mode::Full, Mode::Grasp].map(|mode| Story::of(&plan, mode));
    let apart = rms_distance(&full, &grasp);
    let figures = figures(&full, &grasp, apart, timestep);
    // nextest shows it on demand; it is what the bounds are set from
    println!("{figures}");

    for (mode, story) in [("full", &full), ("grasp", &grasp)] {
        let [first, last] = story.flight();
        assert!(first < CARRY.start && last >= CARRY.end, "{mode}: not lifted, or set down too early\n{figures}");
        assert!(story.steps(&CARRY).all(|step| !story.supported[step]), "{mode}: carried?\n{figures}");
        let rest = |step: usize, place: [f64; 3]| (story.centre[step] - Vector3::from(place)).norm();
        assert!(rest(story.steps(&(1.0..2.0)).start, START) < 1e-3, "{mode}: pushed before it is grasped\n{figures}");
        let top = story.centre.iter().map(|c| c.z).fold(0.0, f64::max);
        assert!((0.14..0.16).contains(&(top - START[2])), "{mode}: lifted by {top} m\n{figures}");
        // 0.63 g and 2.7 mm in either mode when this was written, and 7 of the 16 bodies of the hand that always press
        assert!(story.acceleration(timestep) > 0.5 * 9.81, "{mode}: no fast move\n{figures}");
        assert!(story.motion() < 5e-3, "{mode}: the bottle slips\n{figures}");
        assert!(rest(story.centre.len() - 1, END) < 5e-3, "{mode}: not where it shall stand\n{figures}");
        assert!(story.upright[story.upright.len() - 1] > 0.99999, "{mode}: it does not stand\n{figures}");
        assert_eq!(story.summary.outcome, Some(Outcome::Lost), "{mode}: the hand does not let go\n{figures}");
    }
    assert!(grasp.holding >= 5, "hardly held\n{figures}");
    assert_eq!((full.engine_steps, grasp.engine_steps), (full.steps(&CARRY).len(), 0), "who solves?\n{figures}");
    assert!(full.changes.is_empty(), "{figures}");
    let [latched, released] = grasp.changes[..] else { panic!("latches and releases not once\n{figures}") };
    let [lifted, landed] = grasp.flight();
    assert!(latched < lifted && (5.2..6.2).contains(&released), "{figures}");
    assert!(landed < 5.0, "the hand opens in the air\n{figures}");
    let supported = |times: Range<f64>| grasp.steps(&times).filter(|&step| grasp.supported[step]).count();
    assert!(supported(latched..lifted) > 50 && supported(landed..released) > 150, "grasped and standing\n{figures}");

    // 0.065 mm when this was written; full mode with 50 noslip iterations is 0.058 mm from the one with 1000
    assert!(apart < 1e-3, "the modes differ\n{figures}");
    assert!((full.last_place() - grasp.last_place()).norm() < 2e-3, "not at the same place in the end\n{figures}");
    assert!(begin.elapsed() < Duration::from_secs(20), "{:?}", begin.elapsed());
}
