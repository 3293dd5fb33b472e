//! A simulation: a private copy of a model, and the data that the engine computes with.

use super::compat;
use super::compiled::CompiledModel;
use super::error::{Error, check_index};
use super::ffi;
use super::guard;
use super::ids::{EqualityId, Id, KeyframeId};
use super::model::Model;
use super::warnings::Warnings;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};

/// A running simulation. It owns a private copy of its model, so edits (`eq_data_mut`, `set_timestep`, ...) are
/// exclusive and simulations run in parallel threads. It can move between threads, but not be shared.
///
/// After an engine fault ([`Error::Engine`]) inside a call that computes, the results are half done: every such call
/// then returns [`Error::Interrupted`] until [`reset`](Self::reset), [`reset_to_keyframe`](Self::reset_to_keyframe) or
/// [`restore`](Self::restore). Reading stays possible.
pub struct Simulation {
    model: CompiledModel,
    data: NonNull<ffi::mjData>,
    interrupted: Option<(&'static str, String)>,
    pub(super) warnings: Warnings,
    deferred: Deferred,
    stamp: Stamp,
}

/// Tells one moment of one simulation from all others: it changes with whatever may change what the next step is computed
/// from, velocities, activations and inputs (`ctrl_mut` and the like) apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stamp {
    simulation: u64,
    change: u64,
}

impl Stamp {
    fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Stamp { simulation: NEXT.fetch_add(1, Ordering::Relaxed), change: 0 }
    }
}

/// Warnings that do not end a step, until its end.
#[derive(Debug, Default)]
enum Deferred {
    /// Each call reports its own.
    #[default]
    Off,
    /// In the midst of a step, with the gravest so far.
    Until(Option<Error>),
}

// SAFETY: both structures are plain memory owned by this value alone, or lent to it; the engine keeps no pointer to them, and
// its thread-local handlers are installed on whichever thread calls.
unsafe impl Send for Simulation {}

impl Drop for Simulation {
    fn drop(&mut self) {
        if !self.model.is_owned() {
            return;
        }
        // SAFETY: allocated by the engine, freed once.
        let _ = guard::call("mj_deleteData", || unsafe { ffi::mj_deleteData(self.data.as_ptr()) });
    }
}

impl std::fmt::Debug for Simulation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Simulation {{ time: {}, model: {:?} }}", self.time(), self.model)
    }
}

impl Clone for Simulation {
    /// An independent copy of everything: model, state, results. Like any clone, it aborts when memory runs out; see
    /// [`try_clone`](Self::try_clone).
    fn clone(&self) -> Self {
        match self.try_clone() {
            Ok(copy) => copy,
            // The only fault that copying valid structures has is a failed allocation.
            Err(_) => std::alloc::handle_alloc_error(std::alloc::Layout::new::<ffi::mjData>()),
        }
    }
}

impl Simulation {
    /// A simulation at the model's initial configuration, time 0. Nothing is computed yet: see
    /// [`forward`](Self::forward).
    pub fn new(model: &Model) -> Result<Self, Error> {
        let model = model.compiled().duplicate()?;
        // SAFETY: the model is valid.
        let data = guard::call("mj_makeData", || unsafe { ffi::mj_makeData(model.as_ptr()) })?;
        Self::from_parts(model, data, "mj_makeData")
    }

    /// An independent copy of everything: model, state, results.
    pub fn try_clone(&self) -> Result<Self, Error> {
        let model = self.model.duplicate()?;
        // SAFETY: a null destination makes the engine allocate; model and data belong together.
        let data = guard::call("mj_copyData", || unsafe {
            ffi::mj_copyData(std::ptr::null_mut(), model.as_ptr(), self.data.as_ptr())
        })?;
        let mut copy = Self::from_parts(model, data, "mj_copyData")?;
        compat::complete_copy(self.model_fields(), self.data(), copy.data_mut());
        copy.interrupted = self.interrupted.clone();
        copy.warnings = self.warnings.clone();
        Ok(copy)
    }

