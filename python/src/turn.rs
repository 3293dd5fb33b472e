//! Whose turn it is: one thread at a time steps a data, whichever grasps it does it with.

use crate::errors::BusyError;
use pyo3::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// All data of the process that grasps are made for, by address.
static KNOWN: Mutex<Option<HashMap<usize, Weak<AtomicBool>>>> = Mutex::new(None);

/// Of one data: taken, or free.
#[derive(Clone)]
pub struct Turn(Arc<AtomicBool>);

/// While it lives nobody else can take the turn.
pub struct Taken<'a>(&'a AtomicBool);

impl Turn {
    /// That of the data at this address.
    pub fn of(address: usize) -> Self {
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let known = known.get_or_insert_default();
        if let Some(turn) = known.get(&address).and_then(Weak::upgrade) {
            return Self(turn);
        }
        known.retain(|_, turn| turn.strong_count() > 0);
        let turn = Arc::default();
        known.insert(address, Arc::downgrade(&turn));
        Self(turn)
    }

    /// Takes it.
    ///
    /// # Errors
    /// [`BusyError`] if another thread has it.
    pub fn take(&self) -> PyResult<Taken<'_>> {
        if self.0.swap(true, Ordering::Acquire) {
            return Err(BusyError::new_err(
                "another thread is stepping this MjData: one at a time, or data and grasps of its own for each thread (a \
                 model can be shared)",
            ));
        }
        Ok(Taken(&self.0))
    }
}

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}
