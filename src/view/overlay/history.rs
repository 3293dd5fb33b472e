//! Quality and phase of the last seconds, as a running plot.

use std::collections::VecDeque;

use super::colour;
use crate::grasp::{Grasps, Phase};
use crate::mujoco::{Error, Figure, Line, Rect, Screen};

/// Length of the plot \[s\].
const WINDOW: f64 = 6.0;
/// Room for the legend, in parts of the length.
const LEGEND: f64 = 0.3;
/// Where the phase of a latched grasp is drawn, in parts of its threshold.
const LATCHED: f64 = 1.2;

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

    /// Draws the plot in the lower left corner: for each grasp its quality, the threshold at which it latches, and its
    /// phase, which is above the threshold while it is latched and else at zero.
    pub fn draw(&mut self, screen: &Screen, grasps: &Grasps) -> Result<(), Error> {
        let (width, height) = screen.size();
        let (width, height) = ((width / 3).clamp(1, 460), (height / 3).clamp(1, 260));
        let mut lines: Vec<(String, [f32; 3], Vec<[f32; 2]>)> = Vec::new();
        let mut top = 0.0_f64;
        for (index, grasp) in grasps.iter().enumerate() {
            let threshold = grasp.latch_quality();
            top = top.max(1.5 * threshold);
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
            lines.push((
                format!("latched{number}"),
                [r, g, b],
                curve(&|(_, latched)| LATCHED * threshold * f64::from(latched)),
            ));
        }
        let lines: Vec<Line<'_>> = lines.iter().map(|(name, rgb, points)| Line { name, rgb: *rgb, points }).collect();
        let end = self.points.back().map_or(0.0, |p| p.time);
        let start = self.points.front().map_or(0.0, |p| p.time);
        // the legend is at the right
        let right = end + LEGEND * (end - start).max(1e-3);
        self.figure.set(&lines, [start as f32, right as f32], top as f32);
        screen.figure(Rect { left: 0, bottom: 0, width, height }, &mut self.figure)
    }
}
