//! Refusals of requests to the workshop.

/// Kind of a refusal; it determines the HTTP status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefusalKind {
    /// The request is invalid.
    Wrong,
    /// The requested object does not exist.
    Missing,
    /// The request is not possible while something else is running.
    Busy,
    /// The upload is too large.
    TooMuch,
    /// The request was tried and failed.
    Failed,
}

/// A refusal with its reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The kind.
    pub kind: RefusalKind,
    /// The reason, and what to do.
    pub says: String,
}

impl Refusal {
    /// A refusal of the given kind and reason.
    pub fn new(kind: RefusalKind, says: impl Into<String>) -> Self {
        Self { kind, says: says.into() }
    }
}
