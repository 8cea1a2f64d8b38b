//! The services of `rosbag2_interfaces` that control a player, as `ros2 bag play` offers them (Jazzy).
//!
//! A request or response without fields is one byte on the wire, always 0.

use serde::{Deserialize, Serialize};

use crate::definition::definition;
use crate::message::{message, service};
use crate::nan;
use crate::standard::Time;

/// A request or response without fields.
macro_rules! empty {
    ($($(#[$doc:meta])* $type:ident)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub struct $type {
            /// Always 0.
            pub structure_needs_at_least_one_member: u8,
        }
    )+};
}

/// A response whose one field says whether the call succeeded.
macro_rules! success {
    ($($(#[$doc:meta])* $type:ident)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub struct $type {
            /// Whether the call succeeded.
            pub success: bool,
        }
    )+};
}

empty! {
    /// Request of [`Pause`].
    PauseRequest
    /// Response of [`Pause`].
    PauseResponse
    /// Request of [`Resume`].
    ResumeRequest
    /// Response of [`Resume`].
    ResumeResponse
    /// Request of [`TogglePaused`].
    TogglePausedRequest
    /// Response of [`TogglePaused`].
    TogglePausedResponse
    /// Request of [`IsPaused`].
    IsPausedRequest
    /// Request of [`GetRate`].
    GetRateRequest
    /// Request of [`PlayNext`].
    PlayNextRequest
}

success! {
    /// Response of [`SetRate`].
    SetRateResponse
    /// Response of [`PlayNext`].
    PlayNextResponse
    /// Response of [`Seek`].
    SeekResponse
}

/// Response of [`IsPaused`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IsPausedResponse {
    /// Whether playback is paused.
    pub paused: bool,
}

/// Response of [`GetRate`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GetRateResponse {
    /// Speed as a multiple of the original speed.
    #[serde(deserialize_with = "nan::or_null")]
    pub rate: f64,
}

/// Request of [`SetRate`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetRateRequest {
    /// Speed as a multiple of the original speed; must be above 0.
    #[serde(deserialize_with = "nan::or_null")]
    pub rate: f64,
}

/// Request of [`Burst`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BurstRequest {
    /// Number of messages; 0 plays all remaining messages.
    pub num_messages: u64,
}

/// Response of [`Burst`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BurstResponse {
    /// Number of messages that were played.
    pub actually_burst: u64,
}

/// Request of [`Seek`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeekRequest {
    /// Time in the bag at which to continue.
    pub time: Time,
}

service! {
    /// Pauses playback; has no effect if already paused.
    Pause("rosbag2_interfaces", "b101e6aaf344c37f1405f5a1f484fee1c7d2acc61c6f04aeb636e9ab3f51a497"): PauseRequest => PauseResponse
}
message!(
    PauseRequest,
    "rosbag2_interfaces" / "srv" / "Pause_Request",
    "281bb2694f33f986b925c21fd9981c80cc5f5147bd5ec42d87525f1986c9e466",
    ""
);
message!(
    PauseResponse,
    "rosbag2_interfaces" / "srv" / "Pause_Response",
    "6d7e31f48308bceaeaf78f6b75d6c7900bff88363706ac820e5649e6593b66ed",
    ""
);

service! {
    /// Resumes playback; has no effect if not paused.
    Resume("rosbag2_interfaces", "fb4a116a8bdfc09c4c9f48df3b295d1f546053b4bb145bcbd4c92e7eef9896b8"): ResumeRequest => ResumeResponse
}
message!(
    ResumeRequest,
    "rosbag2_interfaces" / "srv" / "Resume_Request",
    "fb988aa8fefd54ec0e79a58a51aa06101e0bcb1668dc38bbc0b4e02d6df274d9",
    ""
);
message!(
    ResumeResponse,
    "rosbag2_interfaces" / "srv" / "Resume_Response",
    "9df430ac47b3d942f08c1603418243b6457bef5ede37593d75d8d40edc543381",
    ""
);

service! {
    /// Pauses a running playback or resumes a paused one.
    TogglePaused("rosbag2_interfaces", "c4382ba5856616caf3fb7b3ecffd0eb244015814861263ccc8241b2f6c9463ae"): TogglePausedRequest => TogglePausedResponse
}
message!(
    TogglePausedRequest,
    "rosbag2_interfaces" / "srv" / "TogglePaused_Request",
    "c263e8697ae95135bb33065d4c04a2a64cbdc19f4dbe36fef7fbff08dc57b100",
    ""
);
message!(
    TogglePausedResponse,
    "rosbag2_interfaces" / "srv" / "TogglePaused_Response",
    "8eca86811a9c507bf6af991d96913de239bb7b20a0f4322167954da5c4f46e7b",
    ""
);

