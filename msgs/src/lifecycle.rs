//! `lifecycle_msgs`: the states of a managed node and the transitions between them.

use serde::{Deserialize, Serialize};

use crate::definition::{definition, text};
use crate::message::{message, service};

/// `lifecycle_msgs/msg/State`: a state of a managed node.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct State {
    /// One of the constants of this type.
    pub id: u8,
    /// Its name: `active`.
    pub label: String,
}
message!(
    State,
    "lifecycle_msgs" / "msg" / "State",
    "dd2d02b82f3ebc858e53c431b1e6e91f3ffc71436fc81d0715214ac6ee2107a0",
    text!(State)
);

impl State {
    /// Nothing is loaded yet.
    pub const UNCONFIGURED: u8 = 1;
    /// Ready, but does not publish.
    pub const INACTIVE: u8 = 2;
    /// Running.
    pub const ACTIVE: u8 = 3;
    /// About to exit.
    pub const FINALIZED: u8 = 4;
}

/// `lifecycle_msgs/msg/Transition`: a transition from one state to another.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Transition {
    /// One of the constants of this type.
    pub id: u8,
    /// Its name: `activate`. A request with a label selects the transition by it, not by `id`.
    pub label: String,
}
message!(
    Transition,
    "lifecycle_msgs" / "msg" / "Transition",
    "c65d7b31ea134cba4f54fc867b817979be799f7452035cd35fac9b7421fb3424",
    text!(Transition)
);

/// `lifecycle_msgs/msg/TransitionDescription`: a transition with its start and goal states.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TransitionDescription {
    /// The transition.
    pub transition: Transition,
    /// State before the transition.
    pub start_state: State,
    /// State after a successful transition.
    pub goal_state: State,
}
message!(
    TransitionDescription,
    "lifecycle_msgs" / "msg" / "TransitionDescription",
    "c5f1cd4bb1ad2ba0e3329d4ac7015c52a674a72c1faf7974c37a33f4f6048b28",
    definition!(text!(TransitionDescription), Transition State)
);

/// `lifecycle_msgs/msg/TransitionEvent`: a transition that has just happened.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TransitionEvent {
    /// Time in ns since 1970.
    pub timestamp: u64,
    /// The transition.
    pub transition: Transition,
    /// State before the transition.
    pub start_state: State,
    /// State after the transition.
    pub goal_state: State,
}
message!(
    TransitionEvent,
    "lifecycle_msgs" / "msg" / "TransitionEvent",
    "d5f8873a2f0146498f812d7885c7327ce27e463d36811d8792f35ee38c0d6c38",
    definition!(text!(TransitionEvent), Transition State)
);

service! {
    /// `lifecycle_msgs/srv/GetState`: the current state of a node.
    GetState("lifecycle_msgs", "800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795"):
        GetStateRequest => GetStateResponse
}

/// Request of [`GetState`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetStateRequest {
    /// Always 0: a request without fields is one byte on the wire.
    pub structure_needs_at_least_one_member: u8,
}
message!(
    GetStateRequest,
    "lifecycle_msgs" / "srv" / "GetState_Request",
    "77a9c844e7975f15bc2221e8bbebafc4d118afb78c7f7071eef91f83f940f2f6",
    ""
);

/// Response of [`GetState`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetStateResponse {
    /// The state.
    pub current_state: State,
}
message!(
    GetStateResponse,
    "lifecycle_msgs" / "srv" / "GetState_Response",
    "fe249babab472e42cb5653b5d6a6b0c42a003b0fdfb84851aea3fde08760b4f5",
    definition!("State current_state\n", State)
);

service! {
    /// `lifecycle_msgs/srv/ChangeState`: performs a transition.
    ChangeState("lifecycle_msgs", "356fe34f0475a43acf54542013af4167b0e729f77ea22ffb045c6ad8e20668e5"):
        ChangeStateRequest => ChangeStateResponse
}

/// Request of [`ChangeState`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeStateRequest {
    /// The transition, by its label if one is given, else by its id.
    pub transition: Transition,
}
message!(
    ChangeStateRequest,
    "lifecycle_msgs" / "srv" / "ChangeState_Request",
    "d74c6f524e14cade7b67e7297190360ed749264af300524fc1456f27cc2a553a",
    definition!("Transition transition\n", Transition)
);

/// Response of [`ChangeState`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeStateResponse {
    /// Whether the transition was performed.
    pub success: bool,
}
message!(
    ChangeStateResponse,
    "lifecycle_msgs" / "srv" / "ChangeState_Response",
    "e1ddfed0271fefe63767aa71561926e4d9eac0f1ddf9e71a8873eb46b36deac2",
    "bool success\n"
);

service! {
    /// `lifecycle_msgs/srv/GetAvailableStates`: all states of a node.
    GetAvailableStates("lifecycle_msgs", "00a07d79d2207d71e81a8cbc1880e5d924cc16d4688ea8e8e06e443dc8f8aa1d"):
        GetAvailableStatesRequest => GetAvailableStatesResponse
}

/// Request of [`GetAvailableStates`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetAvailableStatesRequest {
    /// Always 0: a request without fields is one byte on the wire.
    pub structure_needs_at_least_one_member: u8,
}
message!(
    GetAvailableStatesRequest,
    "lifecycle_msgs" / "srv" / "GetAvailableStates_Request",
    "c2c0c12de6023822f284929577d4ca2862e0501150010966e8a90b632e4424de",
    ""
);

/// Response of [`GetAvailableStates`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetAvailableStatesResponse {
    /// The states.
    pub available_states: Vec<State>,
}
message!(
    GetAvailableStatesResponse,
    "lifecycle_msgs" / "srv" / "GetAvailableStates_Response",
    "223e0dd5bb8a847ebb9532adaf8b5e2a97e6e68e79faeaabd81a45fb32925bd1",
    definition!("State[] available_states\n", State)
);

service! {
    /// `lifecycle_msgs/srv/GetAvailableTransitions`: the transitions from the current state, or all
    /// transitions if the service is offered as `get_transition_graph`.
    GetAvailableTransitions("lifecycle_msgs", "59b7ecefce0982a8a844b9f2c4f14764c1c4543cc55e72924e2aa4adad83e9bc"):
        GetAvailableTransitionsRequest => GetAvailableTransitionsResponse
}

/// Request of [`GetAvailableTransitions`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetAvailableTransitionsRequest {
    /// Always 0: a request without fields is one byte on the wire.
    pub structure_needs_at_least_one_member: u8,
}
message!(
    GetAvailableTransitionsRequest,
    "lifecycle_msgs" / "srv" / "GetAvailableTransitions_Request",
    "52a73c0b5d7489bee0df6ddb0aec45c41289d223ff225b58fe11d859ac8109a6",
    ""
);

/// Response of [`GetAvailableTransitions`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetAvailableTransitionsResponse {
    /// The transitions, with their start and goal states.
    pub available_transitions: Vec<TransitionDescription>,
}
message!(
    GetAvailableTransitionsResponse,
    "lifecycle_msgs" / "srv" / "GetAvailableTransitions_Response",
    "4711339461aadf02bcfff797a198de911f885074bd3f2fe9f7b677ef87f0741c",
    definition!("TransitionDescription[] available_transitions\n", TransitionDescription Transition State)
);
