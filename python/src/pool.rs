//! Pools of threads that outlive a fork: their threads do not, so a child makes itself another.

use crate::errors::SpecError;
use pyo3::PyResult;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, Mutex, PoisonError};

/// Of one process at a time. Its lock is only had with the GIL, as a fork is made by Python: it is free in the child.
pub struct Pool {
    threads: usize,
    made: Mutex<Option<(u32, Arc<ThreadPool>)>>,
}

/// That of scenarios and sweeps.
pub static SHARED: Pool = Pool::new(0);

impl Pool {
    /// Of as many threads; 0: as there are cores, or `RAYON_NUM_THREADS`.
    pub const fn new(threads: usize) -> Self {
        Self { threads, made: Mutex::new(None) }
    }

    /// The pool of this process.
    ///
    /// # Errors
    /// Threads that cannot be had.
    pub fn get(&self) -> PyResult<Arc<ThreadPool>> {
        let mut made = self.made.lock().unwrap_or_else(PoisonError::into_inner);
        let process = std::process::id();
        if let Some((of, pool)) = &*made
            && *of == process
        {
            return Ok(pool.clone());
        }
        let pool = ThreadPoolBuilder::new().num_threads(self.threads).build();
        let pool = Arc::new(pool.map_err(|e| SpecError::new_err(format!("threads cannot be had: {e}")))?);
        // To end that of the parent would be to wait for locks that its threads may have had.
        std::mem::forget(made.replace((process, pool.clone())));
        Ok(pool)
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        let made = self.made.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if made.as_ref().is_some_and(|(of, _)| *of != std::process::id()) {
            std::mem::forget(made);
        }
    }
}