service! {
    /// Returns whether playback is paused.
    IsPaused("rosbag2_interfaces", "c4d007c4a9ca1a76729d96b81c20db85b88b454eee371c0d8afe3aa31b899a40"): IsPausedRequest => IsPausedResponse
}
message!(
    IsPausedRequest,
    "rosbag2_interfaces" / "srv" / "IsPaused_Request",
    "9ef3b23785d1cf8409fccd055c3d88e6423169b9e4eebd5c2113996db8a6e4bc",
    ""
);
message!(
    IsPausedResponse,
    "rosbag2_interfaces" / "srv" / "IsPaused_Response",
    "245fc5f694b47fafac3c3a6ef8e412771153af28f86ac1a6e3acee60f9d01de8",
    "bool paused\n"
);

service! {
    /// Returns the playback speed.
    GetRate("rosbag2_interfaces", "c4f24894657b45b0cca8c720ce039924cfa1a5b8baa7d1ffd94881812d8700eb"): GetRateRequest => GetRateResponse
}
message!(
    GetRateRequest,
    "rosbag2_interfaces" / "srv" / "GetRate_Request",
    "7d0acffdc3e2a0f609192ffe06e3f62b245ae870b2bed40f5aca14e90f70f2b8",
    ""
);
message!(
    GetRateResponse,
    "rosbag2_interfaces" / "srv" / "GetRate_Response",
    "94ed8749aa8f38b835d0d8c080549f48182174bcebf2ab8c1effabdd0fe200c9",
    "float64 rate\n"
);

service! {
    /// Sets the playback speed.
    SetRate("rosbag2_interfaces", "571e1d5335cc99a8e4132c46e4ea9bf873e85c39f23d375146cb7d249d939629"): SetRateRequest => SetRateResponse
}
message!(
    SetRateRequest,
    "rosbag2_interfaces" / "srv" / "SetRate_Request",
    "a1c707f5a5e8fcc52976d7a6f50402ef48a3f298c1279a9aaccc956fa5b89a71",
    "float64 rate\n"
);
message!(
    SetRateResponse,
    "rosbag2_interfaces" / "srv" / "SetRate_Response",
    "aa9635da63df53fcf447d5401749e81d42f64c600dc9e484f5eeea6dd8dd04f9",
    "bool success\n"
);

service! {
    /// Plays one message; works only while paused.
    PlayNext("rosbag2_interfaces", "2b397d59555ce383e6af4b4e43142934ad4b208bd7da01409d472f1fa481d45b"): PlayNextRequest => PlayNextResponse
}
message!(
    PlayNextRequest,
    "rosbag2_interfaces" / "srv" / "PlayNext_Request",
    "10706411ae955640d84ffb56391bbb480c5a17af5443dd61e631c03ed659cf90",
    ""
);
message!(
    PlayNextResponse,
    "rosbag2_interfaces" / "srv" / "PlayNext_Response",
    "3b3a1090b37438553eadea1180bf448b12092bdeda84e47e3ad811cc0e9da02b",
    "bool success\n"
);

service! {
    /// Plays several messages at once; works only while paused.
    Burst("rosbag2_interfaces", "3cba361b055bbec262593fcb727aeb9fb6d096f70b50e6cd9b548b63296f2380"): BurstRequest => BurstResponse
}
message!(
    BurstRequest,
    "rosbag2_interfaces" / "srv" / "Burst_Request",
    "df1559ec51bcc50327983ec73a89b5d619b6c43dd7a950e5612022bbfbcebdde",
    "uint64 num_messages\n"
);
message!(
    BurstResponse,
    "rosbag2_interfaces" / "srv" / "Burst_Response",
    "4719b7f8deb6bab5b7b7d087fdeda63cc903a9503863e0726d930f8d87df6285",
    "uint64 actually_burst\n"
);

service! {
    /// Continues from another time in the bag.
    Seek("rosbag2_interfaces", "6e9b6b38c44f111e36e43903da565fb2775ab0f0e69c02169a5fb0f130b23eb4"): SeekRequest => SeekResponse
}
message!(
    SeekRequest,
    "rosbag2_interfaces" / "srv" / "Seek_Request",
    "9083eb4e68b18e1523bd04fe5a1d8ea29a17decbf5f9022aee4d14e450580776",
    definition!("builtin_interfaces/Time time\n", Time)
);
message!(
    SeekResponse,
    "rosbag2_interfaces" / "srv" / "Seek_Response",
    "173c2de943541f1998b379e41bd5cd6fdb97fcccd5557548c974cbb1fbb473f0",
    "bool success\n"
);
