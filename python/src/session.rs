//! A borrowed simulation, its grasps, and what is kept of their past.

use crate::errors::{EngineWarning, ResetError, of_engine, of_grasp};
use mujoco_grasp::grasp::{Grasp, GraspId, Grasps, Limits, Phase};
use mujoco_grasp::mujoco::{Borrowed, Simulation, Warning, WarningKind};
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use std::ffi::CString;

/// What a thread works with while it has the session's lock.
pub struct Session {
    pub borrowed: Borrowed,
    pub grasps: Grasps,
    pub clocks: Vec<Clock>,
    /// After the last step \[s\]; not a number if none is to be compared with.
    time: f64,
}

/// How long a grasp has been latched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// When it last latched \[s\].
    pub latched_at: Option<f64>,
    /// Simulated time of the steps that it began latched \[s\].
    pub latched: f64,
    /// Of these, with the limits "box" or "rigid" \[s\].
    pub merged: f64,
    /// It was latched when the present step began.
    #[serde(skip)]
    began_latched: bool,
}

/// How a session goes on: so many steps.
#[derive(Clone, Copy)]
pub struct Advance {
    n: usize,
    /// The last of them is whole.
    ends_whole: bool,
    /// They may go on where the last call has ended.
    goes_on: bool,
}

impl Advance {
    /// Of which the last is whole.
    pub fn steps(n: usize) -> Self {
        Self { n, ends_whole: true, goes_on: n > 1 }
    }

    /// On frozen geometry where that is good enough.
    pub fn substeps(n: usize) -> Self {
        Self { n, ends_whole: false, goes_on: true }
    }

    /// What is left of a call that began with `substeps`.
    pub fn rest(n: usize) -> Self {
        Self { n, ends_whole: true, goes_on: true }
    }
}

impl Session {
    pub fn new(borrowed: Borrowed) -> Self {
        Self { borrowed, grasps: Grasps::new(), clocks: Vec::new(), time: f64::NAN }
    }

    /// A grasp by its place.
    pub fn grasp(&self, index: usize) -> Option<&Grasp> {
        self.grasps.get(self.id(index)?)
    }

    /// As [`grasp`](Self::grasp).
    pub fn grasp_mut(&mut self, index: usize) -> Option<&mut Grasp> {
        self.grasps.get_mut(self.id(index)?)
    }

    fn id(&self, index: usize) -> Option<GraspId> {
        self.grasps.ids().nth(index)
    }

    /// All grasps are as when they were added.
    pub fn reset(&mut self) {
        self.grasps.reset();
        self.clocks.fill(Clock::default());
        self.forget_time();
    }

    /// The same, with the data: to its initial configuration, or to a keyframe.
    ///
    /// # Errors
    /// A keyframe that does not exist.
    pub fn reset_data(&mut self, keyframe: Option<&str>) -> PyResult<()> {
        let reset = self.borrowed.visit(false, |sim| match keyframe {
            Some(name) => sim.model().keyframe(name).and_then(|key| sim.reset_to_keyframe(key)),
            None => sim.reset(),
        });
        reset.and_then(|reset| reset).map_err(of_engine)?;
        self.reset();
        Ok(())
    }

    /// Writes the data's state.
    ///
    /// # Errors
    /// The library's.
    pub fn write(&mut self, work: impl FnOnce(&mut Simulation)) -> PyResult<()> {
        self.borrowed.visit(false, work).map_err(of_engine)
    }

    /// The data's time may go back: what the grasps have seen is not of it any more.
    pub fn forget_time(&mut self) {
        self.time = f64::NAN;
    }

    /// Advances the simulation, once `inputs` has written controls and loads.
    ///
    /// # Errors
    /// The library's; [`ResetError`] where the data has gone back in time under a latched grasp.
    pub fn advance(&mut self, advance: Advance, inputs: impl FnOnce(&mut Simulation)) -> PyResult<()> {
        self.check_time()?;
        let Advance { n, ends_whole, goes_on } = advance;
        if n == 0 {
            return Ok(());
        }
        let Self { borrowed, grasps, clocks, .. } = self;
        let result = borrowed.visit(goes_on, |sim| {
            inputs(sim);
            let mut steps = || {
                for i in 1..=n {
                    let time = sim.time();
                    clocks.iter_mut().zip(&*grasps).for_each(|(clock, grasp)| clock.begin(grasp));
                    if i == n && ends_whole { grasps.step(sim) } else { grasps.substep(sim) }?;
                    let elapsed = sim.model().timestep();
                    clocks.iter_mut().zip(&*grasps).for_each(|(clock, grasp)| clock.end(grasp, time, elapsed));
                }
                Ok(())
            };
            let made = steps();
            // What a merged grasp sets is not to be seen between two calls.
            made.and(grasps.restore_settings(sim))
        });
        self.time = self.borrowed.sim().time();
        result.map_err(of_engine)?.map_err(of_grasp)
    }

    fn check_time(&self) -> PyResult<()> {
        let now = self.borrowed.sim().time();
        if now < self.time && self.grasps.iter().any(|grasp| grasp.phase() == Phase::Grasped) {
            return Err(ResetError::new_err(format!(
                "the data has gone back from {} s to {now} s while a grasp is latched: call reset() or restore() of the \
                 grasps whenever the data is reset or a state is set",
                self.time
            )));
        }
        Ok(())
    }

    /// What the engine has warned of since the last call and is no error, as texts.
    pub fn take_warnings(&mut self) -> Vec<String> {
        let is_no_error = |warning: &Warning| {
            matches!(warning.kind, WarningKind::Inertia | WarningKind::DrawnShapesFull | WarningKind::Other)
        };
        let text = |warning: Warning| match warning.text.is_empty() {
            true => format!("MuJoCo: {:?}, {} times, last at {} s", warning.kind, warning.count, warning.time),
            false => format!("MuJoCo: {}", warning.text),
        };
        self.borrowed.take_warnings().into_iter().filter(is_no_error).map(text).collect()
    }
}

/// Hands the engine's warnings to Python's `warnings`.
pub fn warn(py: Python<'_>, texts: Vec<String>) -> PyResult<()> {
    let category = py.get_type::<EngineWarning>();
    texts.into_iter().try_for_each(|text| PyErr::warn(py, &category, &CString::new(text).unwrap_or_default(), 1))
}

impl Clock {
    fn begin(&mut self, grasp: &Grasp) {
        self.began_latched = grasp.phase() == Phase::Grasped;
    }

    fn end(&mut self, grasp: &Grasp, time: f64, elapsed: f64) {
        if std::mem::take(&mut self.began_latched) {
            self.latched += elapsed;
            self.merged += if grasp.limits() == Limits::Cones { 0.0 } else { elapsed };
        } else if grasp.phase() == Phase::Grasped {
            self.latched_at = Some(time + elapsed);
        }
    }
}