    pub(super) fn from_parts(model: CompiledModel, data: *mut ffi::mjData, call: &'static str) -> Result<Self, Error> {
        match NonNull::new(data) {
            Some(data) => {
                let (warnings, stamp) = (Warnings::default(), Stamp::new());
                Ok(Self { model, data, interrupted: None, warnings, deferred: Deferred::Off, stamp })
            }
            None => {
                let message = guard::take_texts().join("; ");
                Err(Error::Engine { call, message: format!("no data was returned. {message}") })
            }
        }
    }

    /// The simulation's own model, for reading.
    pub fn model(&self) -> &CompiledModel {
        &self.model
    }

    /// Back to the model's initial configuration at time 0. Edits of the model stay; applied forces, controls and
    /// results are cleared, and so is an interruption by a fault.
    pub fn reset(&mut self) -> Result<(), Error> {
        self.interrupted = None;
        // SAFETY: model and data belong together.
        self.run("mj_resetData", |m, d| unsafe { ffi::mj_resetData(m, d) })
    }

    /// As [`reset`](Self::reset), then to the time, positions, velocities, activations, mocap poses and controls of a
    /// keyframe.
    pub fn reset_to_keyframe(&mut self, key: KeyframeId) -> Result<(), Error> {
        check_index(KeyframeId::KIND, key.index(), self.model.nkey())?;
        self.interrupted = None;
        // SAFETY: model and data belong together, and the keyframe exists.
        self.run("mj_resetDataKeyframe", |m, d| unsafe { ffi::mj_resetDataKeyframe(m, d, key.index() as i32) })
    }

    /// Sets the simulation time, s.
    pub fn set_time(&mut self, time: f64) -> Result<(), Error> {
        super::error::check_value("the time", time, "finite", |_| true)?;
        self.data_mut().time = time;
        Ok(())
    }

    /// Whether an equality constraint is switched on.
    pub fn is_equality_active(&self, id: EqualityId) -> Result<bool, Error> {
        check_index(EqualityId::KIND, id.index(), self.model.neq())?;
        // SAFETY: `neq` switches, and the index is below that.
        let active = unsafe { *compat::eq_active(self.model.as_ptr().cast_mut(), self.data.as_ptr()).add(id.index()) };
        Ok(active != 0)
    }

    /// Switches an equality constraint on or off, from the next making of constraints.
    pub fn set_equality_active(&mut self, id: EqualityId, active: bool) -> Result<(), Error> {
        check_index(EqualityId::KIND, id.index(), self.model.neq())?;
        self.note_change();
        let switches = compat::eq_active(self.model.as_mut_ptr(), self.data.as_ptr());
        // SAFETY: as above, and `&mut self` makes the write exclusive.
        unsafe { *switches.add(id.index()) = active.into() };
        Ok(())
    }

    /// Runs an engine function that computes on the data: refused after a fault, and followed by a look at the
    /// engine's warnings.
    #[inline]
    pub(super) fn run<R>(
        &mut self,
        call: &'static str,
        f: impl FnOnce(*mut ffi::mjModel, *mut ffi::mjData) -> R,
    ) -> Result<R, Error> {
        if let Some((call, message)) = &self.interrupted {
            return Err(Error::Interrupted { call, message: message.clone() });
        }
        self.note_change();
        let time = self.time();
        let (m, d) = (self.model.as_mut_ptr(), self.data.as_ptr());
        match guard::call(call, || f(m, d)) {
            Ok(result) => {
                self.look_for_warnings(time).or_else(|warning| self.defer(warning))?;
                Ok(result)
            }
            Err(fault) => Err(self.interrupt(fault)),
        }
    }

    /// From now on warnings wait for [`take_deferred`](Self::take_deferred).
    pub(super) fn defer_warnings(&mut self) {
        self.deferred = Deferred::Until(None);
    }

    /// The gravest warning since [`defer_warnings`](Self::defer_warnings); calls report their own again.
    pub(super) fn take_deferred(&mut self) -> Result<(), Error> {
        match std::mem::take(&mut self.deferred) {
            Deferred::Until(Some(warning)) => Err(warning),
            _ => Ok(()),
        }
    }

    /// Whether a deferred warning tells that the engine has reset the data.
    pub(super) fn has_diverged(&self) -> bool {
        matches!(self.deferred, Deferred::Until(Some(Error::Diverged { .. })))
    }

