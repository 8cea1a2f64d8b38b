//! The messages of standard ROS 2 packages that the node sends and receives. SI units (REP-103).

use serde::{Deserialize, Serialize};

use crate::definition::{definition, text};
use crate::message::message;
use crate::nan;

/// `builtin_interfaces/msg/Time`: a point in time, counted from 1970 or from the start of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds, rounded down.
    pub sec: i32,
    /// Nanoseconds to add, less than a second.
    pub nanosec: u32,
}
message!(
    Time,
    "builtin_interfaces" / "msg" / "Time",
    "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
    text!(Time)
);

/// `std_msgs/msg/Header`: stamp and coordinate frame of a message.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When the data was taken.
    pub stamp: Time,
    /// The coordinate frame of the data.
    pub frame_id: String,
}
message!(
    Header,
    "std_msgs" / "msg" / "Header",
    "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    definition!(text!(Header), Time)
);

/// `std_msgs/msg/Float64`: a number without stamp or unit; the topic defines its meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64 {
    /// The number.
    #[serde(deserialize_with = "nan::or_null")]
    pub data: f64,
}
message!(
    Float64,
    "std_msgs" / "msg" / "Float64",
    "705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    text!(Float64)
);

/// `std_msgs/msg/Float32`: like [`Float64`], in single precision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float32 {
    /// The number.
    #[serde(deserialize_with = "nan::or_null_f32")]
    pub data: f32,
}
message!(
    Float32,
    "std_msgs" / "msg" / "Float32",
    "7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2",
    text!(Float32)
);

/// `rosgraph_msgs/msg/Clock`: simulated time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Clock {
    /// The time now.
    pub clock: Time,
}
message!(
    Clock,
    "rosgraph_msgs" / "msg" / "Clock",
    "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    definition!(text!(Clock), Time)
);

/// `sensor_msgs/msg/Temperature`: a temperature.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Temperature {
    /// Stamp and frame of the reading.
    pub header: Header,
    /// Temperature in degrees Celsius.
    #[serde(deserialize_with = "nan::or_null")]
    pub temperature: f64,
    /// Variance in square degrees Celsius; 0 is unknown.
    #[serde(deserialize_with = "nan::or_null")]
    pub variance: f64,
}
message!(
    Temperature,
    "sensor_msgs" / "msg" / "Temperature",
    "72514a14126ab9f8a9abec974c78e5610a367b59db5da355ff1fb982d5bad4b8",
    definition!(text!(Temperature), Header Time)
);

/// `sensor_msgs/msg/Range`: a distance along one ray, as defined in Iron and later. Earlier versions have no `variance`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// Stamp and frame of the reading.
    pub header: Header,
    /// One of the constants of this type.
    pub radiation_type: u8,
    /// Opening angle of the ray, in rad.
    #[serde(deserialize_with = "nan::or_null_f32")]
    pub field_of_view: f32,
    /// Smallest distance that the sensor can measure, in m.
    #[serde(deserialize_with = "nan::or_null_f32")]
    pub min_range: f32,
    /// Largest distance that the sensor can measure, in m.
    #[serde(deserialize_with = "nan::or_null_f32")]
    pub max_range: f32,
    /// Distance in m; infinite values are outside the limits, for sensors that only tell near from far.
    #[serde(deserialize_with = "nan::or_null_f32")]
    pub range: f32,
    /// Variance in m^2; 0 is unknown.
    #[serde(deserialize_with = "nan::or_null_f32")]
    pub variance: f32,
}
message!(
    Range,
    "sensor_msgs" / "msg" / "Range",
    "b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    definition!(text!(Range), Header Time)
);

impl Range {
    /// The sensor uses sound.
    pub const ULTRASOUND: u8 = 0;
    /// The sensor uses light.
    pub const INFRARED: u8 = 1;
}

/// `sensor_msgs/msg/JointState`: the state of several joints. The list of an unknown quantity is empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// Time of the reading.
    pub header: Header,
    /// Names of the joints; the other lists follow their order.
    pub name: Vec<String>,
    /// Positions in m (prismatic) or rad (revolute).
    pub position: Vec<f64>,
    /// Velocities in m/s or rad/s.
    pub velocity: Vec<f64>,
    /// Efforts in N or N m.
    pub effort: Vec<f64>,
}
message!(
    JointState,
    "sensor_msgs" / "msg" / "JointState",
    "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    definition!(text!(JointState), Header Time)
);

/// `diagnostic_msgs/msg/KeyValue`: one value of a diagnostic.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// Name of the value.
    pub key: String,
    /// The value, as text.
    pub value: String,
}
message!(
    KeyValue,
    "diagnostic_msgs" / "msg" / "KeyValue",
    "d68081eaa540288c5440753baecef0c4e16e81a5f78ad68902ded5100413bb42",
    text!(KeyValue)
);

/// `diagnostic_msgs/msg/DiagnosticStatus`: the health of one component.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// One of the constants of this type.
    pub level: u8,
    /// The component: `mr_damper: estimator`.
    pub name: String,
    /// The problem, as text for people.
    pub message: String,
    /// The hardware that the component belongs to.
    pub hardware_id: String,
    /// Values.
    pub values: Vec<KeyValue>,
}
message!(
    DiagnosticStatus,
    "diagnostic_msgs" / "msg" / "DiagnosticStatus",
    "b0e3e692ea2d54a8af2f4ef1930e81556a2db55216b771f8a7d2724ed47bf0e4",
    definition!(text!(DiagnosticStatus), KeyValue)
);

impl DiagnosticStatus {
    /// No problem.
    pub const OK: u8 = 0;
    /// Works, but needs attention.
    pub const WARN: u8 = 1;
    /// Does not work.
    pub const ERROR: u8 = 2;
    /// No recent data.
    pub const STALE: u8 = 3;
}

/// `diagnostic_msgs/msg/DiagnosticArray`: the health of several components at one time.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// Time of the report.
    pub header: Header,
    /// The components.
    pub status: Vec<DiagnosticStatus>,
}
message!(
    DiagnosticArray,
    "diagnostic_msgs" / "msg" / "DiagnosticArray",
    "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    definition!(text!(DiagnosticArray), Header Time DiagnosticStatus KeyValue)
);
