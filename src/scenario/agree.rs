//! Random pushes: does the grasp mode tell the same story as the full contact solve?
//!
//! 1. Both modes are simulated once to where the push starts: the start of the scenario's first push, else
//!    [`START_AFTER`] past `measure_from`. All that follows goes on from there.
//! 2. In each of 52 directions the *onset* is found: the smallest size that is not held, with pushes of
//!    [`ONSET_DURATION`], to [`ONSET_ACCURACY`], in full mode and then in grasp mode.
//! 3. Each trial draws direction, size over full's onset, and duration, and runs in both modes.
//!
//! Runs end where the scenario ends, or [`SETTLING`] after the longest push if that is later, so that a push from a
//! scenario file comes to the same under `run`.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::checkpoint::{Checkpoint, Ending};
use super::compare::{Comparison, compare};
use super::draw::{DURATIONS, Direction, Draw, Kind, directions};
use super::error::Error;
use super::onset::{Search, smallest_not_held};
use super::plan::{Plan, Push};
use super::run::Options;
use super::runner::{Mode, Runner};

/// The push starts so long after `measure_from` in scenarios that have no push of their own \[s\].
pub const START_AFTER: f64 = 0.5;
/// Time from the end of the longest push to the end of the run, at least \[s\].
pub const SETTLING: f64 = 1.0;
/// Length of the pushes that onsets are found with: the mean of those that trials draw \[s\].
pub const ONSET_DURATION: f64 = 0.5 * (DURATIONS.0 + DURATIONS.1);
/// Bisection of the onsets, relative. The difference of two onsets is to be told from the 3 % that either may be off by.
pub const ONSET_ACCURACY: f64 = 0.01;
/// What finding both onsets of a direction costs, in trials.
pub const TRIALS_PER_ONSET: u64 = 6;

/// A lever for the first guess of a torque where nothing touches the target \[m\].
const LEVER: f64 = 0.03;

/// One direction and the sizes from which on it is not held.
#[derive(Clone, Copy, Debug)]
pub struct Onset {
    /// Where the push goes.
    pub direction: Direction,
    /// Full mode's \[N or N m\]; `None`: held (or not) whatever the size.
    pub full: Option<f64>,
    /// Grasp mode's.
    pub grasp: Option<f64>,
}

impl Onset {
    /// Difference of grasp mode's onset over full mode's.
    pub fn relative_error(&self) -> Option<f64> {
        self.full.zip(self.grasp).map(|(full, grasp)| (grasp - full).abs() / full)
    }
}

/// One push in both modes.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Counted from 0; with the seed, all that it takes to draw it again.
    pub trial: u64,
    /// Index of its direction among the onsets.
    pub direction: usize,
    /// Its size over full mode's onset.
    pub share: f64,
    /// The push.
    pub push: Push,
    /// How full mode ended.
    pub full: Ending,
    /// How grasp mode ended.
    pub grasp: Ending,
    /// Both, compared.
    pub compare: Comparison,
    /// Where the outcomes differ: whether full mode itself has another one with [`STRICTER`](super::checkpoint::STRICTER) times the noslip iterations.
    /// `None` where they do not, and without any noslip iterations.
    pub chaotic: Option<bool>,
}

/// Both modes where the push starts.
pub struct Ground {
    setting: Setting,
    start: Start,
}

/// A simulation of each mode. They can move between threads but not be shared: each thread has its own pair.
#[derive(Clone)]
struct Start {
    full: Checkpoint,
    grasp: Checkpoint,
}

/// What all pushes have in common.
struct Setting {
    plan: Plan,
    /// Without size: when it starts and what it acts on.
    push: Push,
    /// Sizes to begin the search with: the target's weight \[N\], and its torque about the contacts \[N m\].
    guess: (f64, f64),
}

impl Ground {
    /// Simulates both modes to the start of the push. `options` are of full mode.
    ///
    /// # Errors
    /// A scenario that cannot be set up or run so far.
    pub fn new(plan: &Plan, options: Options) -> Result<Self, Error> {
        let push = template(plan);
        let mut plan = plan.clone();
        plan.timeline.duration = plan.timeline.duration.max(push.start + DURATIONS.1 + SETTLING);
        let (full, grasp) = rayon::join(
            || Checkpoint::new(&plan, Mode::Full, &push, options),
            || Checkpoint::new(&plan, Mode::Grasp, &push, options),
        );
        let start = Start { full: full?, grasp: grasp? };
        let guess = guess(start.full.runner());
        Ok(Self { setting: Setting { plan, push, guess }, start })
    }

    /// Whether the grasp is latched when the push starts. If not, both modes are the same simulation.
    pub fn is_latched(&self) -> bool {
        self.start.grasp.is_latched()
    }

    /// The scenario's name.
    pub fn scenario(&self) -> &str {
        &self.setting.plan.name
    }

    /// When every push starts, and when every run ends \[s\].
    pub fn times(&self) -> (f64, f64) {
        (self.setting.push.start, self.setting.plan.timeline.duration)
    }

