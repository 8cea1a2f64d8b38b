//! The channels of a run that a log of CAN frames gives: one signal each, as the map says.

use super::dbc::{Database, Message};
use super::frame::{BusFrame, CanId, FrameSink, Unusable};
use super::j1939::{Sender, listed};
use super::lookup::{check_signal, shown_id};
use super::places::{Place, SeenBuses, is_bus};
use super::series::{Counts, Series};
use super::signal::{Decoded, decode};
use crate::column::Quantity;
use crate::csv::settle_drive;
use crate::error::MapFault;
use crate::map::{Channel, Convert, Mapping};
use crate::names::topic_of;
use crate::suggest::{self, FoundSignal};
use crate::unit::{self, Unit};
use crate::{LoadOptions, Note, RunError};
use mr_damper_base::shown::count;
use mr_damper_model::sample::{Run, Trace};
use std::collections::BTreeMap;
use std::path::Path;

/// Number of identifiers that a message lists.
const LISTED_IDS: usize = 8;

/// Where a channel comes from.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Source {
    /// A signal in the frames of a message: indices in the database, and bus and J1939 sender if the map names them. The sender is set when
    /// the log was read, if the map names none.
    Signal { message: usize, signal: usize, bus: Option<String>, sender: Option<Sender> },
    /// A channel of an MDF4 file, which the reader of the format knows by this number.
    Plain(usize),
}

/// The frames of one identifier.
#[derive(Debug, Default)]
struct Seen {
    frames: u64,
    buses: SeenBuses,
    /// The channels that they give.
    series: Vec<usize>,
    /// The message, if the database has it.
    message: Option<usize>,
}

/// A mapping whose source is not known. The error needs the list of what the log holds.
struct Unresolved {
    map: String,
    quantity: Quantity,
    source: String,
}

/// The channels of a run while a log is read.
pub(super) struct Channels<'a> {
    options: &'a LoadOptions,
    database: &'a Database,
    pub(super) series: Vec<Series>,
    unresolved: Vec<Unresolved>,
    seen: BTreeMap<CanId, Seen>,
    unusable: BTreeMap<Unusable, u64>,
    /// The channels of an MDF4 file: name, unit, number of records.
    plain: Vec<FoundSignal>,
    /// Names of the sources of an MDF4 file's frames.
    pub(super) sources: Vec<String>,
    /// Where the next frame comes from.
    pub(super) place: Place,
}

impl<'a> Channels<'a> {
    /// The channels that the map of `options` names. `plain` are the channels of an MDF4 file; with a source that is a signal of the
    /// database, the signal has priority.
    ///
    /// # Errors
    /// When a mapping cannot apply to any log with this database.
    pub(super) fn new(
        path: &Path,
        options: &'a LoadOptions,
        database: &'a Database,
        plain: Vec<FoundSignal>,
    ) -> Result<Self, RunError> {
        let (seen, unusable) = (BTreeMap::new(), BTreeMap::new());
        let (sources, place) = (Vec::new(), Place::default());
        let (series, unresolved) = (Vec::new(), Vec::new());
        let mut channels =
            Self { options, database, series, unresolved, seen, unusable, plain, sources, place };
        let fail = |map: String, why| RunError::Map { path: path.to_owned(), map, why: Box::new(why) };
        for mapping in options.map.all() {
            channels.add(mapping).map_err(|why| fail(mapping.to_string(), why))?;
        }
        channels.add_by_name().map_err(|(map, why)| fail(map, why))?;
        Ok(channels)
    }

    fn add(&mut self, mapping: &Mapping) -> Result<(), MapFault> {
        let Channel::Known(quantity, unit) = mapping.channel else { return Err(MapFault::TimeOfLog) };
        let name = mapping.source.clone();
        if mapping.topic().is_some() {
            return Err(MapFault::TopicOfLog { topic: name });
        }
        let Some((source, known_unit)) = self.source(&name)? else {
            self.unresolved.push(Unresolved { map: mapping.to_string(), quantity, source: name });
            return Ok(());
        };
        let dimension = quantity.dimension();
        let unit = match unit.or_else(|| Unit::named(dimension, &known_unit)) {
            Some(unit) => unit,
            None => {
                let fitting: Vec<&str> = unit::of(dimension).iter().map(|unit| unit.name).collect();
                let (unit, channel) = (known_unit, topic_of(quantity));
                return Err(MapFault::SignalUnit {
                    signal: name,
                    unit,
                    channel,
                    fitting: fitting.join(", "),
                });
            }
        };
        self.push(quantity, name, source, mapping.convert(unit.to_si));
        Ok(())
    }

