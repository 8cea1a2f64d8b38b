//! The mirrored topics and the fields of their payloads. One table defines payloads, keys and `meta`.

use mr_damper_model::pipeline::Event;
use mr_damper_model::sample::{Drive, Reading};

/// A topic under `state/` and `web/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Topic {
    /// Damper displacement.
    Displacement,
    /// Measured velocity.
    Velocity,
    /// Coil current.
    CoilCurrent,
    /// Command voltage.
    CommandVoltage,
    /// Measured force.
    MeasuredForce,
    /// Temperature of the damper's case.
    CaseTemperature,
    /// Velocity of the body above the damper.
    BodyVelocity,
    /// Demanded forces.
    ForceRequest,
    /// Force estimates.
    ForceEstimate,
    /// Residuals of the simulation (free run).
    ForceResidual,
    /// Changes of mode.
    Mode,
    /// Samples that were refused.
    Refused,
    /// Changes of the residual alarm (raised or ended).
    Alarm,
    /// Commanded currents.
    CurrentCommand,
}

/// One field of a payload: name, unit (empty for text and truth values), meaning.
pub(super) type Field = (&'static str, &'static str, &'static str);

impl Topic {
    /// All topics, in the order of their indices.
    pub const ALL: [Self; 14] = [
        Self::Displacement,
        Self::Velocity,
        Self::CoilCurrent,
        Self::CommandVoltage,
        Self::MeasuredForce,
        Self::CaseTemperature,
        Self::BodyVelocity,
        Self::ForceRequest,
        Self::ForceEstimate,
        Self::ForceResidual,
        Self::Mode,
        Self::Refused,
        Self::Alarm,
        Self::CurrentCommand,
    ];

    /// The topic's name, which is the last part of its keys and equals the name of the ROS topic, if there is one.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Displacement => "displacement",
            Self::Velocity => "velocity",
            Self::CoilCurrent => "coil_current",
            Self::CommandVoltage => "command_voltage",
            Self::MeasuredForce => "measured_force",
            Self::CaseTemperature => "case_temperature",
            Self::BodyVelocity => "body_velocity",
            Self::ForceRequest => "force_request",
            Self::ForceEstimate => "force_estimate",
            Self::ForceResidual => "force_residual",
            Self::Mode => "mode",
            Self::Refused => "refused",
            Self::Alarm => "alarm",
            Self::CurrentCommand => "current_command",
        }
    }

    /// The topic that a reading belongs to.
    #[must_use]
    pub const fn of_reading(reading: Reading) -> Self {
        match reading {
            Reading::Displacement(_) => Self::Displacement,
            Reading::Velocity(_) => Self::Velocity,
            Reading::Drive(Drive::CoilCurrent(_)) => Self::CoilCurrent,
            Reading::Drive(Drive::CommandVoltage(_)) => Self::CommandVoltage,
            Reading::Force(_) => Self::MeasuredForce,
            Reading::CaseTemperature(_) => Self::CaseTemperature,
            Reading::BodyVelocity(_) => Self::BodyVelocity,
            Reading::ForceRequest(_) => Self::ForceRequest,
        }
    }

    /// The topic that an event is published on.
    #[must_use]
    pub const fn of_event(event: &Event) -> Self {
        match event {
            Event::Input(sample) => Self::of_reading(sample.reading),
            Event::Refusal(_) => Self::Refused,
            Event::Estimate(_) => Self::ForceEstimate,
            Event::Residual(_) => Self::ForceResidual,
            Event::Transition(_) => Self::Mode,
            Event::Alarm(_) => Self::Alarm,
            Event::Command(_) => Self::CurrentCommand,
        }
    }

    /// True for inputs of the node.
    #[must_use]
    pub const fn is_input(self) -> bool {
        !matches!(
            self,
            Self::ForceEstimate
                | Self::ForceResidual
                | Self::Mode
                | Self::Refused
                | Self::Alarm
                | Self::CurrentCommand
        )
    }

    /// The ROS message type of the topic. `None` for [`Topic::Refused`] and [`Topic::Alarm`], which are published as CBOR when
    /// the others are CDR.
    #[must_use]
    pub const fn ros_type(self) -> Option<&'static str> {
        Some(match self {
            Self::Displacement => "mr_damper_msgs/msg/Displacement",
            Self::Velocity => "mr_damper_msgs/msg/Velocity",
            Self::CoilCurrent => "mr_damper_msgs/msg/CoilCurrent",
            Self::CommandVoltage => "mr_damper_msgs/msg/CommandVoltage",
            Self::MeasuredForce => "mr_damper_msgs/msg/Force",
            Self::CaseTemperature => "sensor_msgs/msg/Temperature",
            Self::BodyVelocity => "mr_damper_msgs/msg/Velocity",
            Self::ForceRequest => "mr_damper_msgs/msg/Force",
            Self::CurrentCommand => "mr_damper_msgs/msg/CurrentCommand",
            Self::ForceEstimate => "mr_damper_msgs/msg/ForceEstimate",
            Self::ForceResidual => "mr_damper_msgs/msg/ForceResidual",
            Self::Mode => "mr_damper_msgs/msg/ModeChange",
            Self::Refused | Self::Alarm => return None,
        })
    }

    /// Name of the field that holds an input's value.
    pub(super) const fn value_field(self) -> &'static str {
        match self {
            Self::Displacement => "displacement_m",
            Self::Velocity | Self::BodyVelocity => "velocity_m_s",
            Self::CoilCurrent => "current_a",
            Self::CommandVoltage => "command_v",
            Self::CaseTemperature => "case_temp_c",
            Self::MeasuredForce | Self::ForceRequest => "force_n",
            Self::ForceEstimate
            | Self::ForceResidual
            | Self::Mode
            | Self::Refused
            | Self::Alarm
            | Self::CurrentCommand => "value",
        }
    }

    /// The fields of the payload, except `seq`, `stamp_ns` and `validity`, which all payloads have.
    pub(super) const fn fields(self) -> &'static [Field] {
        match self {
            Self::Displacement => &[("displacement_m", "m", "positive extends the damper")],
            Self::Velocity => &[("velocity_m_s", "m/s", "positive extends the damper")],
            Self::CoilCurrent => &[("current_a", "A", "current through the coil")],
            Self::CommandVoltage => &[("command_v", "V", "command voltage of the damper's driver")],
            Self::MeasuredForce => &[("force_n", "N", "positive is tension on the rod")],
            Self::CaseTemperature => &[("case_temp_c", "degC", "temperature of the damper's case")],
            Self::BodyVelocity => {
                &[("velocity_m_s", "m/s", "velocity of the body above the damper, up positive")]
            }
            Self::ForceRequest => {
                &[("force_n", "N", "demanded force (force request); positive is tension on the rod")]
            }
            Self::ForceEstimate => &[
                ("force_n", "N", "positive is tension on the rod; null when there is no estimate"),
                ("std_dev_n", "N", "expected standard deviation of the error; null when not known"),
                ("model", "", "name of the model that the estimate comes from"),
                ("mode", "", "one of modes"),
                ("reasons", "", "list of reasons that reduce the validity; empty when there are none"),
                ("input_age_s", "s", "displacement stamp minus stamp of the drive; null when none was used"),
                ("band_low_n", "N", "lower end of the 90 % band; null when not known"),
                ("band_high_n", "N", "upper end of the 90 % band; null when not known"),
                (
                    "band_calibrated",
                    "",
                    "true when the band was calibrated on held-out runs; otherwise it is derived from std_dev_n",
                ),
            ],
            Self::ForceResidual => &[
                ("measured_n", "N", "measured force at the stamp"),
                ("predicted_n", "N", "simulated force (free run, without measured force)"),
                ("residual_n", "N", "measured minus predicted"),
                ("normalised", "1", "residual over the model's expected RMSE; null when not known"),
                ("windowed_rsse_n", "N", "root mean squared residual (RMSE) with exponential forgetting"),
                (
                    "windowed_esr",
                    "1",
                    "windowed_rsse_n squared, over the variance of the measured force (NMSE)",
                ),
                ("window_s", "s", "time constant of the forgetting"),
                ("alarm", "", "true while the residual alarm is active"),
            ],
            Self::Mode => &[
                ("from_mode", "", "one of modes"),
                ("to_mode", "", "one of modes"),
                ("reason", "", "reason as text"),
            ],
            Self::CurrentCommand => &[
                ("current_a", "A", "never null"),
                ("force_requested_n", "N", "demanded force; null when no force is demanded"),
                (
                    "force_expected_n",
                    "N",
                    "force that the model predicts for this current; null when not known",
                ),
                ("achievable", "", "true when the damper can produce the demanded force now"),
                ("dissipative", "", "true when the demanded force takes energy out of the motion"),
                ("limited_by", "", "the limit that changed the current, if any"),
                ("achievable_min_n", "N", "smallest force at this motion; null when not known"),
                ("achievable_max_n", "N", "largest force at this motion; null when not known"),
            ],
            Self::Alarm => &[
                ("raised", "", "true when the alarm was raised, false when it ended"),
                (
                    "ratio",
                    "1",
                    "windowed RMSE over the expected RMSE; null when a model swap, a reset or a gap ended the alarm",
                ),
            ],
            Self::Refused => &[
                ("topic", "", "the input's topic"),
                ("value", "", "the refused value, in the unit of that topic; null when it is not finite"),
                ("unit", "", "unit of the value"),
                ("reason", "", "reason as text"),
            ],
        }
    }
}
