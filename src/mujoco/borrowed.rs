//! A simulation in memory that belongs to another binding of the same library in this process, such as Python's.

mod watch;

use super::compiled::CompiledModel;
use super::error::Error;
use super::ffi;
use super::model;
use super::simulation::Simulation;
use super::warnings::{KINDS, Warning, Warnings};
use super::{compat, guard};
use std::ffi::c_void;
use std::ptr::NonNull;
use watch::Watch;

/// A [`Simulation`] that works in place on a model and data of somebody else, who goes on using them between two
/// [`visits`](Self::visit). After a visit the thread's handlers, the model's options and the counters of warnings are what
/// `mj_step` would have left; what the owner changes in between is noticed at the next.
#[derive(Debug)]
pub struct Borrowed {
    sim: Simulation,
    arrays: [*const c_void; 2],
    watch: Watch,
    warnings: Vec<Warning>,
}

// SAFETY: the pointers of `arrays` are only compared.
unsafe impl Send for Borrowed {}

/// Options that a step may change for its own time.
struct Options {
    disable: i32,
    enable: i32,
    noslip_iterations: i32,
    jacobian: i32,
}

/// A warning's count and its last number.
type Counter = (i32, i32);

impl Borrowed {
    /// Borrows a model and its data; nothing in them is changed, copied or ever freed.
    ///
    /// # Errors
    /// [`Error::Version`] if the library in this process is not the one that the crate was built for; [`Error::Load`] for a
    /// model with which the crate does not work, as if it had loaded it.
    ///
    /// # Safety
    /// `model` and `data` are an `mjModel` and an `mjData` that was made from it, both of the version of MuJoCo that the
    /// headers of this crate have, in the one library of this process. They stay valid and where they are for as long as the
    /// value lives, with arrays of the same sizes. During a visit nobody else uses them.
    pub unsafe fn new(model: NonNull<c_void>, data: NonNull<c_void>) -> Result<Self, Error> {
        if let Some(library) = compat::other_library() {
            return Err(Error::Version { header: compat::header_version(), library });
        }
        guard::visit(|| {
            // SAFETY: as the caller promises.
            let compiled = unsafe { CompiledModel::lent(model.cast()) };
            model::check(&compiled)
                .map_err(|message| Error::Load { what: "the model that is borrowed".into(), message })?;
            let sim = Simulation::from_parts(compiled, data.cast().as_ptr(), "borrow")?;
            Ok(Self { arrays: arrays(&sim), watch: Watch::new(&sim), sim, warnings: Vec::new() })
        })
    }

    /// The simulation, for reading; its owner must not write meanwhile.
    pub fn sim(&self) -> &Simulation {
        &self.sim
    }

    /// Runs `work` on the simulation. `frozen` says that `work` may go on from where the last visit has ended, by
    /// [`Grasps::substep`](crate::grasp::Grasps::substep): then the owner's changes since are looked for, while a visit
    /// without it counts as preceded by some.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the owner has moved the arrays, or has set a callback that stages of a step of this crate
    /// would leave out.
    pub fn visit<R>(&mut self, frozen: bool, work: impl FnOnce(&mut Simulation) -> R) -> Result<R, Error> {
        guard::visit(|| {
            self.check()?;
            self.sim.clear_interruption();
            self.watch.look(&mut self.sim, frozen);
            let visit = Visit::begin(&mut self.sim, &mut self.warnings);
            let result = work(visit.sim);
            drop(visit);
            self.watch.remember(&self.sim, frozen);
            Ok(result)
        })
    }

    /// What the engine has warned of in the visits since the last call.
    pub fn take_warnings(&mut self) -> Vec<Warning> {
        std::mem::take(&mut self.warnings)
    }

    fn check(&self) -> Result<(), Error> {
        if arrays(&self.sim) != self.arrays {
            return Err(Error::Unsupported("the arrays of the model or of its data have moved: borrow them again".into()));
        }
        match callback() {
            Some(name) => Err(Error::Unsupported(format!(
                "{name} is set, which the steps of a grasp would leave out: unset it, and do before each step what it does"
            ))),
            None => Ok(()),
        }
    }
}

