//! Errors of the actions.

use crate::settings::error::PartError;
use mr_damper_reports::open_questions::OpenQuestionsError;

/// Reasons why the work on a goal failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ActionError {
    /// The thread of the goal panicked.
    #[error("the thread of this goal panicked; the node's log shows where. Please report this as a bug")]
    Panicked,
    /// The node was stopped before the work had ended.
    #[error("the node was stopped while it worked on this goal")]
    Stopped,
    /// The history has no motion.
    #[error(
        "the history is still empty: the node keeps displacement, drive and force for history.duration_s"
    )]
    EmptyHistory,
    /// The history is too short to identify a model.
    #[error(
        "the history has only {history_s:.1} s of motion, but a model needs at least {least_s} s; the node keeps displacement, \
         drive and force for history.duration_s"
    )]
    ShortHistory {
        /// Length of the history, s.
        history_s: f64,
        /// The required length, s.
        least_s: f64,
    },
    /// A diagnosis of the running model failed.
    #[error(
        "on {history_s:.1} s of history (the first 60 % are training runs (estimate), the next 20 % validation runs (confirm), the rest \
         test runs): {error}. The node keeps history.duration_s of history; another base model can be loaded with load_model"
    )]
    OnHistory {
        /// Length of the history, s.
        history_s: f64,
        /// The error of the diagnosis.
        error: Box<mr_damper_model::Error>,
    },
    /// The report in a goal leaves no question.
    #[error("the report in this goal {0}")]
    OpenQuestions(#[source] OpenQuestionsError),
    /// The report cannot be serialised.
    #[error("cannot write the report as JSON: {0}")]
    Report(#[source] serde_json::Error),
}

impl PartError for ActionError {
    fn reason(&self) -> Option<serde_json::Value> {
        match self {
            Self::OnHistory { error, .. } => serde_json::to_value(error).ok(),
            _ => None,
        }
    }
}
