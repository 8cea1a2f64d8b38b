//! Errors of the demo.

use crate::settings::error::PartError;
use mr_damper_reports::Agreement;

/// Reasons why the demo failed.
#[derive(Debug, thiserror::Error)]
pub(super) enum DemoError {
    /// The virtual rig does not have the experiment that the demo records.
    #[error("the rig has no experiment {name}")]
    NoExperiment {
        /// Name of the experiment.
        name: &'static str,
    },
    /// The thread that generates runs panicked.
    #[error("the rig's thread died; the log above says why. Please report it")]
    RigThreadDied,
    /// The service has no ring of events for the demo.
    #[error("the service provides no event ring. Please report this as a bug")]
    NoEventRing,
    /// The player does not discover the service.
    #[error(
        "the demo's service was not discovered over DDS within {within_s} s; is multicast allowed on the loopback interface? \
         `mr-damper doctor` checks it"
    )]
    NotDiscovered {
        /// The longest time to wait, s.
        within_s: u64,
    },
    /// A thread of the service, or one that observes it, has died.
    #[error("the {thread} thread has died; the log above says why. Please report it")]
    ThreadDied {
        /// Name of the thread.
        thread: &'static str,
    },
    /// The live figures differ from an evaluation without ROS.
    #[error("{}; please report it with seed {seed} and {seconds} s", agreement.text())]
    FiguresDiffer {
        /// By how much they differ.
        agreement: Agreement,
        /// Seed of the demo's runs.
        seed: u64,
        /// Length of the run before the diagnosis, s.
        seconds: f64,
    },
}

impl PartError for DemoError {}
