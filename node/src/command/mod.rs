//! The commands, one file each: its arguments, and what it does with them.

pub mod bag_args;
pub mod close;
pub mod compare;
pub mod conditioning;
pub mod convert;
pub mod demo;
pub mod doctor;
pub mod evaluate;
pub mod identify;
pub mod inverse;
pub mod node;
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

/// What every command may need of its surroundings.
pub struct Surroundings {
    /// Raised by Ctrl-C and SIGTERM.
    pub interrupt: Interrupt,
    /// No progress on the screen.
    pub quiet: bool,
    /// What `--ros-args` said.
    pub ros_args: RosArgs,
}
