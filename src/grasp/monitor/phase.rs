//! When a grasp latches and when it is given up.

/// The sum of many steps must not miss the mark by a rounding error \[s\].
const ROUNDING: f64 = 1e-9;

/// The two states of the thesis (its Figure 4.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// The engine solves the contacts.
    Ungrasped,
    /// The grasp constraint stands for them.
    Grasped,
}

/// Latches after the quality was good for a set *simulated* time, and releases after the hand has held nothing for
/// another: two thresholds and two times, so that neither a quality that hovers around one of them nor contacts that open
/// for a step or two chatter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseMachine {
    phase: Phase,
    latch_time: f64,
    release_time: f64,
    /// Time of good quality while ungrasped, without hold while grasped \[s\].
    counted: f64,
    allowed: bool,
}

impl PhaseMachine {
    /// An ungrasped machine that latches after `latch_time` seconds of good quality, and releases after `release_time`
    /// seconds without hold.
    pub fn new(latch_time: f64, release_time: f64) -> Self {
        PhaseMachine { phase: Phase::Ungrasped, latch_time, release_time, counted: 0.0, allowed: true }
    }

    /// The machine in the midst of its work: in `phase`, with so many seconds counted.
    pub(in crate::grasp) fn resumed(self, phase: Phase, counted: f64, allowed: bool) -> Self {
        PhaseMachine { phase, counted, allowed, ..self }
    }

    /// Simulated time of good quality so far, or without hold while grasped \[s\].
    pub(in crate::grasp) fn counted(&self) -> f64 {
        self.counted
    }

    /// False while latching is forbidden.
    pub(in crate::grasp) fn is_allowed(&self) -> bool {
        self.allowed
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Forbids or allows latching; a forbidden machine does not count good time either. A latched grasp stays.
    pub fn allow_latch(&mut self, allowed: bool) {
        self.allowed = allowed;
        if !allowed && self.phase == Phase::Ungrasped {
            self.counted = 0.0;
        }
    }

    /// True while ungrasped, once the quality has been good for long enough.
    pub fn is_ripe(&self) -> bool {
        self.phase == Phase::Ungrasped
            && self.allowed
            && self.counted > 0.0
            && self.counted >= self.latch_time - ROUNDING
    }

    /// Takes in an ungrasped step of `elapsed` seconds, `good` if `Q >= Q_Th` (thesis section 4.1) with an effector that
    /// pushes on the target; without ever latching.
    pub fn count_good(&mut self, good: bool, elapsed: f64) {
        self.counted = if self.allowed && good { self.counted + elapsed } else { 0.0 };
    }

    /// Takes in an ungrasped step as [`count_good`](Self::count_good), and latches if it is time.
    pub fn observe_ungrasped(&mut self, good: bool, elapsed: f64) -> Phase {
        self.count_good(good, elapsed);
        if self.is_ripe() {
            (self.phase, self.counted) = (Phase::Grasped, 0.0);
        }
        self.phase
    }

    /// Takes in a grasped step of `elapsed` seconds, `held` if the hand has hold of the target, and releases if it is time.
    pub fn observe_grasped(&mut self, held: bool, elapsed: f64) -> Phase {
        self.counted = if held { 0.0 } else { self.counted + elapsed };
        if self.counted > 0.0 && self.counted >= self.release_time - ROUNDING {
            self.release();
        }
        self.phase
    }

    /// Back to ungrasped; good time is counted anew.
    pub fn release(&mut self) {
        (self.phase, self.counted) = (Phase::Ungrasped, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 0.002;

    /// Steps of the machine with these qualities, under contact; the number of changes of phase.
    fn run(machine: &mut PhaseMachine, qualities: impl IntoIterator<Item = f64>) -> usize {
        let mut changes = 0;
        for q in qualities {
            let last = machine.phase();
            let now = match last {
                Phase::Ungrasped => machine.observe_ungrasped(q >= 0.2, STEP),
                Phase::Grasped => machine.observe_grasped(q >= 0.05, STEP),
            };
            changes += usize::from(now != last);
        }
        changes
    }

    #[test]
    fn latches_after_the_set_time_of_good_quality_only() {
        let mut machine = PhaseMachine::new(0.02, 0.0);
        assert_eq!(run(&mut machine, [0.3; 9]), 0);
        assert_eq!(run(&mut machine, [0.1]), 0);
        assert_eq!(run(&mut machine, [0.3; 9]), 0);
        assert_eq!(run(&mut machine, [0.3; 2]), 1);
        assert_eq!(machine.phase(), Phase::Grasped);
    }

    #[test]
    fn releases_after_the_set_time_without_hold_only() {
        let mut machine = PhaseMachine::new(0.0, 0.02);
        run(&mut machine, [0.3]);
        for _ in 0..10 {
            assert_eq!(run(&mut machine, [0.0; 9]), 0);
            assert_eq!(run(&mut machine, [0.1]), 0);
        }
        assert_eq!(run(&mut machine, [0.0; 9]), 0);
        assert_eq!(run(&mut machine, [0.0]), 1);
        assert_eq!(machine.phase(), Phase::Ungrasped);
    }

    #[test]
    fn never_latches_without_good_quality_or_when_forbidden() {
        let mut machine = PhaseMachine::new(0.0, 0.0);
        assert_eq!(run(&mut machine, [0.1; 100]), 0);
        machine.allow_latch(false);
        assert_eq!(run(&mut machine, [1.0; 100]), 0);
        machine.allow_latch(true);
        assert_eq!(run(&mut machine, [1.0]), 1);
    }

    #[test]
    fn quality_between_the_thresholds_changes_nothing() {
        let mut machine = PhaseMachine::new(0.01, 0.0);
        assert_eq!(run(&mut machine, [0.1; 100]), 0);
        run(&mut machine, [0.3; 10]);
        assert_eq!(machine.phase(), Phase::Grasped);
        assert_eq!(run(&mut machine, [0.1; 100]), 0);
    }

    #[test]
    fn quality_that_hovers_around_a_threshold_does_not_chatter() {
        let mut machine = PhaseMachine::new(0.02, 0.0);
        let hover = |a: f64, b: f64| (0..1000).map(move |i| if i % 2 == 0 { a } else { b });
        assert_eq!(run(&mut machine, hover(0.21, 0.19)), 0);
        run(&mut machine, [0.3; 20]);
        assert_eq!(run(&mut machine, hover(0.21, 0.19)), 0);
        // one release, and none of the good steps in between is enough to latch again
        assert_eq!(run(&mut machine, hover(0.21, 0.04)), 1);
        assert_eq!(machine.phase(), Phase::Ungrasped);
        // with a time on the way out not even that
        let mut machine = PhaseMachine::new(0.02, 0.004);
        run(&mut machine, [0.3; 20]);
        assert_eq!(run(&mut machine, hover(0.21, 0.04)), 0);
    }

    #[test]
    fn time_without_hold_is_no_good_time_of_the_next_latch() {
        let mut machine = PhaseMachine::new(0.006, 0.02);
        run(&mut machine, [0.3; 3]);
        assert_eq!(run(&mut machine, [0.0; 10]), 1);
        assert_eq!(run(&mut machine, [0.3; 2]), 0);
        assert_eq!(run(&mut machine, [0.3]), 1);
    }
}
