//! The messages of `geometry_msgs` that an input can have as its type. SI units (REP-103).

use serde::{Deserialize, Serialize};

use crate::definition::{definition, text};
use crate::message::message;
use crate::nan;
use crate::standard::Header;

/// `geometry_msgs/msg/Vector3`: a vector in space.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// Along the first axis.
    #[serde(deserialize_with = "nan::or_null")]
    pub x: f64,
    /// Along the second axis.
    #[serde(deserialize_with = "nan::or_null")]
    pub y: f64,
    /// Along the third axis.
    #[serde(deserialize_with = "nan::or_null")]
    pub z: f64,
}
message!(
    Vector3,
    "geometry_msgs" / "msg" / "Vector3",
    "cc12fe83e4c02719f1ce8070bfd14aecd40f75a96696a67a2a1f37f7dbb0765d",
    text!(Vector3)
);

/// `geometry_msgs/msg/Wrench`: force and torque.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// Force in N.
    pub force: Vector3,
    /// Torque in N m.
    pub torque: Vector3,
}
message!(
    Wrench,
    "geometry_msgs" / "msg" / "Wrench",
    "018e8519d57c16adbe97c9fe1460ef21fec7e31bc541de3d653a35895677ce52",
    definition!(text!(Wrench), Vector3)
);

/// `geometry_msgs/msg/WrenchStamped`: force and torque with stamp and frame, as multi-axis load cells publish them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WrenchStamped {
    /// When it was taken, and the frame of its axes.
    pub header: Header,
    /// Force and torque.
    pub wrench: Wrench,
}
message!(
    WrenchStamped,
    "geometry_msgs" / "msg" / "WrenchStamped",
    "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    definition!(text!(WrenchStamped), Header Wrench Vector3 Time)
);

/// `geometry_msgs/msg/Twist`: linear and angular velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Twist {
    /// Velocity in m/s.
    pub linear: Vector3,
    /// Angular velocity in rad/s.
    pub angular: Vector3,
}
message!(
    Twist,
    "geometry_msgs" / "msg" / "Twist",
    "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    definition!(text!(Twist), Vector3)
);

/// `geometry_msgs/msg/TwistStamped`: velocity with stamp and frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TwistStamped {
    /// When it was taken, and the frame of its axes.
    pub header: Header,
    /// Velocity.
    pub twist: Twist,
}
message!(
    TwistStamped,
    "geometry_msgs" / "msg" / "TwistStamped",
    "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    definition!(text!(TwistStamped), Header Twist Vector3 Time)
);
