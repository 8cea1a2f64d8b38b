//! Encoding of values as messages: the message type for each column of a run.

use super::column::Quantity;
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::standard::{Float64, Header, Temperature, Time};
use mr_damper_msgs::{
    CdrError, CoilCurrent, CommandVoltage, Displacement, Force, Message, TimeOutOfRange, Velocity, cdr,
};

/// A sample that cannot be written as a message.
#[derive(Debug, thiserror::Error)]
pub(super) enum EncodeError {
    #[error("{0}: shift the run's times")]
    Stamp(TimeOutOfRange),
    #[error(transparent)]
    Cdr(#[from] CdrError),
}

/// Writes one sample as CDR into a reused buffer.
type Encode = fn(Stamp, f64, &mut Vec<u8>) -> Result<(), EncodeError>;

/// The message type of a column, and its encoding function.
pub(super) struct Encoder {
    pub(super) type_name: &'static str,
    pub(super) definition: &'static str,
    pub(super) type_hash: &'static str,
    pub(super) encode: Encode,
}

impl Encoder {
    /// The encoder for a column of a run, by its SI name. A run has no variances, so they are written as zero, which means
    /// unknown.
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
                Self::new::<Float64>(|_, data, cdr| Ok(cdr::write_into(&Float64 { data }, cdr)?))
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
) -> Result<(), EncodeError> {
    let stamp = Time::from_nanos(stamp.nanos()).map_err(EncodeError::Stamp)?;
    Ok(cdr::write_into(&make(Header { stamp, frame_id: String::new() }), cdr)?)
}