/// Where the arrays are.
fn arrays(sim: &Simulation) -> [*const c_void; 2] {
    [sim.model_fields().buffer.cast_const(), sim.data().buffer.cast_const()]
}

/// A callback of the process that is not called where it would be in `mj_step`.
fn callback() -> Option<&'static str> {
    unsafe extern "C" {
        static mjcb_control: *const c_void;
        static mjcb_contactfilter: *const c_void;
    }
    // SAFETY: pointers that the library defines. Whoever sets one while a step runs cannot say whether it is called in it.
    let set = unsafe { [(&raw const mjcb_control).read_volatile(), (&raw const mjcb_contactfilter).read_volatile()] };
    set.into_iter().zip(["mjcb_control", "mjcb_contactfilter"]).find_map(|(callback, name)| {
        let is_set = !callback.is_null();
        is_set.then_some(name)
    })
}

/// The owner's options and counters while they are replaced; they are back when it is dropped.
struct Visit<'a> {
    sim: &'a mut Simulation,
    warnings: &'a mut Vec<Warning>,
    options: Options,
    counters: [Counter; KINDS],
}

impl<'a> Visit<'a> {
    fn begin(sim: &'a mut Simulation, warnings: &'a mut Vec<Warning>) -> Self {
        let (_, data) = sim.pointers();
        // Only from zero can every new warning be seen.
        // SAFETY: the visit is exclusive.
        let counters = unsafe { &mut (*data).warning }.each_mut().map(|counter| {
            let before = (counter.number, counter.lastinfo);
            counter.number = 0;
            before
        });
        sim.warnings = Warnings::default();
        Self { options: Options::of(sim), sim, warnings, counters }
    }
}

impl Drop for Visit<'_> {
    fn drop(&mut self) {
        self.options.put_back(self.sim);
        let counted = self.sim.warnings.counted;
        let is_reset = [ffi::mjWARN_BADQPOS, ffi::mjWARN_BADQVEL, ffi::mjWARN_BADQACC];
        // A reset by the engine clears what was counted before it.
        let is_reset = is_reset.into_iter().any(|kind| counted[kind as usize].count > 0);
        let (_, data) = self.sim.pointers();
        // SAFETY: the visit is exclusive.
        let counters = unsafe { &mut (*data).warning };
        for ((counter, before), new) in counters.iter_mut().zip(self.counters).zip(counted) {
            let (number, info) = if is_reset { (0, 0) } else { before };
            counter.number = number.saturating_add(i32::try_from(new.count).unwrap_or(i32::MAX));
            counter.lastinfo = if new.count > 0 { new.info } else { info };
        }
        if counted.iter().any(|tally| tally.count > 0) || !self.sim.warnings.texts.is_empty() {
            self.warnings.extend(self.sim.take_warnings());
        }
    }
}

impl Options {
    fn of(sim: &Simulation) -> Self {
        let options = &sim.model_fields().opt;
        Self {
            disable: options.disableflags,
            enable: options.enableflags,
            noslip_iterations: options.noslip_iterations,
            jacobian: options.jacobian,
        }
    }

    fn put_back(&self, sim: &mut Simulation) {
        let now = Self::of(sim);
        if (now.noslip_iterations, now.jacobian) != (self.noslip_iterations, self.jacobian) {
            // Rows are stored, and projected, as the options say.
            sim.forget_contacts();
        }
        let (model, _) = sim.pointers();
        // SAFETY: the visit is exclusive.
        let options = unsafe { &mut (*model).opt };
        (options.disableflags, options.enableflags) = (self.disable, self.enable);
        (options.noslip_iterations, options.jacobian) = (self.noslip_iterations, self.jacobian);
    }
}

#[cfg(test)]
mod tests;
