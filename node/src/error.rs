//! Errors of the service. Each message says what went wrong, where, and what to do.

use mr_damper_base::disk::advice;
use std::path::PathBuf;
use thiserror::Error;

/// Errors of the service.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NodeError {
    /// A parameter has an invalid value.
    #[error("parameter {name} is {value}, but must be {expected}")]
    Parameter {
        /// The parameter.
        name: String,
        /// The given value.
        value: String,
        /// The accepted values.
        expected: String,
    },
    /// The parameter does not exist.
    #[error("unknown parameter {name}; did you mean {nearest}?")]
    UnknownParameter {
        /// The given name.
        name: String,
        /// The closest known name.
        nearest: String,
    },
    /// A file cannot be read, or its content is wrong.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The problem.
        message: String,
    },
    /// An argument after `--ros-args` is wrong.
    #[error("--ros-args: {0}")]
    RosArgs(String),
    /// One damper of several failed.
    #[error("damper {name}: {why}")]
    Damper {
        /// The damper's name.
        name: String,
        /// The error of this damper.
        why: Box<NodeError>,
    },
    /// Wrong combination of arguments; the text is the message.
    #[error("{0}")]
    Usage(String),
    /// A model does not load or does not fit.
    #[error(transparent)]
    Model(mr_damper_model::Error),
    /// A run does not load or cannot be written.
    #[error(transparent)]
    Run(#[from] mr_damper_runs::RunError),
    /// A running node's report of a diagnosis cannot be read.
    #[error(transparent)]
    Answer(#[from] mr_damper_reports::diagnosis_summary::UnreadableAnswer),
    /// The web server of the live page does not start, or has ended.
    #[error(transparent)]
    Serve(#[from] mr_damper_views::ServeError),
    /// DDS returned an error.
    #[error("ROS 2: {what}: {why}")]
    Ros {
        /// The attempted action.
        what: String,
        /// The middleware's message, and what to do.
        why: String,
    },
    /// The Zenoh mirror did not start.
    #[error(transparent)]
    Zenoh(#[from] crate::zenoh_session::ZenohError),
    /// An error of the operating system.
    #[error("{what}: {source}{}", advice(source.kind()))]
    Io {
        /// The attempted action.
        what: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// The work was interrupted.
    #[error("interrupted")]
    Interrupted,
    /// The work failed; the text is the message.
    #[error("{0}")]
    Failed(String),
}

impl From<mr_damper_model::Error> for NodeError {
    /// A cancelled computation counts as interrupted work.
    fn from(error: mr_damper_model::Error) -> Self {
        match error {
            mr_damper_model::Error::Cancelled => Self::Interrupted,
            error => Self::Model(error),
        }
    }
}

impl NodeError {
    /// An error of the operating system while doing `what`.
    pub fn io(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let what = what.into();
        move |source| Self::Io { what, source }
    }
}
