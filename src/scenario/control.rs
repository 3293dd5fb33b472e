//! Actuator targets over time.

/// The targets of one `[[control]]` entry, actuators by index.
#[derive(Clone, Debug)]
pub struct Entry {
    /// \[s\]
    pub time: f64,
    /// Sets every actuator, before `set`.
    pub all: Option<f64>,
    /// (actuator index, target in the actuator's own unit)
    pub set: Vec<(usize, f64)>,
}

/// Piecewise linear targets of every actuator.
///
/// Between two entries each actuator that the later one mentions goes linearly from its target at the earlier one to the
/// new one; an actuator that it leaves out stays. Before the first entry everything starts from its starting value at time 0;
/// after the last one everything stays. Entries count in order of time; two of the same time make a jump.
#[derive(Clone, Debug)]
pub struct Schedule {
    actuators: Vec<Course>,
}

/// One actuator's course: a start, then ramps in order of time.
#[derive(Clone, Debug)]
struct Course {
    start: f64,
    ramps: Vec<Ramp>,
}

#[derive(Clone, Copy, Debug)]
struct Ramp {
    from_time: f64,
    to_time: f64,
    to: f64,
}

impl Schedule {
    /// `start` holds each actuator's starting target; indices in `entries` that it does not have are ignored.
    pub fn new(start: &[f64], entries: &[Entry]) -> Self {
        let mut sorted: Vec<&Entry> = entries.iter().collect();
        sorted.sort_by(|a, b| a.time.total_cmp(&b.time));
        let mut actuators: Vec<Course> = start.iter().map(|&start| Course { start, ramps: Vec::new() }).collect();
        let mut from_time = 0.0;
        for entry in sorted {
            for (index, course) in actuators.iter_mut().enumerate() {
                let own = entry.set.iter().rev().find(|(i, _)| *i == index).map(|(_, value)| *value);
                if let Some(to) = own.or(entry.all) {
                    course.ramps.push(Ramp { from_time, to_time: entry.time, to });
                }
            }
            from_time = entry.time;
        }
        Self { actuators }
    }

    /// Writes every actuator's target at `time` \[s\] to `ctrl`.
    pub fn apply(&self, time: f64, ctrl: &mut [f64]) {
        for (ctrl, course) in ctrl.iter_mut().zip(&self.actuators) {
            *ctrl = course.at(time);
        }
    }

    /// From `time` on, `actuator` continues from `value`: it stays there until the next entry that mentions it.
    pub fn continue_from(&mut self, time: f64, actuator: usize, value: f64) {
        if let Some(course) = self.actuators.get_mut(actuator) {
            course.start = value;
            course.ramps.retain(|ramp| ramp.to_time > time);
            for ramp in &mut course.ramps {
                ramp.from_time = ramp.from_time.max(time);
            }
        }
    }
}

impl Course {
    fn at(&self, time: f64) -> f64 {
        let mut value = self.start;
        for ramp in &self.ramps {
            if time >= ramp.to_time {
                value = ramp.to;
            } else if time > ramp.from_time {
                let share = (time - ramp.from_time) / (ramp.to_time - ramp.from_time);
                return value + share * (ramp.to - value);
            } else {
                break;
            }
        }
        value
    }
}
