//! The wall where several threads can reach it, with the one clock of everything on it.

use super::wall::{Origin, Wall};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A wall that is shared.
#[derive(Debug)]
pub struct Hall {
    wall: Mutex<Wall>,
    began: Instant,
}

impl Hall {
    /// An empty wall for news from `origin`, whose time begins now.
    #[must_use]
    pub fn of(origin: Origin) -> Self {
        Self { wall: Mutex::new(Wall::of(origin)), began: Instant::now() }
    }

    /// Seconds since it was made: the clock of everything on the wall.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// The wall, for a moment.
    pub fn wall(&self) -> MutexGuard<'_, Wall> {
        // Figures are replaced whole, so that a panic elsewhere leaves none by half.
        self.wall.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