    #[cold]
    fn defer(&mut self, warning: Error) -> Result<(), Error> {
        match &mut self.deferred {
            Deferred::Off => return Err(warning),
            Deferred::Until(worst @ None) => *worst = Some(warning),
            Deferred::Until(Some(worst))
                if matches!(warning, Error::Diverged { .. }) && !matches!(worst, Error::Diverged { .. }) =>
            {
                *worst = warning;
            }
            Deferred::Until(Some(_)) => {}
        }
        Ok(())
    }

    /// Runs an engine function that changes nothing but the caller's buffers (and, for a while, the stack).
    #[inline]
    pub(super) fn query<R>(
        &self,
        call: &'static str,
        f: impl FnOnce(*const ffi::mjModel, *mut ffi::mjData) -> R,
    ) -> Result<R, Error> {
        let d = self.data.as_ptr();
        guard::call(call, || f(self.model.as_ptr(), d)).inspect_err(|_| {
            // SAFETY: between calls nothing is on the engine's stack; the fault skipped the code that empties it.
            compat::empty_stack(unsafe { &mut *d });
        })
    }

    /// After a fault: the stack is emptied (the engine skipped that), the rows are forgotten, and the simulation is
    /// marked so that no further stage builds on half-done results.
    #[cold]
    fn interrupt(&mut self, fault: Error) -> Error {
        compat::empty_stack(self.data_mut());
        self.forget_contacts();
        if let Error::Engine { call, message } = &fault {
            self.interrupted = Some((call, message.clone()));
        }
        fault
    }

    /// A lent simulation's owner goes on after a fault as it likes: each step computes all from the state.
    pub(super) fn clear_interruption(&mut self) {
        self.interrupted = None;
    }

    /// A lent model has been edited by its owner in what is derived from it.
    pub(super) fn renew_model(&mut self) {
        self.note_change();
        self.model.renew_origin();
    }

    /// Whether a fault has interrupted the simulation; see [`Simulation`].
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.is_some()
    }

    /// The present moment.
    pub(crate) fn stamp(&self) -> Stamp {
        self.stamp
    }

    /// Before anything but an input is changed.
    #[inline]
    pub(super) fn note_change(&mut self) {
        self.stamp.change += 1;
    }

    /// Before velocities, activations or inputs are changed: they are read anew in every step.
    #[inline]
    #[allow(clippy::unused_self)] // in the place of `note_change`
    pub(super) fn note_input(&mut self) {}

    /// Both structures, for reaching what moves between versions.
    pub(super) fn pointers(&self) -> (*mut ffi::mjModel, *mut ffi::mjData) {
        (self.model.as_ptr().cast_mut(), self.data.as_ptr())
    }

    /// Drops the current contacts and constraint rows, because what they refer to changes.
    pub(super) fn forget_contacts(&mut self) {
        self.data_mut().ncon = 0;
        self.forget_rows();
    }

    /// Drops the current constraint rows.
    pub(super) fn forget_rows(&mut self) {
        compat::forget_rows(self.data_mut());
    }

    #[inline]
    pub(super) fn data(&self) -> &ffi::mjData {
        // SAFETY: valid for as long as `self`; whatever writes it takes `&mut self`.
        unsafe { self.data.as_ref() }
    }

    #[inline]
    pub(super) fn data_mut(&mut self) -> &mut ffi::mjData {
        self.note_change();
        // SAFETY: valid for as long as `self`, and exclusive.
        unsafe { self.data.as_mut() }
    }

    /// The structure that holds the array sizes.
    #[inline]
    pub(super) fn sizes(&self) -> &ffi::mjModel {
        self.model_fields()
    }

    #[inline]
    pub(super) fn model_fields(&self) -> &ffi::mjModel {
        // SAFETY: valid for as long as `self`.
        unsafe { &*self.model.as_ptr() }
    }

    #[inline]
    pub(super) fn model_fields_mut(&mut self) -> &mut ffi::mjModel {
        self.note_change();
        // SAFETY: valid for as long as `self`, and exclusive.
        unsafe { &mut *self.model.as_mut_ptr() }
    }
}
