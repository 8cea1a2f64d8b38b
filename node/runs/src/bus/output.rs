//! Outputs of a running node as messages of a bus.
//!
//! ```text
//! force_estimate=DAMPER_FL,force=Force,validity=Validity,counter=Alive,checksum=Crc,data_id=291
//! current_command=COIL_FL,current=Demand,counter=Alive,checksum=Crc
//! ```
//!
//! After the name of the topic come the message and, for each field, the signal that carries it. A number is sent in the unit that the
//! DBC file gives the signal. A number that its signal cannot carry is sent as the pattern *not available* (`encode.rs`). Bits of the
//! message that no field uses are zero.

use super::dbc::{Database, Message};
use super::error::BusError;
use super::frame::{CanId, MOST_BYTES, bytes_of_code};
use super::protection::{Protection, ProtectionNames, is_plain, signal_of};
use super::signal::{Presence, Signal};
use crate::extract::Dimension;
use crate::suggest;
use crate::unit::{self, Unit};
use std::str::FromStr;

/// The form of an output.
const FORM: &str =
    "TOPIC=MESSAGE,FIELD=SIGNAL,..., as in force_estimate=DAMPER_FL,force=Force,validity=Validity";

/// A topic that can be sent to a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputTopic {
    /// `force_estimate`.
    ForceEstimate,
    /// `current_command`.
    CurrentCommand,
}

/// A field of an output, named as in the ROS message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputField {
    /// Estimated force.
    Force,
    /// Its standard deviation.
    StdDev,
    /// Lower end of its 90 % band.
    BandLow,
    /// Upper end of its 90 % band.
    BandHigh,
    /// Validity: 0 is VALID, 4 is INVALID.
    Validity,
    /// Mode: 0 is `arx`, 4 is `fault`.
    Mode,
    /// Reasons, one bit each.
    Reasons,
    /// Commanded current.
    Current,
    /// Demanded force.
    ForceRequested,
    /// Force that the current is expected to give.
    ForceExpected,
    /// The limit that applies to the current; 0: none.
    LimitedBy,
    /// 1 if the demanded force is achievable.
    Achievable,
}

/// Kind of content of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Content {
    /// A physical quantity.
    Number(Dimension),
    /// A whole number from 0 to this one.
    Code(u64),
}

/// The value of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldValue {
    /// A number in SI units; NaN means *not available*.
    Number(f64),
    /// A code.
    Code(u64),
}

impl OutputTopic {
    const ALL: [Self; 2] = [Self::ForceEstimate, Self::CurrentCommand];

    /// The name of the topic.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ForceEstimate => "force_estimate",
            Self::CurrentCommand => "current_command",
        }
    }

    /// The fields of the topic; the first one must be sent.
    const fn fields(self) -> &'static [(OutputField, &'static str, Content)] {
        use Content::{Code, Number};
        use Dimension::{Current, Force};
        match self {
            Self::ForceEstimate => &[
                (OutputField::Force, "force", Number(Force)),
                (OutputField::StdDev, "std_dev", Number(Force)),
                (OutputField::BandLow, "band_low", Number(Force)),
                (OutputField::BandHigh, "band_high", Number(Force)),
                (OutputField::Validity, "validity", Code(4)),
                (OutputField::Mode, "mode", Code(4)),
                (OutputField::Reasons, "reasons", Code(u32::MAX as u64)),
            ],
            Self::CurrentCommand => &[
                (OutputField::Current, "current", Number(Current)),
                (OutputField::ForceRequested, "force_requested", Number(Force)),
                (OutputField::ForceExpected, "force_expected", Number(Force)),
                (OutputField::LimitedBy, "limited_by", Code(6)),
                (OutputField::Achievable, "achievable", Code(1)),
            ],
        }
    }
}

/// An output as the user names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputMapping {
    /// The topic.
    pub topic: OutputTopic,
    text: String,
    message: String,
    /// Each field with its signal.
    fields: Vec<(OutputField, String)>,
    names: ProtectionNames,
}

impl FromStr for OutputMapping {
    type Err = BusError;

