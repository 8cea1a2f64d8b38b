//! Requests of peers that a node refuses.

use thiserror::Error;

/// Reasons why a node refuses what a peer requests: a change of state, parameter, model or mode, or a goal.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum RequestError {
    /// The transition is not allowed in the present state.
    #[error(
        "{transition} is not allowed in the state {state}; allowed: {}",
        if allowed.is_empty() { "none".to_owned() } else { allowed.join(", ") }
    )]
    Transition {
        /// Name of the transition.
        transition: &'static str,
        /// Name of the present state.
        state: &'static str,
        /// Names of the transitions that are allowed.
        allowed: Vec<&'static str>,
    },
    /// No transition has this number or label.
    #[error("unknown transition {id} \"{label}\"; use configure, cleanup, activate, deactivate or shutdown")]
    UnknownTransition {
        /// The requested number.
        id: u8,
        /// The requested label.
        label: String,
    },
    /// The QoS of a topic was to be changed.
    #[error("{name} is read-only: the QoS of a topic is set at the start of the node")]
    Qos {
        /// Name of the parameter.
        name: String,
    },
    /// The parameter cannot change in the present state.
    #[error("parameter {name} cannot change while the node is {state}{instead}")]
    ParameterInState {
        /// Name of the parameter.
        name: &'static str,
        /// Name of the present state.
        state: &'static str,
        /// What to do, as the end of the sentence.
        instead: &'static str,
    },
    /// The parameter cannot change while the node runs.
    #[error("parameter {name} cannot change while the node runs; restart it with the new value")]
    ParameterNeedsRestart {
        /// Name of the parameter.
        name: &'static str,
    },
    /// A parameter was to be removed.
    #[error("{name}: parameters of this node cannot be undeclared")]
    Undeclare {
        /// Name of the parameter.
        name: String,
    },
    /// A value has a type that no parameter has.
    #[error("{name}: rcl_interfaces type {kind} is not used by any parameter of this node")]
    UnusedType {
        /// Name of the parameter.
        name: String,
        /// The type, as in `rcl_interfaces/msg/ParameterType`.
        kind: u8,
    },
    /// A text is too long to be valid.
    #[error("{what} has {bytes} bytes; texts have at most {most}")]
    TooLong {
        /// Name of the text.
        what: String,
        /// Its length, bytes.
        bytes: usize,
        /// The greatest length, bytes.
        most: usize,
    },
    /// A mode that lasts for a limited time was requested.
    #[error("{mode} lasts for a limited time only, so it cannot be requested; request arx, model or fault")]
    TemporaryMode {
        /// Name of the mode.
        mode: String,
    },
    /// No mode has this number.
    #[error("unknown mode {number}; the numbers are the constants of mr_damper_msgs/msg/ForceEstimate")]
    UnknownMode {
        /// The number, as in `mr_damper_msgs/srv/SetMode`.
        number: u8,
    },
    /// The node has no model.
    #[error("the node has no model; configure it first")]
    NoModel,
    /// There is nothing to reset.
    #[error("the node is {state}: there is nothing to reset")]
    NothingToReset {
        /// Name of the present state.
        state: &'static str,
    },
    /// The length of a history is not valid.
    #[error("history is {seconds}, but must be a positive number of seconds")]
    History {
        /// The requested length, s.
        seconds: f64,
    },
    /// A design has no question.
    #[error("the goal has neither a question, such as friction|gas_spring, nor the report of a diagnosis")]
    NoQuestion,
    /// The action works on another goal.
    #[error("another goal is running; cancel it, or wait for its result")]
    Busy,
    /// A new model includes a drift of the load cell, so it is not loaded by itself.
    #[error(
        "the model is not loaded by itself, because it includes {effect}: a drift belongs to one session, and starts again at zero when \
         the model is loaded; to load it, call load_model with {path}"
    )]
    IncludesDrift {
        /// Id of the effect.
        effect: &'static str,
        /// The model file.
        path: String,
    },
    /// A new model includes a term that counts from the start of a run, so it is not loaded by itself.
    #[error(
        "the model is not loaded by itself, because it includes the {term}: it counts from the start of a run, so it belongs to the history \
         that it was found on, and starts again at zero when the model is loaded; to load it, call load_model with {path}"
    )]
    IncludesHistory {
        /// Title of the term.
        term: String,
        /// The model file.
        path: String,
    },
    /// The file of a new model exists.
    #[error("{path} exists already and is not overwritten; give another path in out")]
    FileExists {
        /// The path.
        path: String,
    },
}
