//! The view of all dampers, shared between threads, with the clock of all its data.

use super::wall::{Origin, Wall};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A shared [`Wall`], the view of all dampers.
#[derive(Debug)]
pub struct Hall {
    wall: Mutex<Wall>,
    began: Instant,
}

impl Hall {
    /// An empty view for data from `origin`. Its clock starts now.
    #[must_use]
    pub fn of(origin: Origin) -> Self {
        Self { wall: Mutex::new(Wall::of(origin)), began: Instant::now() }
    }

    /// Seconds since this was created, the clock of all data in the view.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Locks the view. Hold it only briefly.
    pub fn wall(&self) -> MutexGuard<'_, Wall> {
        // Values are replaced as a whole, so the view is consistent even after a panic elsewhere.
        self.wall.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
