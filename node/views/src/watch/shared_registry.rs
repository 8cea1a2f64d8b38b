//! The registry of all dampers, shared between threads, with the clock of all its data.

use super::registry::{DamperRegistry, DataOrigin};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A shared [`DamperRegistry`].
#[derive(Debug)]
pub struct SharedRegistry {
    registry: Mutex<DamperRegistry>,
    began: Instant,
}

impl SharedRegistry {
    /// An empty registry for data from `origin`. Its clock starts now.
    #[must_use]
    pub fn of(origin: DataOrigin) -> Self {
        Self { registry: Mutex::new(DamperRegistry::of(origin)), began: Instant::now() }
    }

    /// Seconds since this was created, the clock of all data in the registry.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Locks the registry. Hold it only briefly.
    pub fn lock(&self) -> MutexGuard<'_, DamperRegistry> {
        // Values are replaced as a whole, so the registry is consistent even after a panic elsewhere.
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
