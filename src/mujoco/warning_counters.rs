//! The engine's warning counters, looked at after every call.

use super::compat;
use super::error::{Buffer, Error};
use super::ffi;
use super::guard;
use super::ids::{ActuatorId, JointId};
use super::simulation::Simulation;
use super::warnings::{KINDS, Tally, Warning, WarningKind};

/// A text is kept once, and no more than these.
const MAX_TEXTS: usize = 32;

impl Simulation {
    /// The engine's warnings since the last time this was called.
    pub fn take_warnings(&mut self) -> Vec<Warning> {
        let taken = std::mem::take(&mut self.warnings);
        let counted =
            compat::COUNTED.into_iter().zip(taken.counted).filter(|(_, tally)| tally.count > 0).map(|(kind, tally)| {
                Warning { kind, count: tally.count, info: tally.info, time: tally.time, text: String::new() }
            });
        let other = taken.texts.into_iter().map(|(time, text)| Warning {
            kind: WarningKind::Other,
            count: 1,
            info: 0,
            time,
            text,
        });
        counted.chain(other).collect()
    }

    /// Looks at the engine's counters after a call that started at `time`.
    #[inline]
    pub(super) fn look_for_warnings(&mut self, time: f64) -> Result<(), Error> {
        let any = self.data().warning.iter().any(|warning| warning.number != 0);
        if any || guard::has_texts() { self.record_warnings(time) } else { Ok(()) }
    }

    /// Moves the counters into the tally. They are cleared in the engine's data, because a reset by the engine also
    /// clears them: only from zero can every new warning be seen.
    #[cold]
    fn record_warnings(&mut self, time: f64) -> Result<(), Error> {
        let mut found = [None; KINDS];
        for (i, found) in found.iter_mut().enumerate() {
            let counter = &mut self.data_mut().warning[i];
            let (number, info) = (counter.number, counter.lastinfo);
            counter.number = 0;
            if number > 0 {
                *found = Some(info);
                let tally = &mut self.warnings.counted[i];
                *tally = Tally { count: tally.count + number as u64, info, time };
            }
        }
        let counted = found.iter().any(Option::is_some);
        for text in guard::take_texts() {
            // The counted kinds also give a text, which ends with the time.
            let repeated = counted && text.contains(" Time = ");
            let known = self.warnings.texts.iter().any(|(_, old)| *old == text);
            if !repeated && !known && self.warnings.texts.len() < MAX_TEXTS {
                self.warnings.texts.push((time, text));
            }
        }
        self.worst(&found, time)
    }

    /// The error that the warnings of one call mean, the gravest first.
    fn worst(&self, found: &[Option<i32>; KINDS], time: f64) -> Result<(), Error> {
        let info = |kind: u32| found[kind as usize].map(|info| usize::try_from(info).unwrap_or(0));
        if let Some(index) = info(ffi::mjWARN_BADQPOS) {
            return Err(self.diverged("qpos", index, time));
        }
        if let Some(index) = info(ffi::mjWARN_BADQVEL) {
            return Err(self.diverged("qvel", index, time));
        }
        if let Some(index) = info(ffi::mjWARN_BADQACC) {
            return Err(self.diverged("qacc", index, time));
        }
        if let Some(size) = info(ffi::mjWARN_CONTACTFULL) {
            return Err(Error::BufferFull { buffer: Buffer::Contacts, size, time });
        }
        if let Some(size) = info(ffi::mjWARN_CNSTRFULL) {
            return Err(Error::BufferFull { buffer: Buffer::Constraints, size, time });
        }
        if let Some(index) = info(ffi::mjWARN_BADCTRL) {
            let actuator = self.model().label(ActuatorId::from_index(index));
            let value = self.ctrl().get(index).copied().unwrap_or(f64::NAN);
            return Err(Error::BadControl { actuator, value, time });
        }
        Ok(())
    }

    fn diverged(&self, quantity: &'static str, index: usize, time: f64) -> Error {
        let model = self.model();
        let joint = if quantity == "qpos" {
            // The last joint whose address is not beyond the index.
            model.jnt_qposadr().iter().rposition(|&start| start as usize <= index)
        } else {
            model.dof_jntid().get(index).map(|&joint| joint as usize)
        };
        let element = joint.map_or_else(String::new, |joint| {
            let body = model.jnt_bodyid()[joint] as usize;
            format!(
                "{} of {}",
                model.label(JointId::from_index(joint)),
                model.label(super::ids::BodyId::from_index(body))
            )
        });
        Error::Diverged { quantity, index, element, time }
    }
}