    /// Channels of an MDF4 file that have names of the run format are read without a map, as columns of a CSV file are. The error is that of
    /// a map with this name.
    fn add_by_name(&mut self) -> Result<(), (String, MapFault)> {
        for index in 0..self.plain.len() {
            let crate::column::Column::Known(quantity, to_si) =
                crate::column::Column::of_header(&self.plain[index].source)
            else {
                continue;
            };
            let is_taken = self.options.map.of(quantity).is_some()
                || self.series.iter().any(|it| it.quantity == quantity);
            if is_taken {
                continue;
            }
            let FoundSignal { source: name, unit, .. } = self.plain[index].clone();
            // Units may differ in a factor and an offset.
            let differs = |unit: &Unit| [1.0, 10.0].iter().any(|value| (unit.to_si)(*value) != to_si(*value));
            if Unit::named(quantity.dimension(), &unit).is_some_and(|unit| differs(&unit)) {
                let map = format!("{}={name}", topic_of(quantity));
                return Err((map.clone(), MapFault::UnitOfName { channel: name, unit, map }));
            }
            self.push(quantity, name, Source::Plain(index), Convert::plain(to_si));
        }
        Ok(())
    }

    fn push(&mut self, quantity: Quantity, name: String, source: Source, convert: Convert) {
        self.series.push(Series::new(quantity, name, source, convert));
    }

    /// The source that `name` means, and its unit; `None` if nothing has this name.
    fn source(&self, name: &str) -> Result<Option<(Source, String)>, MapFault> {
        if let Some(found) = self.signal(name, None)? {
            return Ok(Some(found));
        }
        if let Some((signal, bus)) = name.rsplit_once(':')
            && let Some(found) = self.signal(signal, Some(bus))?
        {
            return Ok(Some(found));
        }
        let same: Vec<usize> = self
            .plain
            .iter()
            .enumerate()
            .filter(|(_, found)| found.source == name)
            .map(|(index, _)| index)
            .collect();
        match same.as_slice() {
            [] => {}
            [only] => return Ok(Some((Source::Plain(*only), self.plain[*only].unit.clone()))),
            several => {
                let groups: Vec<String> =
                    several.iter().map(|index| format!("{name}:{}", self.plain[*index].group)).collect();
                return Err(MapFault::SignalTwice { signal: name.to_owned(), places: groups.join(", ") });
            }
        }
        if let Some(found) = self.sent_signal(name)? {
            return Ok(Some(found));
        }
        let of_group =
            name.rsplit_once(':').and_then(|(name, group)| Some((name, group.parse::<usize>().ok()?)));
        let is_it = |found: &FoundSignal| Some((&*found.source, found.group)) == of_group;
        let found = self.plain.iter().position(is_it);
        Ok(found.map(|index| (Source::Plain(index), self.plain[index].unit.clone())))
    }

    /// The signal that `name` means, and its unit; `None` if the database has none.
    fn signal(&self, name: &str, bus: Option<&str>) -> Result<Option<(Source, String)>, MapFault> {
        let found = self.database.find(name)?;
        Ok(found.map(|(message, signal)| self.source_of(message, signal, bus, None)))
    }

    /// The same for a name with the sender of a J1939 message: `EEC1.Speed@0x21` or `EEC1.Speed@0x21:can0`.
    fn sent_signal(&self, name: &str) -> Result<Option<(Source, String)>, MapFault> {
        let (own, bus) = name.rsplit_once(':').map_or((name, None), |(own, bus)| (own, Some(bus)));
        let found = self.database.find_sent(own)?;
        Ok(found.map(|(message, signal, sender)| self.source_of(message, signal, bus, sender)))
    }

