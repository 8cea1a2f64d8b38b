//! The commands. Each file holds one command: its arguments and its implementation.

pub mod bag_args;
pub mod close;
pub mod compare;
pub mod conditioning;
pub mod convert;
pub mod demo;
pub mod doctor;
pub mod evaluate;
pub mod fis;
pub mod identify;
pub mod inverse;
pub mod node;
mod number;
pub mod output;
pub mod presets;
mod progress;
pub mod record;
pub mod replay;
pub mod run_args;
pub mod serve;
pub mod simulate;
pub mod top;

use crate::config::RosArgs;
use crate::interrupt::Interrupt;

/// Context that every command receives.
pub struct CliContext {
    /// Raised by Ctrl-C and SIGTERM.
    pub interrupt: Interrupt,
    /// `--quiet`: show no progress.
    pub quiet: bool,
    /// The parsed `--ros-args`.
    pub ros_args: RosArgs,
}
