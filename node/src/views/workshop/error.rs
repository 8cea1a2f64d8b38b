//! Errors of the work that the live page starts.

use crate::settings::error::PartError;
use mr_damper_views::workshop::{Refusal, RefusalKind};
use std::path::PathBuf;

/// Reasons why a workshop does not open, or a task of it fails.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WorkshopError {
    /// Another server has locked the directory.
    #[error(
        "--workshop: another mr-damper serve has {} open; stop that server, or give another directory",
        folder.display()
    )]
    FolderInUse {
        /// The directory.
        folder: PathBuf,
    },
    /// The task panicked.
    #[error("this task panicked; the log shows where. Please report this as a bug")]
    TaskPanicked,
    /// The player of a replay panicked.
    #[error("the player panicked; the log shows where. Please report this as a bug")]
    PlayerPanicked,
    /// The node of a replay was not discovered.
    #[error(
        "the replay's node did not appear within {within_s} s: does this machine allow DDS (UDP) over loopback?"
    )]
    NoNode {
        /// The longest time to wait, s.
        within_s: u64,
    },
    /// A thread of a replay's node has died.
    #[error("the thread {thread} of the replay's node has died; the log shows why")]
    NodeThreadDied {
        /// Name of the thread.
        thread: &'static str,
    },
}

impl PartError for WorkshopError {}

/// A run was to be read with an unknown drive.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the drive is \"{drive}\", but must be current_a or command_v")]
pub(super) struct UnknownDrive {
    /// The requested drive.
    pub(super) drive: String,
}

impl PartError for UnknownDrive {}

impl From<UnknownDrive> for Refusal {
    fn from(error: UnknownDrive) -> Self {
        Self::new(RefusalKind::Wrong, error.to_string())
    }
}
