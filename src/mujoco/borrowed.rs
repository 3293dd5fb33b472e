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
/// [`visits`](Self::visit). After a visit the thread's handlers and the counters of warnings are what `mj_step` would have
/// left; what the owner changes in between is noticed at the next. The model is never written: several threads may step data
/// of their own with it.
pub struct Borrowed {
    sim: Simulation,
    owners: NonNull<ffi::mjModel>,
    /// What `sim` has for a model: the owner's arrays, and options of its own, which a step may change.
    model: NonNull<ffi::mjModel>,
    data: *const c_void,
    watch: Watch,
    warnings: Vec<Warning>,
}

// SAFETY: the memory is the value's alone, or lent to it, as that of a `Simulation`.
unsafe impl Send for Borrowed {}

impl Drop for Borrowed {
    fn drop(&mut self) {
        // SAFETY: it comes from a box, and `sim`, which is dropped next, does not touch a model that it does not own.
        drop(unsafe { Box::from_raw(self.model.as_ptr()) });
    }
}

impl std::fmt::Debug for Borrowed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Borrowed").field("sim", &self.sim).finish_non_exhaustive()
    }
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
    /// value lives, with arrays of the same sizes; a `Simulation` must not be moved out of it. During a visit nobody else uses
    /// the data or writes the model.
    pub unsafe fn new(model: NonNull<c_void>, data: NonNull<c_void>) -> Result<Self, Error> {
        if let Some(library) = compat::other_library() {
            return Err(Error::Version { header: compat::header_version(), library });
        }
        let owners: NonNull<ffi::mjModel> = model.cast();
        guard::visit(|| {
            // SAFETY: as the caller promises; the structure is plain numbers and pointers.
            let model = NonNull::from(Box::leak(Box::new(unsafe { owners.read() })));
            // SAFETY: valid for as long as `Borrowed`, and so its arrays, as the caller promises.
            let compiled = unsafe { CompiledModel::lent(model) };
            let checked = model::check(&compiled);
            let sim = Simulation::from_parts(compiled, data.cast().as_ptr(), "borrow")?;
            let buffer = sim.data().buffer.cast_const();
            let (watch, warnings) = (Watch::new(&sim), Vec::new());
            let borrowed = Self { sim, owners, model, data: buffer, watch, warnings };
            match checked {
                Ok(()) => Ok(borrowed),
                Err(message) => Err(Error::Load { what: "the model that is borrowed".into(), message }),
            }
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
            self.take_options();
            self.watch.look(&mut self.sim, frozen);
            let visit = Visit::begin(&mut self.sim, &mut self.warnings);
            let result = work(visit.sim);
            drop(visit);
            self.watch.remember(&self.sim);
            Ok(result)
        })
    }

    /// What the engine has warned of in the visits since the last call.
    pub fn take_warnings(&mut self) -> Vec<Warning> {
        std::mem::take(&mut self.warnings)
    }

    /// The owner's options as they are now.
    fn take_options(&mut self) {
        let (model, _) = self.sim.pointers();
        // SAFETY: both are valid, and the copy is this value's own.
        unsafe {
            (*model).opt = (*self.owners.as_ptr()).opt;
            (*model).stat = (*self.owners.as_ptr()).stat;
        }
    }

    fn check(&self) -> Result<(), Error> {
        // SAFETY: valid, as the caller of `new` has promised.
        let owners = unsafe { self.owners.as_ref() };
        let here = self.sim.model_fields();
        let model = (owners.buffer, owners.nbuffer) == (here.buffer, here.nbuffer);
        if !model || self.sim.data().buffer.cast_const() != self.data {
            return Err(Error::Unsupported(
                "the arrays of the model or of its data have moved: borrow them again".into(),
            ));
        }
        match callback() {
            Some(name) => Err(Error::Unsupported(format!(
                "{name} is set, which cannot be called in the steps of a grasp: unset it, and do before each step what it does \
                 (qfrc_applied and xfrc_applied take forces)"
            ))),
            None => Ok(()),
        }
    }
}

/// A callback of the process that is not called where it would be in `mj_step`, or would be with a model that its owner does not
/// know: the steps' options are those of a copy.
fn callback() -> Option<&'static str> {
    macro_rules! callbacks {
        ($($name:ident),*) => {{
            unsafe extern "C" { $(static $name: *const c_void;)* }
            // SAFETY: pointers that the library defines. Whoever sets one while a step runs cannot say whether it is called in it.
            [$((unsafe { (&raw const $name).read_volatile() }, stringify!($name))),*]
        }};
    }
    let all = callbacks![
        mjcb_control,
        mjcb_contactfilter,
        mjcb_passive,
        mjcb_sensor,
        mjcb_act_dyn,
        mjcb_act_gain,
        mjcb_act_bias
    ];
    all.into_iter().find_map(|(callback, name)| (!callback.is_null()).then_some(name))
}

/// The owner's counters while they are replaced; they are back when it is dropped.
struct Visit<'a> {
    sim: &'a mut Simulation,
    warnings: &'a mut Vec<Warning>,
    /// Options by which rows are stored and projected.
    of_rows: (i32, i32),
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
        Self { of_rows: of_rows(sim), sim, warnings, counters }
    }
}

impl Drop for Visit<'_> {
    fn drop(&mut self) {
        if of_rows(self.sim) != self.of_rows {
            // The owner's options say something else of them.
            self.sim.forget_contacts();
        }
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

/// Iterations of the noslip solver, and storage of the Jacobian.
fn of_rows(sim: &Simulation) -> (i32, i32) {
    let options = &sim.model_fields().opt;
    (options.noslip_iterations, options.jacobian)
}

#[cfg(test)]
mod tests;
