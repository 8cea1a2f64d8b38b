//! Inputs of a running node from the messages of a bus.
//!
//! A map names the signal of each channel, as for logs (`displacement=SUSP_FL.Position`), and the value of a frame is the one that a log
//! of this frame gives. A check names alive counter and checksum of a message: `SUSP_FL,counter=Alive,checksum=Crc,data_id=291`. The
//! frames of a checked message that do not pass give no value.

use super::dbc::Database;
use super::error::BusError;
use super::frame::CanId;
use super::j1939::{FrameFilter, Sender, Senders, Use};
use super::protection::{Failed, Protection, ProtectionNames};
use super::signal::{Decoded, decode};
use crate::error::MapFault;
use crate::map::{Channel, Convert, Map};
use crate::names::topic_of;
use crate::suggest;
use crate::unit::{self, Unit};
use std::str::FromStr;

/// The form of a check.
const FORM: &str = "MESSAGE,counter=SIGNAL,checksum=SIGNAL[,data_id=NUMBER]";

/// Alive counter and checksum of a message that is read: `SUSP_FL,counter=Alive,checksum=Crc,data_id=291`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputCheck {
    text: String,
    message: String,
    names: ProtectionNames,
}

impl FromStr for InputCheck {
    type Err = BusError;

    fn from_str(text: &str) -> Result<Self, BusError> {
        let form = || BusError::Form { text: text.to_owned(), what: "a check of a message", form: FORM };
        let mut parts = text.split(',').map(str::trim);
        let message = parts.next().filter(|message| !message.is_empty() && !message.contains('='));
        let message = message.ok_or_else(form)?.to_owned();
        let mut names = ProtectionNames::default();
        for part in parts {
            let (name, value) = part.split_once('=').ok_or_else(form)?;
            if !names.take(text, name.trim(), value.trim())? {
                return Err(form());
            }
        }
        if names.counter.is_none() && names.checksum.is_none() {
            return Err(form());
        }
        Ok(Self { text: text.to_owned(), message, names })
    }
}

/// A value of an input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputValue {
    /// The channel, by the name of its topic: `displacement`.
    pub channel: &'static str,
    /// The value in SI units (temperatures: °C), with sign and offset of the map.
    pub value: f64,
}

/// Counts of a frame that was used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameReport {
    /// Values of inputs.
    pub values: u64,
    /// Signals for which the frame is too short.
    pub short: u64,
    /// Values that the DBC file does not allow.
    pub out_of_range: u64,
    /// Frames of a checked message that are missing before this one.
    pub missing: u64,
    /// Messages of J1939 that several senders send, none of which the DBC file or the map names. They gave no value.
    pub several_senders: u64,
}

/// Why a frame gave no value at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// No input is in a message with this identifier.
    Other,
    /// The frame of a checked message is too short.
    Short,
    /// The checksum is wrong.
    Checksum,
    /// The alive counter repeats its last value, or has one that it cannot have.
    Counter,
    /// Several senders send the J1939 message, and neither the map nor the DBC file names one of them.
    SeveralSenders,
}

struct InputSignal {
    channel: &'static str,
    signal: usize,
    convert: Convert,
}

struct InputMessage {
    /// The message in the database.
    message: usize,
    /// Its identifier, with the addresses that the map names.
    id: CanId,
    /// The frames that may be its own.
    filter: FrameFilter,
    /// The sender that the map names.
    sender: Option<Sender>,
    /// The senders so far, for a message of J1939 without a name of its sender.
    senders: Senders,
    signals: Vec<InputSignal>,
    protection: Option<Protection>,
}

/// The messages of a bus that hold inputs.
pub struct Inputs {
    database: Database,
    messages: Vec<InputMessage>,
}

