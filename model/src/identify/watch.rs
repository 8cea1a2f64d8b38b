//! Progress reports and cancellation of an identification.

#[cfg(doc)]
use crate::error::Error;
use std::sync::atomic::{AtomicBool, Ordering};

/// The current stage of an identification.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Runs are being conditioned.
    Conditioning {
        /// Number of runs.
        runs: u32,
    },
    /// A restart has finished.
    Restart {
        /// Number of finished restarts.
        done: u32,
        /// Total number of restarts.
        of: u32,
    },
    /// An epoch of learning or a generation of an evolution has finished.
    Epoch {
        /// Number of finished epochs.
        done: u32,
        /// Largest number of epochs.
        of: u32,
    },
    /// The best restarts are being refined on all rows.
    Polish {
        /// Number of finished fits.
        done: u32,
        /// Total number of fits.
        of: u32,
    },
}

/// Progress callback and cancellation flag of an identification.
///
/// ```
/// use mr_damper_model::Error;
/// use mr_damper_model::identify::{ModelSpec, Options, Progress, Watch, identify};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use std::sync::atomic::{AtomicBool, Ordering};
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 3.0), &Plant::default(), &Channels::default(), 1);
/// // Cancels after the first restart; a user interface would set the flag.
/// let cancel = AtomicBool::new(false);
/// let progress = |progress| {
///     if let Progress::Restart { .. } = progress {
///         cancel.store(true, Ordering::Relaxed);
///     }
/// };
/// let watch = Watch { cancel: Some(&cancel), progress: Some(&progress) };
/// assert_eq!(identify(ModelSpec::FUZZY_TANH, &[run], &Options::default(), &watch).unwrap_err(), Error::Cancelled);
/// ```
#[derive(Clone, Copy, Default)]
pub struct Watch<'a> {
    /// Set to `true` from any thread to end the work within a fraction of a second, with
    /// [`Error::Cancelled`].
    pub cancel: Option<&'a AtomicBool>,
    /// Called from time to time, from any thread.
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
    /// No progress reports and no cancellation.
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