    /// Noslip iterations of full mode.
    pub fn noslip(&self) -> usize {
        self.start.full.runner().sim().model().noslip_iterations()
    }

    /// The onsets of all directions, but for those that the plan's [`Stop`](super::stop::Stop) interrupts. `progress` is
    /// told of each.
    pub fn onsets(&self, progress: &(dyn Fn() + Sync)) -> Vec<Onset> {
        let setting = &self.setting;
        let find = |start: &mut Start, direction: Direction| {
            let onset = setting.onset(start, direction);
            progress();
            setting.unless_stopped(onset)
        };
        let found: Vec<Option<Onset>> = directions().into_par_iter().map_with(self.start.clone(), find).collect();
        found.into_iter().flatten().collect()
    }

    /// `trials` random pushes in the directions that have an onset in full mode; none if no direction has. Those that the
    /// plan's [`Stop`](super::stop::Stop) interrupts are left out. `progress` is told of each. They depend on nothing but
    /// `onsets` and `seed`.
    pub fn trials(&self, onsets: &[Onset], trials: u64, seed: u64, progress: &(dyn Fn() + Sync)) -> Vec<Trial> {
        let setting = &self.setting;
        let choices: Vec<usize> = (0..onsets.len()).filter(|&i| onsets[i].full.is_some()).collect();
        if choices.is_empty() {
            return Vec::new();
        }
        let run = |start: &mut Start, trial: u64| {
            let draw = Draw::new(seed, trial, choices.len());
            let direction = choices[draw.choice];
            let done = setting.trial(start, trial, direction, &onsets[direction], draw);
            progress();
            setting.unless_stopped(done)
        };
        let done: Vec<Option<Trial>> = (0..trials).into_par_iter().map_with(self.start.clone(), run).collect();
        done.into_iter().flatten().collect()
    }
}

impl Setting {
    /// What was simulated before it was asked to stop; what came of it later is not to be trusted.
    fn unless_stopped<T>(&self, result: T) -> Option<T> {
        (!self.plan.stop.is_asked()).then_some(result)
    }

    /// A push of this size and duration.
    fn push(&self, direction: &Direction, size: f64, duration: f64) -> Push {
        let (force, torque) = direction.wrench(size);
        Push { force, torque, end: self.push.start + duration, ..self.push.clone() }
    }

    fn onset(&self, start: &Start, direction: Direction) -> Onset {
        let first = match direction.kind {
            Kind::Force => self.guess.0,
            Kind::Torque => self.guess.1,
        };
        let find = |mode: &Checkpoint, search| {
            let held = |size| mode.holds(&self.push(&direction, size, ONSET_DURATION));
            smallest_not_held(search, ONSET_ACCURACY, held)
        };
        let full = find(&start.full, Search::from(first));
        // The modes should agree: two runs are enough where they do.
        let near = full.map_or(Search::from(first), |first| Search { first, stride: 1.0 + ONSET_ACCURACY });
        Onset { direction, full, grasp: find(&start.grasp, near) }
    }

    fn trial(&self, start: &Start, trial: u64, direction: usize, onset: &Onset, draw: Draw) -> Trial {
        let push = self.push(&onset.direction, draw.share * onset.full.unwrap_or(0.0), draw.duration);
        let (full, grasp) = (start.full.push(&push), start.grasp.push(&push));
        let measure_from = self.plan.timeline.measure_from();
        let compare = compare((&full.trajectory, &full.summary), (&grasp.trajectory, &grasp.summary), measure_from);
        let chaotic = if compare.same_outcome { None } else { start.full.is_chaotic(&push, full.summary.outcome) };
        let (full, grasp) = (full.ending(), grasp.ending());
        Trial { trial, direction, share: draw.share, push, full, grasp, compare, chaotic }
    }
}

/// A push without size, on the target and from the time that the scenario's first push has.
fn template(plan: &Plan) -> Push {
    let measure_from = plan.timeline.measure_from();
    let first = plan.pushes.first();
    let grasp = first.map_or(0, |p| p.grasp);
    let start = first.map_or(measure_from + START_AFTER, |p| p.start.max(measure_from));
    Push {
        name: "agree".to_owned(),
        grasp,
        body: plan.grasps[grasp].target,
        start,
        end: start,
        force: Vector3::zeros(),
        torque: Vector3::zeros(),
    }
}

/// Force and torque that a search may begin with.
fn guess(runner: &Runner) -> (f64, f64) {
    let (model, grasp) = (runner.sim().model(), runner.grasp());
    let earth = 9.81;
    let gravity = if model.has_gravity() { model.gravity().norm() } else { 0.0 };
    let force = model.body_subtreemass()[grasp.target().index()] * if gravity > 0.0 { gravity } else { earth };
    let com = runner.sim().body_com(grasp.target());
    let lever = grasp.contacts().iter().map(|c| (c.position - com).norm()).fold(0.0, f64::max);
    (force, force * if lever > 0.0 { lever } else { LEVER })
}
