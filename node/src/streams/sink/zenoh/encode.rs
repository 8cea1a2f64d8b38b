//! Encodes events as CBOR, as JSON or as ROS messages in CDR.

use super::payload::Item;
use crate::estimation::wire;
use crate::estimation::wire::ModelNames;
use crate::zenoh::session::Encoding;
use mr_damper_model::pipeline::Event;
use mr_damper_model::sample::{Drive, Reading, Sample};
use mr_damper_msgs::standard::{Header, Temperature};
use mr_damper_msgs::{CdrError, CoilCurrent, CommandVoltage, Displacement, Force, Message, Velocity, cdr};

/// Length of the attachment of a CDR payload, in bytes.
pub(super) const ATTACHMENT_LEN: usize = 17;

/// A payload in the encoding given by [`encoding_of`], and the attachment that CDR needs.
#[derive(Debug)]
pub(super) struct Encoded {
    pub(super) bytes: Vec<u8>,
    pub(super) attachment: Option<[u8; ATTACHMENT_LEN]>,
}

/// An event could not be encoded. The text is logged.
#[derive(Debug, thiserror::Error)]
pub(super) enum EncodeError {
    #[error("CBOR: {0}")]
    Cbor(#[from] ciborium::ser::Error<std::io::Error>),
    #[error("JSON: {0}")]
    Json(#[from] serde_json::Error),
    #[error("CDR: {0}")]
    Cdr(#[from] CdrError),
}

/// The encoding that is used for a topic: instead of CDR it is CBOR when the topic has no ROS message.
pub(super) const fn encoding_of(configured: Encoding, topic: super::topic::Topic) -> Encoding {
    match configured {
        Encoding::Cdr if topic.ros_type().is_none() => Encoding::Cbor,
        other => other,
    }
}

/// Encodes an event as payload number `seq` of its route.
pub(super) fn encode(
    item: &Item,
    seq: u64,
    configured: Encoding,
    names: &ModelNames,
    frame_id: &str,
) -> Result<Encoded, EncodeError> {
    let encoding = encoding_of(configured, item.topic());
    let bytes = match encoding {
        Encoding::Json => serde_json::to_vec(&item.payload(seq, names))?,
        Encoding::Cbor => cbor(item, seq, names)?,
        Encoding::Cdr => match ros_bytes(&item.event, names, frame_id) {
            Some(bytes) => bytes?,
            None => cbor(item, seq, names)?,
        },
    };
    let attachment = (encoding == Encoding::Cdr).then(|| attachment(item, seq));
    Ok(Encoded { bytes, attachment })
}

fn cbor(item: &Item, seq: u64, names: &ModelNames) -> Result<Vec<u8>, EncodeError> {
    let mut bytes = Vec::with_capacity(192);
    ciborium::into_writer(&item.payload(seq, names), &mut bytes)?;
    Ok(bytes)
}

/// The attachment: `seq` (i64), `stamp_ns` (i64), validity (u8), little endian. The first 16 bytes have the layout of the
/// attachment of rmw_zenoh, so that its tools can read them.
fn attachment(item: &Item, seq: u64) -> [u8; ATTACHMENT_LEN] {
    let mut bytes = [0; ATTACHMENT_LEN];
    bytes[..8].copy_from_slice(&seq.to_le_bytes());
    bytes[8..16].copy_from_slice(&item.stamp().nanos().to_le_bytes());
    bytes[16] = item.validity as u8;
    bytes
}

/// The ROS message in CDR, including the CDR header; `None` for events without a message.
pub(super) fn ros_bytes(
    event: &Event,
    names: &ModelNames,
    frame_id: &str,
) -> Option<Result<Vec<u8>, EncodeError>> {
    // A stamp after 2038 does not fit into a ROS header, but is exact in the attachment.
    Some(match event {
        Event::Input(sample) => input_bytes(sample, wire::header(sample.stamp, frame_id)),
        Event::Estimate(estimate) => write(&wire::force_estimate(estimate, names, frame_id)),
        Event::Residual(residual) => write(&wire::force_residual(residual, frame_id)),
        Event::Transition(transition) => write(&wire::mode_change(transition, frame_id)),
        Event::Command(commanded) => write(&wire::current_command(commanded, frame_id)),
        Event::Refusal(_) | Event::Alarm(_) => return None,
    })
}

fn input_bytes(sample: &Sample, header: Header) -> Result<Vec<u8>, EncodeError> {
    // The pipeline does not keep variances; zero means unknown.
    let variance = 0.0;
    match sample.reading {
        Reading::Displacement(x) => write(&Displacement { header, displacement: x.get(), variance }),
        Reading::Velocity(v) | Reading::BodyVelocity(v) => {
            write(&Velocity { header, velocity: v.get(), variance })
        }
        Reading::Drive(Drive::CoilCurrent(i)) => write(&CoilCurrent { header, current: i.get(), variance }),
        Reading::Drive(Drive::CommandVoltage(u)) => {
            write(&CommandVoltage { header, voltage: u.get(), variance })
        }
        Reading::Force(f) | Reading::ForceRequest(f) => write(&Force { header, force: f.get(), variance }),
        Reading::CaseTemperature(t) => write(&Temperature { header, temperature: t.get(), variance }),
    }
}

fn write<M: Message>(message: &M) -> Result<Vec<u8>, EncodeError> {
    Ok(cdr::to_vec(message)?)
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;
    use mr_damper_model::pipeline::Validity;
    use mr_damper_msgs::ForceEstimate;

    #[test]
    fn cdr_has_the_ros_message_as_payload_and_the_rest_in_the_attachment() {
        let item = Item::new(samples::estimate(1_700_000_000_000_000_005, -412.5), |_| None);
        let encoded =
            encode(&item, 9, Encoding::Cdr, &samples::names(), "rod").expect("an estimate has a message");
        let message: ForceEstimate = cdr::from_slice(&encoded.bytes).expect("written just now");
        assert_eq!(message.force, -412.5);
        assert_eq!(message.header.frame_id, "rod");
        assert_eq!(message.header.stamp.as_nanos(), 1_700_000_000_000_000_005);
        assert_eq!(message.model, samples::names().free);
        let attachment = encoded.attachment.expect("CDR has one");
        assert_eq!(attachment[..8], 9_u64.to_le_bytes());
        assert_eq!(attachment[8..16], 1_700_000_000_000_000_005_i64.to_le_bytes());
        assert_eq!(attachment[16], Validity::Valid as u8);
    }

    #[test]
    fn every_ros_type_of_a_topic_exists() {
        let names = samples::names();
        for event in samples::one_of_each() {
            let item = Item::new(event, |_| None);
            let encoded = encode(&item, 1, Encoding::Cdr, &names, "").expect("all events encode");
            let named = item.topic().ros_type();
            assert_eq!(encoding_of(Encoding::Cdr, item.topic()) == Encoding::Cdr, named.is_some());
            assert_eq!(encoded.attachment.is_some(), named.is_some());
            if let Some(named) = named {
                assert!(mr_damper_msgs::MESSAGES.iter().any(|known| known.type_name == named), "{named}");
            }
        }
    }
}
