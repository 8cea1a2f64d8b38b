//! Errors of the service. Each message says what went wrong, where, and what to do.

mod part;
mod request;

pub use part::PartError;
pub use request::RequestError;

use mr_damper_base::disk::advice;
use mr_damper_views::ServeError;
use std::path::{Path, PathBuf};
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
    #[error("unknown parameter {name}; {}", nearest.as_ref().map_or_else(
        || "`mr-damper node --help` lists all parameters".to_owned(),
        |nearest| format!("did you mean {nearest}?")
    ))]
    UnknownParameter {
        /// The given name.
        name: String,
        /// The known name that it resembles; `None` if it resembles none.
        nearest: Option<String>,
    },
    /// A parameter from a file is refused.
    #[error("{}: {}{why}", path.display(), section.as_ref().map(|section| format!("{section}: ")).unwrap_or_default())]
    InFile {
        /// The file.
        path: PathBuf,
        /// The section, if the format has sections.
        section: Option<String>,
        /// The error of this parameter.
        why: Box<NodeError>,
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
    /// The parameters do not fit together, or do not fit the models.
    #[error(transparent)]
    Settings(mr_damper_model::Error),
    /// A run does not load or cannot be written.
    #[error(transparent)]
    Run(#[from] mr_damper_runs::RunError),
    /// A running node's report of a diagnosis cannot be read.
    #[error(transparent)]
    Answer(#[from] mr_damper_reports::diagnosis_summary::UnreadableAnswer),
    /// The web server of the live page does not start, or has ended.
    #[error(transparent)]
    Serve(#[from] ServeError),
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
    Zenoh(#[from] crate::zenoh::session::ZenohError),
    /// An error of the operating system.
    #[error("{what}: {source}{}", advice(source.kind()))]
    Io {
        /// The attempted action.
        what: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// The request of a peer is refused.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// The work was interrupted.
    #[error("interrupted")]
    Interrupted,
    /// An error that a part of the service or a command defines beside the code that raises it.
    #[error(transparent)]
    Part(Box<dyn PartError>),
}

impl<E: PartError> From<E> for NodeError {
    fn from(error: E) -> Self {
        Self::Part(Box::new(error))
    }
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
    /// True if the arguments or parameters are wrong, wherever they come from: flags, ROS arguments, files, or a combination
    /// of parameters that does not fit. The command line ends with exit code 2 then.
    #[must_use]
    pub fn is_wrong_usage(&self) -> bool {
        match self {
            Self::Parameter { .. } | Self::UnknownParameter { .. } | Self::RosArgs(_) | Self::Usage(_) => {
                true
            }
            Self::InFile { why, .. } | Self::Damper { why, .. } => why.is_wrong_usage(),
            Self::Settings(_) => true,
            Self::Part(error) => error.as_ref().is_wrong_usage(),
            Self::Zenoh(error) => error.is_wrong_parameter(),
            Self::Serve(
                ServeError::PageBeyondLoopback { .. } | ServeError::WorkshopBeyondLoopback { .. },
            ) => true,
            _ => false,
        }
    }

    /// The stable code and the fields of the error of the model crate that this error reports, for JSON; `None` if it reports none.
    #[must_use]
    pub fn reason(&self) -> Option<serde_json::Value> {
        match self {
            Self::Model(error) | Self::Settings(error) => serde_json::to_value(error).ok(),
            Self::Part(error) => error.reason(),
            Self::Damper { why, .. } | Self::InFile { why, .. } => why.reason(),
            _ => None,
        }
    }

    /// The error of a part, if it is of type `E`.
    #[must_use]
    pub fn part<E: PartError>(&self) -> Option<&E> {
        match self {
            Self::Part(error) => (error.as_ref() as &dyn std::error::Error).downcast_ref(),
            Self::Damper { why, .. } | Self::InFile { why, .. } => why.part(),
            _ => None,
        }
    }

    /// The content of the file at `path` cannot be used, because of `message`.
    pub fn in_file(path: &Path, message: impl Into<String>) -> Self {
        Self::InFile { path: path.to_owned(), section: None, why: Box::new(Self::Usage(message.into())) }
    }

    /// An error of the operating system while doing `what`.
    pub fn io(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let what = what.into();
        move |source| Self::Io { what, source }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::error::Error;

    #[derive(Debug, PartialEq, Error)]
    #[error("part {id} failed: {cause}")]
    struct PartFailed {
        id: u8,
        #[source]
        cause: std::fmt::Error,
    }

    impl PartError for PartFailed {
        fn reason(&self) -> Option<serde_json::Value> {
            Some(serde_json::json!({ "id": self.id }))
        }
    }

    #[test]
    fn the_error_of_a_part_keeps_its_sentence_cause_reason_and_type() {
        let part = || PartFailed { id: 7, cause: std::fmt::Error };
        let error = NodeError::from(part());
        assert_eq!(error.to_string(), part().to_string());
        assert!(error.source().is_some_and(|cause| cause.is::<std::fmt::Error>()), "{error:?}");
        let of_damper = NodeError::Damper { name: "front_left".to_owned(), why: Box::new(error) };
        assert_eq!(of_damper.part(), Some(&part()));
        assert_eq!(of_damper.reason(), Some(serde_json::json!({ "id": 7 })));
        assert_eq!(NodeError::Interrupted.part::<PartFailed>(), None);
    }
}
