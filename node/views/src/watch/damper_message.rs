//! Messages of a damper, from ROS or from Zenoh.

use mr_damper_msgs::standard::{Header, Temperature};
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, Force, ForceEstimate, ForceResidual,
    ModeChange, Velocity,
};

/// A message on one of a damper's topics.
#[derive(Debug, Clone, PartialEq)]
pub enum DamperMessage {
    /// On `displacement`.
    Displacement(Displacement),
    /// On `coil_current`.
    CoilCurrent(CoilCurrent),
    /// On `command_voltage`.
    CommandVoltage(CommandVoltage),
    /// On `velocity`.
    Velocity(Velocity),
    /// On `measured_force`.
    MeasuredForce(Force),
    /// On `case_temperature`.
    CaseTemperature(Temperature),
    /// On `force_request`.
    ForceRequest(Force),
    /// On `body_velocity`.
    BodyVelocity(Velocity),
    /// On `force_estimate`.
    Estimate(ForceEstimate),
    /// On `force_residual`.
    Residual(ForceResidual),
    /// On `current_command`.
    Command(CurrentCommand),
    /// On `mode`.
    Mode(ModeChange),
}

/// Names of the node's topics. [`DamperMessage::topic`] is an index into this list.
pub const TOPICS: [&str; 12] = [
    "displacement",
    "coil_current",
    "command_voltage",
    "velocity",
    "measured_force",
    "case_temperature",
    "force_request",
    "body_velocity",
    "force_estimate",
    "force_residual",
    "current_command",
    "mode",
];

impl DamperMessage {
    /// Index of the message's topic in [`TOPICS`].
    #[must_use]
    pub const fn topic(&self) -> usize {
        match self {
            Self::Displacement(_) => 0,
            Self::CoilCurrent(_) => 1,
            Self::CommandVoltage(_) => 2,
            Self::Velocity(_) => 3,
            Self::MeasuredForce(_) => 4,
            Self::CaseTemperature(_) => 5,
            Self::ForceRequest(_) => 6,
            Self::BodyVelocity(_) => 7,
            Self::Estimate(_) => 8,
            Self::Residual(_) => 9,
            Self::Command(_) => 10,
            Self::Mode(_) => 11,
        }
    }

    /// Header of the message.
    #[must_use]
    pub const fn header(&self) -> &Header {
        match self {
            Self::Displacement(message) => &message.header,
            Self::CoilCurrent(message) => &message.header,
            Self::CommandVoltage(message) => &message.header,
            Self::Velocity(message) | Self::BodyVelocity(message) => &message.header,
            Self::MeasuredForce(message) | Self::ForceRequest(message) => &message.header,
            Self::CaseTemperature(message) => &message.header,
            Self::Estimate(message) => &message.header,
            Self::Residual(message) => &message.header,
            Self::Command(message) => &message.header,
            Self::Mode(message) => &message.header,
        }
    }
}