impl Inputs {
    /// The inputs that `map` names in the messages of `database`, of the channels `known`.
    ///
    /// # Errors
    /// When a mapping does not fit the database.
    pub(super) fn new(database: Database, map: &Map, known: &[&'static str]) -> Result<Self, BusError> {
        let mut inputs = Self { database, messages: Vec::new() };
        for mapping in map.all() {
            inputs.add(mapping, known)?;
        }
        Ok(inputs)
    }

    fn add(&mut self, mapping: &crate::Mapping, known: &[&'static str]) -> Result<(), BusError> {
        let text = mapping.to_string();
        let fault = |why| BusError::Map { text: text.clone(), why: Box::new(why) };
        let Channel::Known(quantity, unit) = mapping.channel else { return Err(fault(MapFault::TimeOfLog)) };
        let channel = topic_of(quantity);
        if !known.contains(&channel) {
            return Err(BusError::NoInput { text, channel, inputs: known.join(", ") });
        }
        if let Some((topic, _)) = mapping.topic() {
            return Err(fault(MapFault::TopicOfLog { topic: topic.to_owned() }));
        }
        let Some((message, signal, sender)) = self.database.find_sent(&mapping.source).map_err(fault)? else {
            let nearest = self.nearest(&mapping.source);
            return Err(BusError::Unknown { text, nearest });
        };
        let of = &self.database.messages[message];
        let dimension = quantity.dimension();
        let named = &of.signals[signal].unit;
        let unit = unit.or_else(|| Unit::named(dimension, named)).ok_or_else(|| {
            let fitting: Vec<&str> = unit::of(dimension).iter().map(|unit| unit.name).collect();
            let (signal, unit) = (mapping.source.clone(), named.clone());
            fault(MapFault::SignalUnit { signal, unit, channel, fitting: fitting.join(", ") })
        })?;
        let input = InputSignal { channel, signal, convert: mapping.convert(unit.to_si) };
        let is_it = |known: &&mut InputMessage| known.message == message && known.sender == sender;
        match self.messages.iter_mut().find(is_it) {
            Some(known) => known.signals.push(input),
            None => self.messages.push(InputMessage {
                message,
                id: sender.map_or(of.id, |sender| sender.applied(of.id)),
                filter: FrameFilter::new(of.id, of.is_j1939, sender),
                sender,
                senders: Senders::Unknown,
                signals: vec![input],
                protection: None,
            }),
        }
        Ok(())
    }

    /// The signal with the most similar name; only signals count if `name` names no message.
    fn nearest(&self, name: &str) -> Option<String> {
        let names_message = name.contains('.');
        let all = self.database.messages.iter().flat_map(|of| of.signals.iter().map(move |it| (of, it)));
        let named = all.map(|(of, it)| {
            let whole = format!("{}.{}", of.name, it.name);
            (if names_message { whole.clone() } else { it.name.clone() }, whole)
        });
        let named: Vec<(String, String)> = named.collect();
        let nearest = suggest::nearest(name, named.iter().map(|(compared, _)| &**compared))?;
        named.iter().find(|(compared, _)| compared == nearest).map(|(_, whole)| whole.clone())
    }

    /// Uses only frames that pass `check`, of the message that it names.
    ///
    /// # Errors
    /// When the check does not fit the message, or the message holds no input or has a check already. The inputs are then unchanged.
    pub fn check(&mut self, check: &InputCheck) -> Result<(), BusError> {
        let of = self.database.message(&check.text, &check.message)?;
        let name = of.name.clone();
        let protection = Protection::new(&check.text, of, &check.names)?;
        let (id, text) = (of.id, check.text.clone());
        let is_it = |known: &InputMessage| self.database.messages[known.message].id == id;
        // One for each sender of a message of J1939.
        let mut checked = false;
        for known in self.messages.iter_mut().filter(|known| is_it(known)) {
            if known.protection.is_some() {
                return Err(BusError::Twice { text, name });
            }
            known.protection = Some(protection.clone());
            checked = true;
        }
        if checked { Ok(()) } else { Err(BusError::Unused { text, message: name }) }
    }

    /// Identifiers of the messages that hold inputs.
    #[must_use]
    pub fn ids(&self) -> Vec<CanId> {
        self.messages.iter().map(|message| message.id).collect()
    }

    /// The frames that may hold inputs; others give no value.
    #[must_use]
    pub fn filters(&self) -> Vec<FrameFilter> {
        self.messages.iter().map(|message| message.filter).collect()
    }

    /// The message of a frame with this identifier, by its name, for messages to the user; `None` if it holds no input.
    #[must_use]
    pub fn message(&self, id: CanId) -> Option<&str> {
        Some(&self.database.messages[self.of_frame(id)?.message].name)
    }

    /// The identifier of the message of a frame, which is one of [`ids`](Self::ids). Frames of J1939 may have others.
    #[must_use]
    pub fn message_id(&self, id: CanId) -> Option<CanId> {
        self.of_frame(id).map(|message| message.id)
    }

    fn of_frame(&self, id: CanId) -> Option<&InputMessage> {
        self.messages.iter().find(|message| message.is_of(id, &self.database))
    }

    /// Passes the values of a frame to `on`.
    ///
    /// # Errors
    /// When the frame gives no value at all. It is then as if it had not arrived, except for the counter of its message.
    pub fn take(
        &mut self,
        id: CanId,
        data: &[u8],
        mut on: impl FnMut(InputValue),
    ) -> Result<FrameReport, Refusal> {
        let database = &self.database;
        let mut all: Result<FrameReport, Refusal> = Err(Refusal::Other);
        // Several if a map names the sender of one signal of a J1939 message and not of another.
        for message in self.messages.iter_mut().filter(|message| message.is_of(id, database)) {
            let taken = message.take(id, data, database, &mut on);
            all = match (all, taken) {
                (Ok(report), taken) => Ok(report.with(taken)),
                (Err(before), Ok(report)) => Ok(report.with(Err(before))),
                (Err(Refusal::Other), Err(why)) | (Err(why), Err(_)) => Err(why),
            };
        }
        all
    }
}

impl FrameReport {
    /// The counts of both.
    fn with(self, other: Result<Self, Refusal>) -> Self {
        let other = other.unwrap_or_else(|why| Self {
            several_senders: u64::from(why == Refusal::SeveralSenders),
            ..Self::default()
        });
        Self {
            values: self.values + other.values,
            short: self.short + other.short,
            out_of_range: self.out_of_range + other.out_of_range,
            missing: self.missing + other.missing,
            several_senders: self.several_senders + other.several_senders,
        }
    }
}

impl InputMessage {
    /// True if a frame with this identifier carries the message. As for logs: see [`Database::message_of`].
    fn is_of(&self, id: CanId, database: &Database) -> bool {
        self.filter.passes(id)
            && (!database.messages[self.message].is_j1939 || database.message_of(id) == Some(self.message))
    }

    fn take(
        &mut self,
        id: CanId,
        data: &[u8],
        database: &Database,
        on: &mut impl FnMut(InputValue),
    ) -> Result<FrameReport, Refusal> {
        let of = &database.messages[self.message];
        if of.is_j1939 && Sender::is_open(self.sender, id) {
            match self.senders.take(Sender::of(id), Sender::of(of.id)) {
                Use::Take => {}
                Use::Pass => return Err(Refusal::Other),
                Use::Refuse => return Err(Refusal::SeveralSenders),
            }
        }
        let mut report = FrameReport::default();
        if let Some(protection) = &mut self.protection {
            report.missing = protection.check(data).map_err(Refusal::from)?.missing;
        }
        let signals = &of.signals;
        for input in &self.signals {
            match decode(signals, input.signal, data) {
                Decoded::Value(raw) if !signals[input.signal].is_in_range(raw) => report.out_of_range += 1,
                Decoded::Value(raw) => {
                    report.values += 1;
                    on(InputValue { channel: input.channel, value: input.convert.apply(raw) });
                }
                Decoded::Absent => {}
                Decoded::Short => report.short += 1,
            }
        }
        Ok(report)
    }
}

impl From<Failed> for Refusal {
    fn from(failed: Failed) -> Self {
        match failed {
            Failed::Short => Self::Short,
            Failed::Checksum => Self::Checksum,
            Failed::Repeated | Failed::Counter => Self::Counter,
        }
    }
}