    fn source_of(
        &self,
        message: usize,
        signal: usize,
        bus: Option<&str>,
        sender: Option<Sender>,
    ) -> (Source, String) {
        let unit = self.database.messages[message].signals[signal].unit.clone();
        (Source::Signal { message, signal, bus: bus.map(str::to_owned), sender }, unit)
    }

    /// The messages that occur in the log, with the J1939 senders that the map must name, and their numbers of frames.
    fn found_messages(&self) -> Vec<(&Message, Option<Sender>, u64)> {
        let mut found: Vec<(&Message, Option<Sender>, u64)> = Vec::new();
        for (id, seen) in &self.seen {
            let Some(message) = seen.message.map(|message| &self.database.messages[message]) else {
                continue;
            };
            let sender = message.is_j1939.then(|| Sender::of(*id));
            match found.iter_mut().find(|it| std::ptr::eq(it.0, message) && it.1 == sender) {
                Some((.., frames)) => *frames += seen.frames,
                None => found.push((message, sender, seen.frames)),
            }
        }
        // The one of the DBC file, and the only one, are read without a name.
        let all = found.clone();
        for (message, sender, _) in &mut found {
            let is_only = all.iter().filter(|other| std::ptr::eq(other.0, *message)).count() == 1;
            if is_only || *sender == Some(Sender::of(message.id)) {
                *sender = None;
            }
        }
        found
    }

    /// The signals that occur in the log, and the channels of an MDF4 file.
    fn found(&self) -> Vec<FoundSignal> {
        let mut found = Vec::new();
        for (message, sender, frames) in self.found_messages() {
            let end = sender.map(|sender| format!("@{sender}")).unwrap_or_default();
            let signals = message.signals.iter().filter(|signal| check_signal(message, signal).is_ok());
            found.extend(signals.map(|signal| FoundSignal {
                source: format!("{}.{}{end}", message.name, signal.name),
                unit: signal.unit.clone(),
                frames,
                group: 0,
            }));
        }
        found.extend(self.plain.iter().filter(|found| found.frames > 0).cloned());
        found
    }

    /// A list of the signals in the log for the channel, or what the log holds in their place.
    fn listing(&self, quantity: Quantity) -> String {
        let found = self.found();
        if !found.is_empty() {
            return suggest::signal_listing(quantity, &found);
        }
        let ids: Vec<String> =
            self.seen.iter().filter(|(_, seen)| seen.frames > 0).map(|(id, _)| id.to_string()).collect();
        if ids.is_empty() {
            let unusable = self.unusable.iter().map(|(what, frames)| {
                format!("{} with {}", count(*frames as usize, "frame"), what.in_words())
            });
            let unusable = unusable.collect::<Vec<_>>().join(", ");
            return match unusable.as_str() {
                "" => "the log has no data frame".to_owned(),
                only => format!("the log has only {only}"),
            };
        }
        let shown = ids.iter().take(LISTED_IDS).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = if ids.len() > LISTED_IDS { ", ..." } else { "" };
        let number = count(ids.len(), "identifier");
        format!(
            "the DBC file describes none of the {number} in the log ({shown}{more}): give the DBC file of this bus"
        )
    }

