//! How hard a hand presses, as one number that can be varied.

use super::control::Entry;
use super::error::{Error, Field};
use super::plan::Plan;
use super::runner::{Mode, Runner};
use crate::mujoco::{ActuatorId, BodyId, Simulation};

/// Strengths of closing, from the starting targets (0) to the scenario's own (1).
const SHARES: usize = 12;
/// Strengths of fingertip goals: half powers of two about the scenario's own latch quality.
const POWERS: std::ops::RangeInclusive<i32> = -8..=6;

/// What is varied.
#[derive(Clone, Debug)]
pub enum Press {
    /// Fingertip goals press until a quality is reached: that quality \[N\].
    Goals {
        /// The scenario's own.
        own: f64,
    },
    /// `[[control]]` closes the fingers: their targets' share of the way from the start to the scenario's own.
    Closing {
        /// (actuator, its target at the start)
        fingers: Vec<(usize, f64)>,
    },
}

impl Press {
    /// What the first grasp of a scenario presses with.
    ///
    /// # Errors
    /// A scenario that cannot be set up, or whose controls move no finger.
    pub fn of(plan: &Plan) -> Result<Self, Error> {
        let runner = Runner::new(plan, Mode::Full, None)?;
        if plan.goals.iter().any(|g| g.grasp == 0) {
            return Ok(Self::Goals { own: runner.grasp().latch_quality() });
        }
        let sim = runner.sim();
        let fingers = finger_actuators(sim, runner.grasp().palm());
        let moved = |a: &usize| plan.controls.iter().any(|c| c.all.is_some() || c.set.iter().any(|(i, _)| i == a));
        if !fingers.iter().any(moved) {
            let field = Field::new(&plan.file, "control");
            return Err(field.wrong(
                "moves no actuator below the palm, and there is no [[goal]]; calibrate varies how hard the fingers press",
            ));
        }
        Ok(Self::Closing { fingers: fingers.into_iter().map(|a| (a, sim.ctrl()[a])).collect() })
    }

    /// What a strength means.
    pub fn unit(&self) -> &'static str {
        match self {
            Self::Goals { .. } => "quality that the fingertips press for [N]",
            Self::Closing { .. } => "share of the closing",
        }
    }

    /// Strengths to begin with, from the weakest.
    pub fn strengths(&self) -> Vec<f64> {
        match self {
            Self::Goals { own } => POWERS.map(|k| own * 2_f64.powf(0.5 * f64::from(k))).collect(),
            Self::Closing { .. } => (1..=SHARES).map(|k| k as f64 / SHARES as f64).collect(),
        }
    }

    /// Whether a hand that rests with this quality presses no harder any more: fingertips that do not reach the quality
    /// they press for go on for ever.
    pub fn is_done(&self, strength: f64, quality: f64) -> bool {
        match self {
            Self::Goals { .. } => quality >= 0.95 * strength,
            Self::Closing { .. } => true,
        }
    }

    /// A strength between two.
    pub fn between(&self, a: f64, b: f64) -> f64 {
        match self {
            Self::Goals { .. } => (a * b).sqrt(),
            Self::Closing { .. } => 0.5 * (a + b),
        }
    }

    /// The scenario with its hand pressing so hard.
    pub fn apply(&self, plan: &Plan, strength: f64) -> Plan {
        let mut plan = plan.clone();
        match self {
            Self::Goals { .. } => {
                plan.grasps[0].latch_quality = Some(strength);
                plan.grasps[0].release_quality = Some(0.0);
            }
            Self::Closing { fingers } => {
                for entry in &mut plan.controls {
                    *entry = closed(entry, fingers, strength);
                }
            }
        }
        plan
    }
}

/// The entry with the fingers' targets only a share of the way from their start.
fn closed(entry: &Entry, fingers: &[(usize, f64)], share: f64) -> Entry {
    let mut set = entry.set.clone();
    for &(finger, start) in fingers {
        let own = set.iter().rev().find(|(i, _)| *i == finger).map(|(_, value)| *value);
        if let Some(target) = own.or(entry.all) {
            // The last one of an actuator counts.
            set.push((finger, start + share * (target - start)));
        }
    }
    Entry { time: entry.time, all: entry.all, set }
}

/// Actuators that move nothing but joints below the palm, whatever their transmission.
pub fn finger_actuators(sim: &Simulation, palm: BodyId) -> Vec<usize> {
    let model = sim.model();
    let nv = model.nv();
    let below_palm: Vec<bool> = (0..nv)
        .map(|dof| {
            let mut body = model.dof_bodyid()[dof] as usize;
            // Bodies come after their parents.
            while body > palm.index() {
                body = model.body_parentid()[body] as usize;
                if body == palm.index() {
                    return true;
                }
            }
            false
        })
        .collect();
    let mut row = vec![0.0; nv];
    (0..model.nu())
        .filter(|&a| {
            // it exists, and the row has its length
            let _ = sim.actuator_moment_into(ActuatorId::from_index(a), &mut row);
            let mut moved = (0..nv).filter(|&dof| row[dof] != 0.0).peekable();
            moved.peek().is_some() && moved.all(|dof| below_palm[dof])
        })
        .collect()
}
