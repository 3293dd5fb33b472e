//! Quality and phase of the last seconds, as a running plot.

use std::collections::VecDeque;

use super::colour;
use super::status::KEYS_SIZE;
use crate::grasp::{Grasps, Phase};
use crate::mujoco::{Error, Figure, Line, Rect, Screen};

/// Length of the plot \[s\].
const WINDOW: f64 = 6.0;
/// Room for the legend, and for what is beside the axes \[px\].
const LEGEND: f64 = 88.0;
const BESIDE: f64 = 57.0;
/// Where the phase of a latched grasp is drawn, in parts of the plot's height; those of further grasps are below it.
const LATCHED: f64 = 0.96;
const BELOW: f64 = 0.04;

/// What was.
pub struct History {
    figure: Figure,
    /// Every so many steps one is kept, as many as the plot has room for.
    every: u64,
    last: Option<u64>,
    points: VecDeque<Point>,
}

struct Point {
    time: f64,
    /// Quality \[N\] and phase of each grasp.
    grasps: Vec<(f64, bool)>,
}

impl History {
    /// Of a simulation with steps of this length \[s\].
    pub fn new(timestep: f64) -> Self {
        let every = (WINDOW / timestep / (Figure::POINTS - 2) as f64).ceil().max(1.0) as u64;
        let figure = Figure::new("quality Q [N] and phase", "time [s]");
        Self { figure, every, last: None, points: VecDeque::new() }
    }

    /// After a step, the `step`th, at a time \[s\].
    pub fn add(&mut self, step: u64, time: f64, grasps: &Grasps) {
        if self.last.is_some_and(|last| step < last + self.every) {
            return;
        }
        self.last = Some(step);
        if self.points.back().is_some_and(|p| p.time > time) {
            // after a reset
            self.points.clear();
        }
        let grasps = grasps.iter().map(|g| (g.quality(), g.phase() == Phase::Grasped)).collect();
        self.points.push_back(Point { time, grasps });
        while self.points.front().is_some_and(|p| p.time < time - WINDOW) {
            self.points.pop_front();
        }
    }

    /// Draws the plot in the lower left corner, or beside the keys where it would cover them: for each grasp its quality, the
    /// threshold at which it latches, and its phase, which is at the top while it is latched and else at zero.
    pub fn draw(&mut self, screen: &Screen, grasps: &Grasps, keys: bool) -> Result<(), Error> {
        let Some(plot) = place(screen.size(), keys) else { return Ok(()) };
        let mut lines: Vec<(String, [f32; 3], Vec<[f32; 2]>)> = Vec::new();
        let thresholds = grasps.iter().map(|grasp| 1.5 * grasp.latch_quality());
        let qualities = self.points.iter().flat_map(|p| p.grasps.iter().map(|grasp| 1.1 * grasp.0));
        let top = thresholds.chain(qualities).fold(0.0, f64::max);
        for (index, grasp) in grasps.iter().enumerate() {
            let threshold = grasp.latch_quality();
            let latched_at = (LATCHED - BELOW * index as f64) * top;
            let curve = |value: &dyn Fn((f64, bool)) -> f64| -> Vec<[f32; 2]> {
                let own = self.points.iter().filter_map(|p| Some((p.time, *p.grasps.get(index)?)));
                own.map(|(time, point)| [time as f32, value(point) as f32]).collect()
            };
            let number = if grasps.len() > 1 { format!(" {index}") } else { String::new() };
            let [r, g, b] = colour(index);
            lines.push((
                format!("Q{number}"),
                [1.0, 1.0 - 0.4 * index as f32 % 1.0, 0.4],
                curve(&|(quality, _)| quality),
            ));
            lines.push((format!("Q_Th{number}"), [0.7, 0.7, 0.7], curve(&|_| threshold)));
            lines.push((format!("latched{number}"), [r, g, b], curve(&|(_, latched)| latched_at * f64::from(latched))));
        }
        let lines: Vec<Line<'_>> = lines.iter().map(|(name, rgb, points)| Line { name, rgb: *rgb, points }).collect();
        let end = self.points.back().map_or(0.0, |p| p.time);
        let start = self.points.front().map_or(0.0, |p| p.time);
        // the legend is at the right
        let room = LEGEND / (f64::from(plot.width) - BESIDE).max(2.0 * LEGEND);
        let right = end + room / (1.0 - room) * (end - start).max(1e-3);
        self.figure.set(&lines, [start as f32, right as f32], top as f32);
        screen.figure(plot, &mut self.figure)
    }
}

/// Where the plot is in a window of this size; `None` where there is no room.
fn place((width, height): (u32, u32), keys: bool) -> Option<Rect> {
    let plot = ((width / 3).clamp(1, 460), (2 * height / 5).clamp(1, 260));
    let left = if keys && height < KEYS_SIZE.1 + plot.1 { KEYS_SIZE.0 } else { 0 };
    (left + plot.0 <= width).then_some(Rect { left, bottom: 0, width: plot.0, height: plot.1 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Below 800 pixels of height it lay over the last keys.
    #[test]
    fn the_plot_does_not_cover_the_keys() {
        for size in [(800, 600), (1200, 700), (1200, 900), (640, 480)] {
            let plot = place(size, true).unwrap();
            assert!(plot.left >= KEYS_SIZE.0 || plot.height + KEYS_SIZE.1 <= size.1, "{size:?}: {plot:?}");
            assert_eq!(place(size, false).unwrap().left, 0);
        }
        assert!(place((380, 300), true).is_none());
    }
}
