//! The states of a managed node and the transitions between them.
//!
//! ```text
//!                configure            activate
//!  unconfigured ──────────→ inactive ──────────→ active
//!       ↑        cleanup ┘      └ deactivate ───────┘
//!       └────────────────       shutdown: from each of the three to finalized
//! ```
//!
//! | state | meaning |
//! |---|---|
//! | unconfigured | the node has no model; parameters that otherwise need a restart can be set |
//! | inactive | the models are loaded and checked; the node takes no samples, publishes no estimates and commands no current |
//! | active | the node estimates |
//! | finalized | the node does nothing more, and can only be ended |
//!
//! A transition is complete when its service answers, without intermediate states.

use crate::settings::error::RequestError;
use mr_damper_msgs::lifecycle::{State, Transition as TransitionMsg, TransitionDescription};

/// A state of the node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LifecycleState {
    /// No model is loaded.
    Unconfigured,
    /// Ready, but not working.
    Inactive,
    /// Working.
    Active,
    /// Ended.
    Finalized,
}

/// A transition from one state to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// Load the models.
    Configure,
    /// Unload the models.
    Cleanup,
    /// Start to estimate, without history.
    Activate,
    /// Stop estimating.
    Deactivate,
    /// Stop estimating for good.
    Shutdown,
}

/// Each transition with its number in `lifecycle_msgs` and its two states.
const TABLE: [(Transition, u8, LifecycleState, LifecycleState); 7] = [
    (Transition::Configure, 1, LifecycleState::Unconfigured, LifecycleState::Inactive),
    (Transition::Cleanup, 2, LifecycleState::Inactive, LifecycleState::Unconfigured),
    (Transition::Activate, 3, LifecycleState::Inactive, LifecycleState::Active),
    (Transition::Deactivate, 4, LifecycleState::Active, LifecycleState::Inactive),
    (Transition::Shutdown, 5, LifecycleState::Unconfigured, LifecycleState::Finalized),
    (Transition::Shutdown, 6, LifecycleState::Inactive, LifecycleState::Finalized),
    (Transition::Shutdown, 7, LifecycleState::Active, LifecycleState::Finalized),
];

impl LifecycleState {
    /// All states.
    pub const ALL: [Self; 4] = [Self::Unconfigured, Self::Inactive, Self::Active, Self::Finalized];

    /// The name, as in `lifecycle_msgs`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unconfigured => "unconfigured",
            Self::Inactive => "inactive",
            Self::Active => "active",
            Self::Finalized => "finalized",
        }
    }

    /// The state as a message.
    #[must_use]
    pub fn message(self) -> State {
        let id = match self {
            Self::Unconfigured => State::UNCONFIGURED,
            Self::Inactive => State::INACTIVE,
            Self::Active => State::ACTIVE,
            Self::Finalized => State::FINALIZED,
        };
        State { id, label: self.name().to_owned() }
    }

    /// The state after `transition`.
    ///
    /// # Errors
    /// [`RequestError::Transition`], which lists the transitions that are allowed.
    pub fn after(self, transition: Transition) -> Result<Self, RequestError> {
        let row = TABLE.iter().find(|(other, _, from, _)| (*other, *from) == (transition, self));
        row.map(|(_, _, _, to)| *to).ok_or_else(|| RequestError::Transition {
            transition: transition.name(),
            state: self.name(),
            allowed: self.transitions().map(|(transition, _)| transition.name()).collect(),
        })
    }

    /// The transitions that are allowed in this state, with their numbers.
    pub fn transitions(self) -> impl Iterator<Item = (Transition, u8)> {
        TABLE
            .iter()
            .filter(move |(_, _, from, _)| *from == self)
            .map(|(transition, id, _, _)| (*transition, *id))
    }
}

impl Transition {
    /// The requested transition, by label or by number; a shutdown by any of its numbers.
    ///
    /// # Errors
    /// [`RequestError::UnknownTransition`].
    pub fn requested(request: &TransitionMsg) -> Result<Self, RequestError> {
        let named = |(transition, id, _, _): &&(Transition, u8, LifecycleState, LifecycleState)| {
            if request.label.is_empty() { *id == request.id } else { transition.name() == request.label }
        };
        TABLE
            .iter()
            .find(named)
            .map(|row| row.0)
            .ok_or_else(|| RequestError::UnknownTransition { id: request.id, label: request.label.clone() })
    }

    /// The name, as in `lifecycle_msgs`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Configure => "configure",
            Self::Cleanup => "cleanup",
            Self::Activate => "activate",
            Self::Deactivate => "deactivate",
            Self::Shutdown => "shutdown",
        }
    }
}

/// All transitions with their two states; with `from`, only those from that state.
#[must_use]
pub fn graph(from: Option<LifecycleState>) -> Vec<TransitionDescription> {
    let rows = TABLE.iter().filter(|row| from.is_none_or(|state| state == row.2));
    rows.map(|(transition, id, start, goal)| TransitionDescription {
        transition: TransitionMsg { id: *id, label: transition.name().to_owned() },
        start_state: start.message(),
        goal_state: goal.message(),
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    #[test]
    fn the_table_written_out() {
        let mut text = String::new();
        let all = [
            Transition::Configure,
            Transition::Cleanup,
            Transition::Activate,
            Transition::Deactivate,
            Transition::Shutdown,
        ];
        for state in LifecycleState::ALL {
            writeln!(text, "{} {}", state.message().id, state.name()).expect("a text");
            for transition in all {
                let result = state
                    .after(transition)
                    .map_or_else(|why| why.to_string(), |to| format!("-> {}", to.name()));
                writeln!(text, "  {:<10} {result}", transition.name()).expect("a text");
            }
        }
        insta::assert_snapshot!(text);
    }

    #[test]
    fn a_transition_is_requested_by_label_or_by_number() {
        let request = |id, label: &str| Transition::requested(&TransitionMsg { id, label: label.to_owned() });
        assert_eq!(request(3, ""), Ok(Transition::Activate));
        assert_eq!(request(0, "configure"), Ok(Transition::Configure));
        assert_eq!(request(7, ""), Ok(Transition::Shutdown));
        assert!(request(99, "").expect_err("unknown").to_string().contains("99"));
        assert!(request(1, "start").expect_err("unknown").to_string().contains("\"start\""));
    }
}
