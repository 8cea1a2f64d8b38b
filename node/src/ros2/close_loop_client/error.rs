//! Errors of a diagnosis by a running node.

use crate::settings::error::PartError;
use serde_json::Value;

/// Reasons why a running node has not diagnosed its model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CloseLoopError {
    /// No node offers the action.
    #[error(
        "no node answered {action} in {reach} within {within_s} s. Check that `mr-damper node` runs there. Set its domain with \
         ROS_DOMAIN_ID or --domain-id, and its namespace with --ros-args -r __ns:=/front_left (now {namespace})"
    )]
    NoNode {
        /// The action.
        action: String,
        /// Domain and discovery range, in words.
        reach: String,
        /// The longest time to wait, s.
        within_s: u64,
        /// The namespace that was searched.
        namespace: String,
    },
    /// The node rejects the goal.
    #[error(
        "{action} rejects the goal: it executes one goal at a time, so wait for the present one, or cancel it. The node's log has \
         the reason"
    )]
    Rejected {
        /// The action.
        action: String,
    },
    /// The node neither accepts nor rejects the goal.
    #[error("{action} did not answer within {within_s} s; the node's log may have the reason")]
    NoAnswer {
        /// The action.
        action: String,
        /// The longest time to wait, s.
        within_s: u64,
    },
    /// The node has left the domain.
    #[error("the node of {action} disappeared while it executed the goal")]
    NodeGone {
        /// The action.
        action: String,
    },
    /// The goal failed.
    #[error("{action} failed: {}", error.as_deref().unwrap_or("no reason is given; see the node's log"))]
    Failed {
        /// The action.
        action: String,
        /// The sentence of the node; `None` if it gave none.
        error: Option<String>,
        /// The code and fields of the node's error, if it has any.
        reason: Option<Value>,
    },
}

impl PartError for CloseLoopError {
    fn reason(&self) -> Option<Value> {
        match self {
            Self::Failed { reason, .. } => reason.clone(),
            _ => None,
        }
    }
}
