//! The services of `mr_damper_msgs`, defined by the `.srv` files.

use serde::{Deserialize, Serialize};

use crate::message::{message, section, service};

service! {
    /// Loads a force model into the running node. If this fails, the current model stays.
    LoadModel("mr_damper_msgs", "813fbfd1d5f3f9f86b206cfd800185927f2a02ed3ef1262edebe85bb1540c38a"):
        LoadModelRequest => LoadModelResponse
}

/// Request of [`LoadModel`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoadModelRequest {
    /// Name of a preset, or path of a model file on the node's machine.
    pub model: String,
}
message!(
    LoadModelRequest,
    "mr_damper_msgs" / "srv" / "LoadModel_Request",
    "c824432486cb4234524c382b02f40c2b8e55b4ace762ca747dba637eaa84e6fe",
    section(include_str!("../srv/LoadModel.srv"), 0)
);

/// Response of [`LoadModel`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoadModelResponse {
    /// Whether the model was loaded.
    pub success: bool,
    /// The loaded model; on failure, the cause and what to do.
    pub message: String,
}
message!(
    LoadModelResponse,
    "mr_damper_msgs" / "srv" / "LoadModel_Response",
    "b2bff327c82640fa923be62759e5344a55eb8e37bdc59a283549513cb8e6effb",
    section(include_str!("../srv/LoadModel.srv"), 1)
);

service! {
    /// Clears filters, history and residual, as if the node had just started. The model stays.
    Reset("mr_damper_msgs", "7569d46093115dfd3b940ee2afe5a1e52a83f19fbd57266f84d63768c2b7e8b1"):
        ResetRequest => ResetResponse
}

/// Request of [`Reset`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResetRequest {
    /// Always 0: a request without fields is one byte on the wire.
    pub structure_needs_at_least_one_member: u8,
}
message!(
    ResetRequest,
    "mr_damper_msgs" / "srv" / "Reset_Request",
    "901ef5cfcb36635023be1d35952fe572977229d32a80cd4f1e56392ca754c347",
    section(include_str!("../srv/Reset.srv"), 0)
);

/// Response of [`Reset`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResetResponse {
    /// Whether the node was reset.
    pub success: bool,
    /// On failure, the cause and what to do; empty on success.
    pub message: String,
}
message!(
    ResetResponse,
    "mr_damper_msgs" / "srv" / "Reset_Response",
    "873867b7b97f3c02487621d3933004cca5efa1ab500c9f7ba192d63ead4206e0",
    section(include_str!("../srv/Reset.srv"), 1)
);

service! {
    /// Holds the estimator in one mode, or returns the choice of mode to the supervisor.
    SetMode("mr_damper_msgs", "3bdee117533cb23ce7ce60e291cb24c73bef00d02dfb8d613937137d807423e5"):
        SetModeRequest => SetModeResponse
}

/// Request of [`SetMode`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetModeRequest {
    /// A [`Mode`](crate::Mode); ignored when `automatic` is true.
    pub mode: u8,
    /// True if the supervisor chooses the mode.
    pub automatic: bool,
}
message!(
    SetModeRequest,
    "mr_damper_msgs" / "srv" / "SetMode_Request",
    "a95d8f977b3d39dcec3c3ee9500fd4bd2216cc317d27c84e66003d0641972a1b",
    section(include_str!("../srv/SetMode.srv"), 0)
);

/// Response of [`SetMode`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetModeResponse {
    /// Whether the mode was set.
    pub success: bool,
    /// On failure, the cause and what to do; empty on success.
    pub message: String,
}
message!(
    SetModeResponse,
    "mr_damper_msgs" / "srv" / "SetMode_Response",
    "4dcdb6e9cd5635e48cc1896270cf1bafa8541be384b61d7c9217a0e4c13915b5",
    section(include_str!("../srv/SetMode.srv"), 1)
);
