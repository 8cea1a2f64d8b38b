//! Errors of changes to the running service.

use crate::settings::error::PartError;
use std::fmt;

/// Reasons why a change to the running service failed, besides a wrong request
/// ([`RequestError`](crate::settings::error::RequestError)).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// A model was to be loaded while the node is not configured.
    #[error("the node is {state}: set the parameter model to {model}, and configure it")]
    NotConfigured {
        /// Name of the present state.
        state: &'static str,
        /// The preset or model file.
        model: String,
    },
    /// The model that the new one was made from is not the running one any more.
    #[error("another model was loaded meanwhile, but {model} was made from the previous one")]
    Replaced {
        /// The model file.
        model: String,
    },
    /// The command ring of the estimating thread is full.
    #[error("too many changes at once; try again")]
    TooManyChanges,
    /// The estimating thread does not execute a command in time.
    #[error("the estimating thread has not {work} after {within_s} s; see the log, and restart the node")]
    NotExecuted {
        /// The command.
        work: Awaited,
        /// The longest time to wait, s.
        within_s: u64,
    },
}

impl PartError for ControlError {}

/// Work of the estimating thread that a caller waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Awaited {
    /// A change of state.
    Transition,
    /// A new model.
    Swap,
}

impl fmt::Display for Awaited {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Transition => "carried out the transition",
            Self::Swap => "swapped the model in",
        })
    }
}
