//! Messages to and from values: which ROS types may stand for a channel, and how they are read.

use super::column::Quantity;
use super::names::Role;
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::standard::{Float64, Header, JointState, Temperature, Time};
use mr_damper_msgs::{CdrError, CoilCurrent, CommandVoltage, Displacement, Force, Message, Velocity, cdr};

/// A message, decoded.
pub(super) struct Decoded {
    /// The header's stamp in nanoseconds; `None` for types without header.
    pub(super) stamp: Option<i64>,
    /// One value for each series of the topic; `None` where the message has none.
    pub(super) values: [Option<f64>; 3],
}

/// Why a message could not be decoded.
pub(super) struct Fault(pub(super) String);

/// How the messages of a topic are read.
pub(super) enum Decoder {
    Displacement,
    Velocity,
    Force,
    Current,
    Command,
    Temperature,
    Float64,
    /// One joint, by name, and which of its values are taken.
    Joint(String, fn(JointValues) -> [Option<f64>; 3]),
}

/// Position, velocity and effort of a joint, as far as they are published.
pub(super) struct JointValues {
    position: Option<f64>,
    velocity: Option<f64>,
    effort: Option<f64>,
}

impl Decoder {
    /// The decoder for a topic with this role and type, if the type may stand for the role.
    pub(super) fn new(role: &Role, type_name: &str, joint: Option<&str>) -> Option<Self> {
        if type_name == JointState::TYPE {
            let joint = joint?.to_owned();
            return match role {
                Role::Joints => Some(Self::Joint(joint, |j| [j.position, j.velocity, j.effort])),
                Role::Known(Quantity::Displacement) => Some(Self::Joint(joint, |j| [j.position, None, None])),
                Role::Known(Quantity::Velocity) => Some(Self::Joint(joint, |j| [j.velocity, None, None])),
                Role::Known(Quantity::Force) => Some(Self::Joint(joint, |j| [j.effort, None, None])),
                _ => None,
            };
        }
        if type_name == Float64::TYPE {
            return (*role != Role::Joints).then_some(Self::Float64);
        }
        let Role::Known(quantity) = role else { return None };
        let (own, decoder) = match quantity {
            Quantity::Displacement => (Displacement::TYPE, Self::Displacement),
            Quantity::Velocity | Quantity::BodyVelocity => (Velocity::TYPE, Self::Velocity),
            Quantity::Force | Quantity::ForceRequest => (Force::TYPE, Self::Force),
            Quantity::Current => (CoilCurrent::TYPE, Self::Current),
            Quantity::Command => (CommandVoltage::TYPE, Self::Command),
            Quantity::CaseTemperature | Quantity::AmbientTemperature => {
                (Temperature::TYPE, Self::Temperature)
            }
            Quantity::Setpoint => return None,
        };
        (own == type_name).then_some(decoder)
    }

    /// Decodes one message, given as CDR with its header.
    pub(super) fn decode(&self, data: &[u8]) -> Result<Decoded, Fault> {
        match self {
            Self::Displacement => parse(data, |m: Displacement| (m.header, m.displacement)),
            Self::Velocity => parse(data, |m: Velocity| (m.header, m.velocity)),
            Self::Force => parse(data, |m: Force| (m.header, m.force)),
            Self::Current => parse(data, |m: CoilCurrent| (m.header, m.current)),
            Self::Command => parse(data, |m: CommandVoltage| (m.header, m.voltage)),
            Self::Temperature => parse(data, |m: Temperature| (m.header, m.temperature)),
            Self::Float64 => {
                let message: Float64 = from_cdr(data)?;
                Ok(Decoded { stamp: None, values: [Some(message.data), None, None] })
            }
            Self::Joint(joint, take) => {
                let message: JointState = from_cdr(data)?;
                let Some(index) = message.name.iter().position(|name| name == joint) else {
                    let names = message.name.join(", ");
                    return Err(Fault(format!("joint `{joint}` is not among: {names}")));
                };
                // Publishers leave out what they do not know: those arrays are empty.
                let at = |values: &[f64]| values.get(index).copied();
                let values = take(JointValues {
                    position: at(&message.position),
                    velocity: at(&message.velocity),
                    effort: at(&message.effort),
                });
                Ok(Decoded { stamp: Some(message.header.stamp.as_nanos()), values })
            }
        }
    }
}

fn from_cdr<M: Message>(data: &[u8]) -> Result<M, Fault> {
    cdr::from_slice(data).map_err(|error| Fault(error.to_string()))
}

fn parse<M: Message>(data: &[u8], split: fn(M) -> (Header, f64)) -> Result<Decoded, Fault> {
    let (header, value) = split(from_cdr(data)?);
    Ok(Decoded { stamp: Some(header.stamp.as_nanos()), values: [Some(value), None, None] })
}

/// Writes one sample as CDR into a buffer that is reused; the error says why it cannot be written.
type Encode = fn(Stamp, f64, &mut Vec<u8>) -> Result<(), String>;

/// What a column is written as.
pub(super) struct Encoder {
    pub(super) type_name: &'static str,
    pub(super) definition: &'static str,
    pub(super) type_hash: &'static str,
    pub(super) encode: Encode,
}

impl Encoder {
    /// The encoder for a column of a run, by its SI name. A run knows no variances: they are written as
    /// unknown, which is zero.
    pub(super) fn of_column(column: &str) -> Self {
        match Quantity::of_si_name(column) {
            Some(Quantity::Displacement) => Self::new::<Displacement>(|stamp, displacement, cdr| {
                stamped(stamp, cdr, |header| Displacement { header, displacement, variance: 0.0 })
            }),
            Some(Quantity::Velocity | Quantity::BodyVelocity) => {
                Self::new::<Velocity>(|stamp, velocity, cdr| {
                    stamped(stamp, cdr, |header| Velocity { header, velocity, variance: 0.0 })
                })
            }
            Some(Quantity::Force | Quantity::ForceRequest) => Self::new::<Force>(|stamp, force, cdr| {
                stamped(stamp, cdr, |header| Force { header, force, variance: 0.0 })
            }),
            Some(Quantity::Current) => Self::new::<CoilCurrent>(|stamp, current, cdr| {
                stamped(stamp, cdr, |header| CoilCurrent { header, current, variance: 0.0 })
            }),
            Some(Quantity::Command) => Self::new::<CommandVoltage>(|stamp, voltage, cdr| {
                stamped(stamp, cdr, |header| CommandVoltage { header, voltage, variance: 0.0 })
            }),
            Some(Quantity::CaseTemperature | Quantity::AmbientTemperature) => {
                Self::new::<Temperature>(|stamp, temperature, cdr| {
                    stamped(stamp, cdr, |header| Temperature { header, temperature, variance: 0.0 })
                })
            }
            Some(Quantity::Setpoint) | None => {
                Self::new::<Float64>(|_, data, cdr| cdr::write_into(&Float64 { data }, cdr).map_err(text))
            }
        }
    }

    fn new<M: Message>(encode: Encode) -> Self {
        Self { type_name: M::TYPE, definition: M::DEFINITION, type_hash: M::TYPE_HASH, encode }
    }
}

fn stamped<M: Message>(
    stamp: Stamp,
    cdr: &mut Vec<u8>,
    make: impl FnOnce(Header) -> M,
) -> Result<(), String> {
    let stamp = Time::from_nanos(stamp.nanos()).map_err(|error| format!("{error}: shift the run's times"))?;
    cdr::write_into(&make(Header { stamp, frame_id: String::new() }), cdr).map_err(text)
}

fn text(error: CdrError) -> String {
    error.to_string()
}
