//! The context that every command receives.

use crate::settings::config::RosArgs;
use crate::settings::interrupt::Interrupt;

/// Context that every command receives.
pub struct CliContext {
    /// Raised by Ctrl-C and SIGTERM.
    pub interrupt: Interrupt,
    /// `--quiet`: show no progress.
    pub quiet: bool,
    /// The parsed `--ros-args`.
    pub ros_args: RosArgs,
}