    /// The run, after the log was read.
    pub(super) fn into_run(mut self, path: &Path, notes: &mut Vec<Note>) -> Result<Run, RunError> {
        let fail = |map: String, why| RunError::Map { path: path.to_owned(), map, why: Box::new(why) };
        if let Some(Unresolved { map, quantity, source }) = self.unresolved.first() {
            let found = self.found();
            let nearest =
                suggest::nearest(source, found.iter().map(|found| &*found.source)).map(str::to_owned);
            let (signal, signals) = (source.clone(), self.listing(*quantity));
            return Err(fail(map.clone(), MapFault::NoSignal { signal, nearest, signals }));
        }
        let database = self.database;
        for series in &mut self.series {
            if let Source::Signal { message, .. } = series.source {
                let chosen = series.choose_sender(Sender::of(database.messages[message].id));
                let map = || format!("{}={}", topic_of(series.quantity), series.name);
                notes.extend(chosen.map_err(|why| fail(map(), why))?);
            }
            if series.samples.unnamed_groups() > 1 {
                let (signal, groups) = (series.name.clone(), series.samples.unnamed_groups());
                notes.push(Note::BusesUnnamed { signal, groups });
            }
            series.samples.merge();
        }
        for series in &self.series {
            self.check(series)
                .map_err(|why| fail(format!("{}={}", topic_of(series.quantity), series.name), why))?;
        }
        let has = |wanted: Quantity| self.series.iter().any(|series| series.quantity == wanted);
        if !has(Quantity::Displacement) {
            let found = self.found();
            let line = suggest::signal_line_for(Quantity::Displacement, &found);
            let line =
                line.map(|line| format!("say which signal it is, for example {line}; ")).unwrap_or_default();
            let hint = format!("{line}{}", self.listing(Quantity::Displacement));
            return Err(RunError::NoDisplacement { path: path.to_owned(), hint });
        }
        notes.extend(self.could_serve());
        for (what, frames) in &self.unusable {
            let (path, what) = (path.to_owned(), what.in_words());
            notes.push(Note::FramesDropped { path, count: *frames, what });
        }
        let mut run = Run { name: path.display().to_string(), ..Run::default() };
        let mut drives: [Option<(String, Trace)>; 2] = [None, None];
        for series in self.series {
            series.notes(notes);
            let Series { quantity, name, samples, .. } = series;
            let trace = samples.into_trace();
            match quantity {
                Quantity::Displacement => run.displacement_m = trace,
                Quantity::Velocity => run.velocity_m_s = Some(trace),
                Quantity::Force => run.force_n = Some(trace),
                Quantity::Current => drives[0] = Some((name, trace)),
                Quantity::Command => drives[1] = Some((name, trace)),
                Quantity::CaseTemperature => run.case_temp_c = Some(trace),
                Quantity::BodyVelocity => run.body_velocity_m_s = Some(trace),
                Quantity::ForceRequest => run.force_request_n = Some(trace),
                Quantity::AmbientTemperature | Quantity::Setpoint => {
                    run.other.push((quantity.si_name().to_owned(), trace));
                }
            }
        }
        settle_drive(path, drives, self.options, &mut run)?;
        Ok(run)
    }

    /// Refuses a channel without samples, and one from several buses.
    fn check(&self, series: &Series) -> Result<(), MapFault> {
        let signal = series.name.clone();
        if let Source::Signal { message, bus, sender, .. } = &series.source {
            let buses =
                self.buses(*message, *sender).named(bus.as_deref(), &self.sources).names(&self.sources);
            if buses.len() > 1 {
                let named = bus.as_ref().and_then(|bus| signal.strip_suffix(&format!(":{bus}")));
                let signal = named.map(str::to_owned).unwrap_or(signal);
                return Err(MapFault::SeveralBuses { signal, buses });
            }
        }
        let Counts { frames, absent, short, not_increasing, out_of_range, timeless, .. } =
            series.samples.counts;
        if let Some(trace) = series.samples.trace()
            && let Some(last) = trace.stamps.last()
        {
            let kept = trace.len() as u64;
            if not_increasing <= kept {
                return Ok(());
            }
            let last_s = last.nanos() as f64 / 1e9;
            return Err(MapFault::TimesJump { signal, dropped: not_increasing, kept, last_s });
        }
        let signals = self.listing(series.quantity);
        match &series.source {
            Source::Signal { message, bus, sender, .. } if frames == 0 => {
                let seen = self.buses(*message, *sender).names(&self.sources);
                let senders = self.senders(*message);
                let of = &self.database.messages[*message];
                let (message, id) = (of.name.clone(), shown_id(of));
                match bus {
                    Some(bus) if !seen.is_empty() => {
                        Err(MapFault::NoBus { message, bus: bus.clone(), buses: seen })
                    }
                    _ => match sender {
                        Some(sender) if !senders.is_empty() => {
                            let (address, found) = (sender.to_string(), senders);
                            Err(MapFault::NoSender { message, id, address, found })
                        }
                        _ => Err(MapFault::NoFrame { message, id, signals }),
                    },
                }
            }
            _ => {
                let parts = [
                    (absent, "hold other signals by their multiplexer"),
                    (short, "are too short"),
                    (out_of_range, "have a value outside of its range in the DBC file"),
                    (timeless, "have no usable time"),
                ];
                let parts = parts.iter().filter(|(count, _)| *count > 0);
                let parts: Vec<String> = parts.map(|(count, what)| format!("; {count} {what}")).collect();
                Err(MapFault::NoSignalValue { signal, frames, parts: parts.concat() })
            }
        }
    }

