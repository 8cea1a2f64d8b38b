//! Messages of a damper, from ROS or from Zenoh.

use mr_damper_msgs::standard::{Header, Temperature};
use mr_damper_msgs::{
    CdrError, CoilCurrent, CommandVoltage, CurrentCommand, Descriptor, Displacement, Force, ForceEstimate,
    ForceResidual, ModeChange, Velocity, cdr,
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

/// Type of the messages on a topic of [`TOPICS`]; `None` for other names.
#[must_use]
pub fn type_of(topic: &str) -> Option<Descriptor> {
    Some(match topic {
        "displacement" => Descriptor::of::<Displacement>(),
        "coil_current" => Descriptor::of::<CoilCurrent>(),
        "command_voltage" => Descriptor::of::<CommandVoltage>(),
        "velocity" | "body_velocity" => Descriptor::of::<Velocity>(),
        "measured_force" | "force_request" => Descriptor::of::<Force>(),
        "case_temperature" => Descriptor::of::<Temperature>(),
        "force_estimate" => Descriptor::of::<ForceEstimate>(),
        "force_residual" => Descriptor::of::<ForceResidual>(),
        "current_command" => Descriptor::of::<CurrentCommand>(),
        "mode" => Descriptor::of::<ModeChange>(),
        _ => return None,
    })
}

impl DamperMessage {
    /// Writes the message as CDR with its 4-byte header, and replaces the content of `buffer`.
    ///
    /// # Errors
    /// Never for these messages; see [`cdr::write_into`].
    pub fn write_cdr(&self, buffer: &mut Vec<u8>) -> Result<(), CdrError> {
        match self {
            Self::Displacement(message) => cdr::write_into(message, buffer),
            Self::CoilCurrent(message) => cdr::write_into(message, buffer),
            Self::CommandVoltage(message) => cdr::write_into(message, buffer),
            Self::Velocity(message) | Self::BodyVelocity(message) => cdr::write_into(message, buffer),
            Self::MeasuredForce(message) | Self::ForceRequest(message) => cdr::write_into(message, buffer),
            Self::CaseTemperature(message) => cdr::write_into(message, buffer),
            Self::Estimate(message) => cdr::write_into(message, buffer),
            Self::Residual(message) => cdr::write_into(message, buffer),
            Self::Command(message) => cdr::write_into(message, buffer),
            Self::Mode(message) => cdr::write_into(message, buffer),
        }
    }

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
