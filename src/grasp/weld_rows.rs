//! The constraint rows of merged grasps: the engine makes them with its own, in the weld's place, and they are overwritten.
//!
//! A weld is in the model for its six rows only. It is switched on while the rows are made and off right after, so that
//! nothing else ever sees it active.

use super::error::Error;
use super::weld::rows::WELD_ROWS;
use super::{Grasp, Grasps};
use crate::mujoco::Simulation;
use std::ops::Range;

impl Grasps {
    /// Makes the engine's constraint rows, with the weld rows of each latched merged grasp that has contacts.
    pub(super) fn make_constraint(&mut self, sim: &mut Simulation) -> Result<(), Error> {
        self.list.iter_mut().for_each(Grasp::forget_weld_rows);
        let count = self.welded().count();
        if count == 0 {
            return Ok(sim.make_constraint()?);
        }
        self.switch_welds(sim, true)?;
        let made = sim.make_constraint();
        self.switch_welds(sim, false)?;
        made?;
        self.check_weld_rows(sim, count)?;
        // All rows of all welds are alike until they are overwritten: the rigid ones come first, then those with bounds.
        let relaxed = self.welded().map(Grasp::relaxed_count).sum();
        let (mut rigid, mut bounded) = (sim.ne() - WELD_ROWS * count, sim.ne() - relaxed);
        sim.make_friction_rows(relaxed)?;
        for grasp in self.list.iter_mut().filter(|g| g.wants_weld()) {
            grasp.write_weld_rows(sim, &mut rigid, &mut bounded)?;
        }
        Ok(())
    }

    /// The welds' rows of this step, once they are made: the last equalities and the first friction rows.
    pub(super) fn weld_rows(&self, sim: &Simulation) -> Range<usize> {
        let end = sim.ne() + self.welded().map(Grasp::relaxed_count).sum::<usize>();
        end.saturating_sub(WELD_ROWS * self.welded().count())..end
    }

    fn welded(&self) -> impl Iterator<Item = &Grasp> {
        self.list.iter().filter(|g| g.wants_weld())
    }

    fn switch_welds(&self, sim: &mut Simulation, on: bool) -> Result<(), Error> {
        for weld in self.welded().filter_map(Grasp::weld) {
            sim.set_equality_active(weld, on)?;
        }
        Ok(())
    }

    /// That the rows of `count` welds are the last of the equality rows, six for each weld, each weld of one grasp.
    fn check_weld_rows(&self, sim: &Simulation, count: usize) -> Result<(), Error> {
        let missing = || Error::WeldRows { time: sim.time(), welds: count };
        let start = sim.ne().checked_sub(WELD_ROWS * count).ok_or_else(missing)?;
        for (i, grasp) in self.welded().enumerate() {
            let rows = grasp.weld().and_then(|weld| sim.equality_rows(weld));
            let complete = rows.is_some_and(|r| r.len() == WELD_ROWS && r.start >= start);
            let shared = self.welded().take(i).any(|other| other.weld() == grasp.weld());
            if !complete || shared {
                return Err(missing());
            }
        }
        Ok(())
    }
}
