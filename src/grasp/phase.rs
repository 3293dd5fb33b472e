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

/// What the phase machine looks at in one step.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// `Q >= Q_Th`, thesis section 4.1.
    pub good: bool,
    /// `Q >= Q_M`.
    pub sufficient: bool,
    /// An effector pushes on the target.
    pub touching: bool,
    /// Simulated time since the last observation \[s\].
    pub elapsed: f64,
}

/// Latches after the quality was good, with contact, for a set *simulated* time; releases when it is no longer
/// sufficient. Two thresholds and a time on the way in: a quality that hovers around one of them does not chatter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseMachine {
    phase: Phase,
    latch_time: f64,
    good_for: f64,
    allowed: bool,
}

impl PhaseMachine {
    /// An ungrasped machine that latches after `latch_time` seconds of good quality.
    pub fn new(latch_time: f64) -> Self {
        PhaseMachine { phase: Phase::Ungrasped, latch_time, good_for: 0.0, allowed: true }
    }

    /// A machine in the midst of its work: in `phase`, with so many seconds of good quality counted.
    pub(super) fn resumed(latch_time: f64, phase: Phase, good_for: f64, allowed: bool) -> Self {
        PhaseMachine { phase, latch_time, good_for, allowed }
    }

    /// Simulated time for which the quality must be good \[s\].
    pub(super) fn latch_time(&self) -> f64 {
        self.latch_time
    }

    /// Simulated time for which it has been good \[s\].
    pub(super) fn good_for(&self) -> f64 {
        self.good_for
    }

    /// False while latching is forbidden.
    pub(super) fn is_allowed(&self) -> bool {
        self.allowed
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Forbids or allows latching; a forbidden machine does not count good time either. A latched grasp stays.
    pub fn allow_latch(&mut self, allowed: bool) {
        self.allowed = allowed;
        if !allowed {
            self.good_for = 0.0;
        }
    }

    /// True once the quality has been good for long enough.
    pub fn is_ripe(&self) -> bool {
        self.allowed && self.good_for > 0.0 && self.good_for >= self.latch_time - ROUNDING
    }

    /// Takes in one step; the phase changes at most once.
    pub fn observe(&mut self, now: Observation) -> Phase {
        match self.phase {
            Phase::Ungrasped => {
                self.count(now);
                if self.is_ripe() {
                    self.phase = Phase::Grasped;
                }
            }
            Phase::Grasped => {
                if !now.sufficient || !now.touching {
                    self.release();
                }
            }
        }
        self.phase
    }

    /// Counts good time without ever latching: for the engine's own contact solve.
    pub fn count(&mut self, now: Observation) {
        if self.allowed && now.good && now.touching {
            self.good_for += now.elapsed;
        } else {
            self.good_for = 0.0;
        }
    }

    /// Back to ungrasped; good time is counted anew.
    pub fn release(&mut self) {
        self.phase = Phase::Ungrasped;
        self.good_for = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 0.002;

    fn seen(quality: f64, touching: bool) -> Observation {
        Observation { good: quality >= 0.2, sufficient: quality >= 0.05, touching, elapsed: STEP }
    }

    fn run(machine: &mut PhaseMachine, qualities: impl IntoIterator<Item = f64>) -> usize {
        let mut changes = 0;
        let mut last = machine.phase();
        for q in qualities {
            let phase = machine.observe(seen(q, true));
            changes += usize::from(phase != last);
            last = phase;
        }
        changes
    }

    #[test]
    fn latches_after_the_set_time_of_good_quality_only() {
        let mut machine = PhaseMachine::new(0.02);
        assert_eq!(run(&mut machine, [0.3; 9]), 0);
        assert_eq!(run(&mut machine, [0.1]), 0);
        assert_eq!(run(&mut machine, [0.3; 9]), 0);
        assert_eq!(run(&mut machine, [0.3; 2]), 1);
        assert_eq!(machine.phase(), Phase::Grasped);
    }

    #[test]
    fn never_latches_without_contact_or_when_forbidden() {
        let mut machine = PhaseMachine::new(0.0);
        for _ in 0..100 {
            assert_eq!(machine.observe(seen(1.0, false)), Phase::Ungrasped);
        }
        machine.allow_latch(false);
        assert_eq!(run(&mut machine, [1.0; 100]), 0);
        machine.allow_latch(true);
        assert_eq!(run(&mut machine, [1.0]), 1);
    }

    #[test]
    fn quality_between_the_thresholds_changes_nothing() {
        let mut machine = PhaseMachine::new(0.01);
        assert_eq!(run(&mut machine, [0.1; 100]), 0);
        run(&mut machine, [0.3; 10]);
        assert_eq!(machine.phase(), Phase::Grasped);
        assert_eq!(run(&mut machine, [0.1; 100]), 0);
    }

    #[test]
    fn quality_that_hovers_around_a_threshold_does_not_chatter() {
        let mut machine = PhaseMachine::new(0.02);
        let hover = |a: f64, b: f64| (0..1000).map(move |i| if i % 2 == 0 { a } else { b });
        assert_eq!(run(&mut machine, hover(0.21, 0.19)), 0);
        run(&mut machine, [0.3; 20]);
        assert_eq!(run(&mut machine, hover(0.21, 0.19)), 0);
        // one release, and none of the good steps in between is enough to latch again
        assert_eq!(run(&mut machine, hover(0.21, 0.04)), 1);
        assert_eq!(machine.phase(), Phase::Ungrasped);
    }

    #[test]
    fn loss_of_contact_releases_at_once() {
        let mut machine = PhaseMachine::new(0.0);
        run(&mut machine, [0.3; 2]);
        assert_eq!(machine.observe(seen(0.3, false)), Phase::Ungrasped);
    }
}
