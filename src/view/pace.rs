//! How many steps are due.

/// Wall-clock time that is made up for at most \[s\]: what takes longer is dropped, and the simulation runs slower.
const MOST: f64 = 0.1;
/// Slowest motion: real time over two to this.
const SLOWEST: u32 = 7;

/// Real time or slower, or paused.
#[derive(Clone, Debug, Default)]
pub(super) struct Pace {
    pub paused: bool,
    halvings: u32,
    /// Simulated time that is due \[s\].
    owed: f64,
}

impl Pace {
    /// Simulated over wall-clock time.
    pub fn speed(&self) -> f64 {
        0.5_f64.powi(self.halvings as i32)
    }

    pub fn slower(&mut self) {
        self.halvings = (self.halvings + 1).min(SLOWEST);
    }

    pub fn faster(&mut self) {
        self.halvings = self.halvings.saturating_sub(1);
    }

    /// Whole steps that are due after `elapsed` seconds on the wall.
    pub fn due(&mut self, elapsed: f64, timestep: f64) -> u64 {
        if self.paused {
            self.owed = 0.0;
            return 0;
        }
        self.owed += elapsed.min(MOST) * self.speed();
        let steps = (self.owed / timestep).floor();
        self.owed -= steps * timestep;
        steps as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_keep_real_time_or_a_part_of_it() {
        let mut pace = Pace::default();
        let made = |pace: &mut Pace| (0..600).map(|_| pace.due(1.0 / 60.0, 0.002)).sum::<u64>();
        assert!(made(&mut pace).abs_diff(5000) <= 1);
        pace.slower();
        pace.slower();
        assert!(made(&mut pace).abs_diff(1250) <= 1);
        pace.faster();
        pace.faster();
        pace.faster();
        assert_eq!(pace.speed(), 1.0, "never quicker than real time");
        pace.paused = true;
        assert_eq!(made(&mut pace), 0);
    }

    #[test]
    fn what_cannot_be_made_up_for_is_dropped() {
        assert_eq!(Pace::default().due(60.0, 0.002), 50);
    }
}
