//! The context that every command receives.

use crate::settings::config::RosArgs;
use crate::settings::interrupt::Interrupt;
use std::sync::Arc;

/// Context that every command receives.
pub struct CliContext {
    /// Raised by Ctrl-C and SIGTERM.
    pub interrupt: Interrupt,
    /// `--quiet`: show no progress.
    pub quiet: bool,
    /// The parsed `--ros-args`.
    pub ros_args: RosArgs,
    /// Receives progress, for a caller of this library.
    pub progress: Option<ProgressSink>,
}

/// Receives the stage, the number of steps done in it, and their total number (0 if it is not known). Called from any thread.
pub type ProgressSink = Arc<dyn Fn(&str, u64, u64) + Send + Sync>;
