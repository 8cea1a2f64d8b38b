//! Signs of channels: for runs whose sensors count in the opposite direction (extension and tension are positive).

use super::RunError;
use super::column::{Column, Quantity};
use super::map::Map;
use super::names::{TOPICS, topic_of};
use mr_damper_model::sample::{DriveKind, Run, Trace};
use std::path::Path;
use std::str::FromStr;

/// The sign of a channel, given as `CHANNEL=-1`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sign {
    quantity: Quantity,
    negative: bool,
}

/// Why a text is not the sign of a channel.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SignError {
    /// The text has another form.
    #[error("`{text}` is not a sign; write CHANNEL=-1, as in displacement=-1")]
    Form {
        /// The text as given.
        text: String,
    },
    /// The channel is not known.
    #[error("`{name}` is not a channel; channels are {}", channels())]
    Channel {
        /// The text as given.
        name: String,
    },
}

fn channels() -> String {
    let names: Vec<_> = TOPICS.iter().map(|(_, topic)| *topic).collect();
    names.join(", ")
}

impl FromStr for Sign {
    type Err = SignError;

    fn from_str(text: &str) -> Result<Self, SignError> {
        let form = || SignError::Form { text: text.to_owned() };
        let (name, value) = text.split_once('=').ok_or_else(form)?;
        let negative = match value.trim() {
            "-1" => true,
            "1" | "+1" => false,
            _ => return Err(form()),
        };
        let name = name.trim();
        // The name of a topic, a column name in any unit, or the short name of the load cell's channel.
        let by_topic = || TOPICS.iter().find(|(_, topic)| *topic == name).map(|(quantity, _)| *quantity);
        let quantity = match Column::of_header(name) {
            Column::Known(quantity, _) => Some(quantity),
            _ if name == "force" => Some(Quantity::Force),
            _ => by_topic(),
        };
        let quantity = quantity.ok_or_else(|| SignError::Channel { name: name.to_owned() })?;
        Ok(Self { quantity, negative })
    }
}

impl Sign {
    /// Name of the channel.
    #[must_use]
    pub fn channel(&self) -> &'static str {
        topic_of(self.quantity)
    }

    /// True if `map` gives a sign to the same channel.
    #[must_use]
    pub fn is_given_by(&self, map: &Map) -> bool {
        map.of(self.quantity).is_some_and(super::map::Mapping::is_negative)
    }
}

/// Applies `signs` to the channels of `run`.
///
/// # Errors
/// [`RunError::SignOfNothing`] if the run does not have a channel.
pub(super) fn apply(signs: &[Sign], run: &mut Run, path: &Path) -> Result<(), RunError> {
    for sign in signs.iter().filter(|sign| sign.negative) {
        let Some(trace) = trace_of(run, sign.quantity).filter(|trace| !trace.is_empty()) else {
            return Err(RunError::SignOfNothing { path: path.to_owned(), channel: sign.channel() });
        };
        trace.values.iter_mut().for_each(|value| *value = -*value);
    }
    Ok(())
}

fn trace_of(run: &mut Run, quantity: Quantity) -> Option<&mut Trace> {
    match quantity {
        Quantity::Displacement => Some(&mut run.displacement_m),
        Quantity::Velocity => run.velocity_m_s.as_mut(),
        Quantity::Force => run.force_n.as_mut(),
        Quantity::Current => drive_of(run, DriveKind::CoilCurrent),
        Quantity::Command => drive_of(run, DriveKind::CommandVoltage),
        Quantity::CaseTemperature => run.case_temp_c.as_mut(),
        Quantity::BodyVelocity => run.body_velocity_m_s.as_mut(),
        Quantity::ForceRequest => run.force_request_n.as_mut(),
        Quantity::AmbientTemperature | Quantity::Setpoint => {
            run.other.iter_mut().find(|(name, _)| name == quantity.si_name()).map(|(_, trace)| trace)
        }
    }
}

/// The drive of this kind, which is carried through if the run has both.
fn drive_of(run: &mut Run, kind: DriveKind) -> Option<&mut Trace> {
    let Run { drive, other, .. } = run;
    match drive {
        Some((own, trace)) if *own == kind => Some(trace),
        _ => other.iter_mut().find(|(name, _)| name == kind.name()).map(|(_, trace)| trace),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_have_the_names_of_topics_and_columns() {
        for (text, channel) in [
            ("displacement=-1", "displacement"),
            ("displacement_in=-1", "displacement"),
            ("force=-1", "measured_force"),
            ("force_lbf = -1", "measured_force"),
            ("coil_current=1", "coil_current"),
        ] {
            assert_eq!(text.parse::<Sign>().expect(text).channel(), channel);
        }
        for (text, says) in [
            ("displacement", "write CHANNEL=-1"),
            ("displacement=-2", "write CHANNEL=-1"),
            ("stroke=-1", "channels are displacement, velocity, measured_force"),
        ] {
            let error = text.parse::<Sign>().expect_err(text).to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
