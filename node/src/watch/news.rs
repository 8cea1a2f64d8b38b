//! What is heard of a damper, whichever way it came.

use mr_damper_msgs::standard::{Header, Temperature};
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, Force, ForceEstimate, ForceResidual,
    ModeChange, Velocity,
};

/// A message of one of a damper's topics.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// Of `displacement`.
    Displacement(Displacement),
    /// Of `coil_current`.
    CoilCurrent(CoilCurrent),
    /// Of `command_voltage`.
    CommandVoltage(CommandVoltage),
    /// Of `velocity`.
    Velocity(Velocity),
    /// Of `measured_force`.
    MeasuredForce(Force),
    /// Of `case_temperature`.
    CaseTemperature(Temperature),
    /// Of `force_request`.
    ForceRequest(Force),
    /// Of `body_velocity`.
    BodyVelocity(Velocity),
    /// Of `force_estimate`.
    Estimate(ForceEstimate),
    /// Of `force_residual`.
    Residual(ForceResidual),
    /// Of `current_command`.
    Command(CurrentCommand),
    /// Of `mode`.
    Mode(ModeChange),
}

/// The topics by their names, as the node calls them; [`News::topic`] is an index into it.
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

impl News {
    /// Which of [`TOPICS`] it came on.
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

    /// Its header.
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
