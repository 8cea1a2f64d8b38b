//! How the caller follows an identification, and ends it early.

#[cfg(doc)]
use crate::error::Error;
use std::sync::atomic::{AtomicBool, Ordering};

/// What an identification is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Runs are being conditioned.
    Conditioning {
        /// Number of runs.
        runs: u32,
    },
    /// A restart has ended.
    Restart {
        /// Restarts that have ended.
        done: u32,
        /// Restarts in all.
        of: u32,
    },
    /// An epoch of learning, or a generation of an evolution, has ended.
    Epoch {
        /// Epochs that have ended.
        done: u32,
        /// Epochs at most.
        of: u32,
    },
    /// The best restarts are being finished on all rows.
    Polish {
        /// Fits that have ended.
        done: u32,
        /// Fits in all.
        of: u32,
    },
}

/// How the caller follows an identification and ends it early.
#[derive(Clone, Copy, Default)]
pub struct Watch<'a> {
    /// Set it to `true` from anywhere to end the work, within a fraction of a second, with
    /// [`Error::Cancelled`].
    pub cancel: Option<&'a AtomicBool>,
    /// Called now and then, from any thread.
    pub progress: Option<&'a (dyn Fn(Progress) + Sync)>,
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Watch")
            .field("cancel", &self.cancel)
            .field("progress", &self.progress.map(|_| "a function"))
            .finish()
    }
}

impl Watch<'_> {
    /// Neither progress nor an early end.
    #[must_use]
    pub const fn none() -> Self {
        Self { cancel: None, progress: None }
    }

    pub(super) fn flag(&self) -> &AtomicBool {
        static NEVER: AtomicBool = AtomicBool::new(false);
        self.cancel.unwrap_or(&NEVER)
    }

    pub(crate) fn is_cancelled(&self) -> bool {
        self.flag().load(Ordering::Relaxed)
    }

    pub(super) fn report(&self, progress: Progress) {
        if let Some(call) = self.progress {
            call(progress);
        }
    }
}
