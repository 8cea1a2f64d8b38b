//! Why something that was asked of the workshop is not done.

use crate::error::NodeError;

/// What kind of refusal it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The request itself is wrong.
    Wrong,
    /// There is no such thing.
    Missing,
    /// Not now: something else is going on.
    Busy,
    /// More than is taken.
    TooMuch,
    /// It was tried, and failed.
    Failed,
}

/// A refusal, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// What kind.
    pub kind: Kind,
    /// Why, and what to do.
    pub says: String,
}

impl Refusal {
    /// A refusal of some kind.
    pub fn new(kind: Kind, says: impl Into<String>) -> Self {
        Self { kind, says: says.into() }
    }
}

impl From<NodeError> for Refusal {
    fn from(error: NodeError) -> Self {
        Self::new(Kind::Failed, error.to_string())
    }
}
