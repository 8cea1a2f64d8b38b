//! Errors of the service. Each says what went wrong, where, and what to do.

use std::path::PathBuf;
use thiserror::Error;

/// What can go wrong in the service.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NodeError {
    /// A parameter's value does not fit.
    #[error("parameter {name} is {value}, but must be {expected}")]
    Parameter {
        /// The parameter.
        name: String,
        /// The value that was given.
        value: String,
        /// What it takes.
        expected: String,
    },
    /// There is no such parameter.
    #[error("there is no parameter {name}; did you mean {nearest}?")]
    UnknownParameter {
        /// What was asked for.
        name: String,
        /// The known one closest to it.
        nearest: String,
    },
    /// A file cannot be read, or what it says is wrong.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// An argument after `--ros-args` is not understood.
    #[error("--ros-args: {0}")]
    RosArgs(String),
    /// A damper of several.
    #[error("damper {name}: {why}")]
    Damper {
        /// Its name.
        name: String,
        /// What is wrong with it.
        why: Box<NodeError>,
    },
    /// Arguments do not go together, in words.
    #[error("{0}")]
    Usage(String),
    /// A model does not load or does not fit.
    #[error(transparent)]
    Model(mr_damper_model::Error),
    /// A run does not load or cannot be written.
    #[error(transparent)]
    Run(#[from] crate::run::RunError),
    /// DDS refused something.
    #[error("ROS 2: {what}: {why}")]
    Ros {
        /// What was tried.
        what: String,
        /// What the middleware said, and what to do.
        why: String,
    },
    /// The Zenoh mirror did not start.
    #[error(transparent)]
    Zenoh(#[from] crate::sink::zenoh::ZenohError),
    /// Something of the operating system.
    #[error("{what}: {source}{}", advice(source.kind()))]
    Io {
        /// What was tried.
        what: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The work was asked to end.
    #[error("interrupted")]
    Interrupted,
    /// The work failed, in words.
    #[error("{0}")]
    Failed(String),
}

/// What to do about a disk that refuses, behind the system's words; empty where they say enough.
#[must_use]
pub(crate) fn advice(kind: std::io::ErrorKind) -> &'static str {
    match kind {
        std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => {
            "; make room on that disk, or write to another"
        }
        std::io::ErrorKind::ReadOnlyFilesystem => {
            "; the disk is read-only (the system makes one so that has errors, and its log says so): write to another"
        }
        _ => "",
    }
}

impl From<mr_damper_model::Error> for NodeError {
    /// Work that was cancelled is work that was interrupted.
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