    fn from_str(text: &str) -> Result<Self, BusError> {
        let form = || BusError::Form { text: text.to_owned(), what: "an output", form: FORM };
        let (topic, rest) = text.split_once('=').ok_or_else(form)?;
        let topic = OutputTopic::ALL.into_iter().find(|known| known.name() == topic.trim());
        let topic = topic.ok_or_else(form)?;
        let mut parts = rest.split(',').map(str::trim);
        let message = parts.next().filter(|message| !message.is_empty() && !message.contains('='));
        let message = message.ok_or_else(form)?.to_owned();
        let (mut fields, mut names) = (Vec::new(), ProtectionNames::default());
        for part in parts {
            let (name, value) = part.split_once('=').ok_or_else(form)?;
            let (name, value) = (name.trim(), value.trim());
            if names.take(text, name, value)? {
                continue;
            }
            let Some((field, ..)) = topic.fields().iter().find(|(_, known, _)| *known == name) else {
                let known: Vec<&str> = topic.fields().iter().map(|(_, name, _)| *name).collect();
                return Err(BusError::Field {
                    text: text.to_owned(),
                    topic: topic.name(),
                    field: name.to_owned(),
                    fields: known.join(", "),
                });
            };
            if fields.iter().any(|(known, _)| known == field) {
                return Err(BusError::Twice { text: text.to_owned(), name: name.to_owned() });
            }
            fields.push((*field, value.to_owned()));
        }
        let (main, name, _) = topic.fields()[0];
        if !fields.iter().any(|(field, _)| *field == main) {
            return Err(BusError::Needs { text: text.to_owned(), field: name });
        }
        Ok(Self { topic, text: text.to_owned(), message, fields, names })
    }
}

impl std::fmt::Display for OutputMapping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

/// The conversion from SI units to the unit of a signal: `si * scale + shift`, as the unit's inverse.
#[derive(Debug, Clone, Copy)]
struct FromSi {
    one: f64,
    zero: f64,
}

impl FromSi {
    fn of(unit: Unit) -> Self {
        let zero = (unit.to_si)(0.0);
        Self { one: (unit.to_si)(1.0) - zero, zero }
    }

    fn apply(self, si: f64) -> f64 {
        (si - self.zero) / self.one
    }
}

#[derive(Debug, Clone)]
struct FieldSignal {
    field: OutputField,
    signal: Signal,
    /// `None` for a code.
    from_si: Option<FromSi>,
}

/// A message that carries an output.
#[derive(Debug, Clone)]
pub struct OutputMessage {
    id: CanId,
    name: String,
    topic: OutputTopic,
    fields: Vec<FieldSignal>,
    protection: Protection,
    data: [u8; MOST_BYTES],
    bytes: usize,
}

impl OutputMessage {
    /// The message that `mapping` names in `database`.
    ///
    /// # Errors
    /// When message or signals are not in the database, or cannot carry what the mapping says.
    pub(super) fn new(database: &Database, mapping: &OutputMapping) -> Result<Self, BusError> {
        let text = &mapping.text;
        let message = database.message(text, &mapping.message)?;
        let is_length = |bytes: &usize| (1..16).any(|code| bytes_of_code(code) == *bytes);
        let bytes = usize::try_from(message.bytes).ok().filter(is_length).ok_or_else(|| {
            BusError::Length { text: text.clone(), message: message.name.clone(), bytes: message.bytes }
        })?;
        let fields = mapping.fields.iter().map(|(field, name)| {
            let content = mapping.topic.fields().iter().find(|(known, ..)| known == field);
            FieldSignal::new(text, message, *field, content.map_or(Content::Code(0), |(.., it)| *it), name)
        });
        let fields = fields.collect::<Result<Vec<_>, _>>()?;
        let protection = Protection::new(text, message, &mapping.names)?;
        let output = Self {
            id: message.id,
            name: message.name.clone(),
            topic: mapping.topic,
            fields,
            protection,
            data: [0; MOST_BYTES],
            bytes,
        };
        output.check_overlaps(text)?;
        Ok(output)
    }

    /// Refuses signals that share bits.
    fn check_overlaps(&self, text: &str) -> Result<(), BusError> {
        let (counter, checksum) = self.protection.places();
        let mask_of = |signal: &Signal| {
            let mut mask = [0_u8; MOST_BYTES];
            signal.put(u64::MAX, &mut mask);
            (signal.name.clone(), mask)
        };
        let mut masks: Vec<(String, [u8; MOST_BYTES])> =
            self.fields.iter().map(|field| &field.signal).chain(counter).map(mask_of).collect();
        if let Some(place) = checksum {
            let mut mask = [0_u8; MOST_BYTES];
            mask[place] = 0xff;
            masks.push(("the checksum".to_owned(), mask));
        }
        for (index, (second, mask)) in masks.iter().enumerate() {
            let shares = |other: &[u8; MOST_BYTES]| mask.iter().zip(other).any(|(one, two)| one & two != 0);
            if let Some((first, _)) = masks[..index].iter().find(|(_, other)| shares(other)) {
                let (first, second) = (first.clone(), second.clone());
                return Err(BusError::Overlap { text: text.to_owned(), first, second });
            }
        }
        Ok(())
    }