    /// The buses that frames of a message were on, from a sender if one is given.
    fn buses(&self, message: usize, sender: Option<Sender>) -> SeenBuses {
        let mut buses = SeenBuses::default();
        let is_from = |id: CanId| sender.is_none_or(|sender| sender.includes(Sender::of(id)));
        for (_, seen) in self.seen.iter().filter(|(id, seen)| seen.message == Some(message) && is_from(**id))
        {
            buses.add_all(&seen.buses);
        }
        buses
    }

    /// The addresses that frames of a J1939 message came from.
    fn senders(&self, message: usize) -> Vec<String> {
        let ids = self.seen.iter().filter(|(_, seen)| seen.message == Some(message)).map(|(id, _)| *id);
        listed(&ids.map(Sender::of).collect())
    }

    /// A note with signals that may hold the force or the drive, if these are missing.
    fn could_serve(&self) -> Option<Note> {
        let has = |wanted: Quantity| self.series.iter().any(|series| series.quantity == wanted);
        let found = self.found();
        let mut lines = Vec::new();
        if !has(Quantity::Force) {
            lines.extend(suggest::likely_signal_line_for(Quantity::Force, &found));
        }
        if !has(Quantity::Current) && !has(Quantity::Command) {
            lines.extend(suggest::likely_signal_line_for(Quantity::Current, &found));
        }
        (!lines.is_empty()).then_some(Note::CouldServe { lines })
    }
}

impl FrameSink for Channels<'_> {
    fn frame(&mut self, frame: &BusFrame<'_>) {
        let (database, place) = (self.database, self.place);
        let seen = self.seen.entry(frame.id).or_default();
        let from = Sender::of(frame.id);
        if seen.frames == 0 {
            seen.message = database.message_of(frame.id);
            let is_of = |series: &Series| match &series.source {
                Source::Signal { message, sender, .. } => {
                    seen.message == Some(*message) && sender.is_none_or(|sender| sender.includes(from))
                }
                Source::Plain(_) => false,
            };
            let of_message = self.series.iter().enumerate().filter(|(_, series)| is_of(series));
            seen.series = of_message.map(|(index, _)| index).collect();
        }
        seen.frames += 1;
        seen.buses.add(frame.bus, place.origin);
        let origin = place.origin.and_then(|origin| self.sources.get(origin)).map(String::as_str);
        for &index in &seen.series {
            let series = &mut self.series[index];
            let Source::Signal { message, signal, bus, sender } = &series.source else { continue };
            if bus.as_ref().is_some_and(|bus| !is_bus(bus, frame.bus, origin)) {
                continue;
            }
            let signals = &database.messages[*message].signals;
            let decoded = decode(signals, *signal, frame.data);
            // As from a bus: see `input.rs`.
            let is_allowed = |value| signals[*signal].is_in_range(value);
            let samples = if database.messages[*message].is_j1939 && Sender::is_open(*sender, frame.id) {
                series.by_sender.entry(from).or_default()
            } else {
                &mut series.samples
            };
            samples.counts.frames += 1;
            match decoded {
                Decoded::Value(value) if !is_allowed(value) => samples.counts.out_of_range += 1,
                Decoded::Value(value) => samples.push(place, frame.nanos, series.convert.apply(value)),
                Decoded::Absent => samples.counts.absent += 1,
                Decoded::Short => samples.counts.short += 1,
            }
        }
    }

    fn unusable(&mut self, what: Unusable) {
        *self.unusable.entry(what).or_default() += 1;
    }
}