    /// The identifier of the message.
    #[must_use]
    pub const fn id(&self) -> CanId {
        self.id
    }

    /// The name of the message.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The topic that it carries.
    #[must_use]
    pub const fn topic(&self) -> OutputTopic {
        self.topic
    }

    /// True if a signal carries the field.
    #[must_use]
    pub fn has(&self, field: OutputField) -> bool {
        self.fields.iter().any(|it| it.field == field)
    }

    /// True if the field's signal can carry the number, in SI units; also if no signal carries the field.
    #[must_use]
    pub fn can_carry(&self, field: OutputField, number: f64) -> bool {
        let signals = self.fields.iter().filter(|it| it.field == field);
        signals.filter_map(FieldSignal::number_bits(number)).all(|bits| bits.is_some())
    }

    /// The data of the next frame, with `value` of each field. The alive counter goes one further.
    pub fn encode(&mut self, value: impl Fn(OutputField) -> FieldValue) -> &[u8] {
        let data = &mut self.data[..self.bytes];
        data.fill(0);
        for it in &self.fields {
            let bits = match (value(it.field), it.from_si) {
                (FieldValue::Code(code), None) => code.min(it.signal.all_ones()),
                (FieldValue::Number(si), Some(from_si)) => {
                    it.signal.encoded(from_si.apply(si)).unwrap_or(it.signal.not_available())
                }
                _ => it.signal.not_available(),
            };
            it.signal.put(bits, data);
        }
        self.protection.protect(data);
        data
    }
}

impl FieldSignal {
    fn new(
        text: &str,
        message: &Message,
        field: OutputField,
        content: Content,
        name: &str,
    ) -> Result<Self, BusError> {
        let signal = signal_of(text, message, name)?;
        let unfit = |needs: String| BusError::Unfit {
            text: text.to_owned(),
            signal: format!("{}.{}", message.name, signal.name),
            needs,
        };
        if signal.presence != Presence::Always {
            return Err(unfit("multiplexed signals are not sent".to_owned()));
        }
        let from_si = match content {
            Content::Code(most) => {
                if !is_plain(signal) || signal.all_ones() < most {
                    let bits = u64::BITS - most.leading_zeros();
                    return Err(unfit(format!(
                        "a code from 0 to {most} needs {bits} unsigned bits, factor 1 and offset 0"
                    )));
                }
                None
            }
            Content::Number(dimension) => {
                if signal.factor.value == 0.0 {
                    return Err(unfit("its factor is 0".to_owned()));
                }
                if signal.kind == super::signal::Kind::Float && signal.length == 16 {
                    return Err(unfit("floats of 16 bits are not sent".to_owned()));
                }
                let unit = Unit::named(dimension, &signal.unit).ok_or_else(|| {
                    let fitting: Vec<&str> = unit::of(dimension).iter().map(|unit| unit.name).collect();
                    unfit(format!(
                        "its unit is `{}`, but must be one of {}; correct the DBC file",
                        signal.unit,
                        fitting.join(", ")
                    ))
                })?;
                Some(FromSi::of(unit))
            }
        };
        Ok(Self { field, signal: signal.clone(), from_si })
    }

    /// The bits for a number in SI units; the outer `None` for a code.
    fn number_bits(number: f64) -> impl Fn(&Self) -> Option<Option<u64>> {
        move |it| Some(it.signal.encoded(it.from_si?.apply(number)))
    }
}

impl Database {
    /// The message called `name`.
    ///
    /// # Errors
    /// When there is none, or its identifier belongs to another one, too.
    pub(super) fn message(&self, text: &str, name: &str) -> Result<&Message, BusError> {
        let found = self.messages.iter().find(|message| message.name == name);
        let message = found.ok_or_else(|| BusError::NoMessage {
            text: text.to_owned(),
            message: name.to_owned(),
            nearest: suggest::nearest(name, self.messages.iter().map(|it| &*it.name)).map(str::to_owned),
        })?;
        let twice = |why| BusError::Map { text: text.to_owned(), why: Box::new(why) };
        self.check_identifier(message).map_err(twice)?;
        Ok(message)
    }
}
