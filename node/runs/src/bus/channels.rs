//! The channels of a run that a log of CAN frames gives: one signal each, as the map says.

use super::dbc::Database;
use super::frame::{BusFrame, CanId, FrameSink, Unusable};
use super::lookup::check_signal;
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
use mr_damper_model::sample::{Run, Stamp, Trace};
use std::collections::BTreeMap;
use std::path::Path;

/// Number of identifiers that a message lists.
const LISTED_IDS: usize = 8;

/// Where a channel comes from.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Source {
    /// A signal in the frames of a message: indices in the database, and the bus if the map names one.
    Signal { message: usize, signal: usize, bus: Option<String> },
    /// A channel of an MDF4 file, which the reader of the format knows by this number.
    Plain(usize),
}

/// One channel while it is read.
pub(super) struct Series {
    quantity: Quantity,
    /// Its name in messages, as in the map.
    pub(super) name: String,
    pub(super) source: Source,
    convert: Convert,
    trace: Trace,
    counts: Counts,
}

/// What became of the frames or records of a channel.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    /// Frames of its message, or records of its channel.
    frames: u64,
    /// Whose multiplexer selects other signals.
    absent: u64,
    short: u64,
    not_finite: u64,
    not_increasing: u64,
    /// With a value that the DBC file does not allow.
    out_of_range: u64,
    /// Without a usable time.
    timeless: u64,
}

impl Series {
    /// Takes a value in the unit of the source.
    pub(super) fn push(&mut self, nanos: i64, raw: f64) {
        let (stamp, value) = (Stamp::from_nanos(nanos), self.convert.apply(raw));
        if !value.is_finite() {
            self.counts.not_finite += 1;
        } else if self.trace.stamps.last().is_some_and(|&last| stamp <= last) {
            self.counts.not_increasing += 1;
        } else {
            self.trace.stamps.push(stamp);
            self.trace.values.push(value);
        }
    }

    /// Counts a record of its source, whether or not it has a value.
    pub(super) fn count(&mut self) {
        self.counts.frames += 1;
    }

    /// Counts a record of its source without a usable time.
    pub(super) fn count_timeless(&mut self) {
        self.counts.frames += 1;
        self.counts.timeless += 1;
    }
}

/// The frames of one identifier.
#[derive(Debug, Default)]
struct Seen {
    frames: u64,
    /// The buses that they were on.
    buses: Vec<String>,
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
        let mut channels =
            Self { options, database, series: vec![], unresolved: vec![], seen, unusable, plain };
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
        if let Source::Signal { message, .. } = &source {
            let id = self.database.messages[*message].id;
            self.seen.entry(id).or_default().series.push(self.series.len());
        }
        let (trace, counts) = (Trace::default(), Counts::default());
        self.series.push(Series { quantity, name, source, convert, trace, counts });
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
        let of_group =
            name.rsplit_once(':').and_then(|(name, group)| Some((name, group.parse::<usize>().ok()?)));
        let is_it = |found: &FoundSignal| Some((&*found.source, found.group)) == of_group;
        let found = self.plain.iter().position(is_it);
        Ok(found.map(|index| (Source::Plain(index), self.plain[index].unit.clone())))
    }

    /// The signal that `name` means, and its unit; `None` if the database has none.
    fn signal(&self, name: &str, bus: Option<&str>) -> Result<Option<(Source, String)>, MapFault> {
        let found = self.database.find(name)?;
        Ok(found.map(|(message, signal)| {
            let unit = self.database.messages[message].signals[signal].unit.clone();
            (Source::Signal { message, signal, bus: bus.map(str::to_owned) }, unit)
        }))
    }

    /// The signals that occur in the log, and the channels of an MDF4 file.
    fn found(&self) -> Vec<FoundSignal> {
        let of_message = |seen: &Seen| {
            let message = &self.database.messages[seen.message?];
            let frames = seen.frames;
            let signals = message.signals.iter().filter(|signal| check_signal(message, signal).is_ok());
            let found = signals.map(move |signal| FoundSignal {
                source: format!("{}.{}", message.name, signal.name),
                unit: signal.unit.clone(),
                frames,
                group: 0,
            });
            Some(found.collect::<Vec<_>>())
        };
        let mut found: Vec<FoundSignal> = self.seen.values().filter_map(of_message).flatten().collect();
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
    pub(super) fn into_run(self, path: &Path, notes: &mut Vec<Note>) -> Result<Run, RunError> {
        let fail = |map: String, why| RunError::Map { path: path.to_owned(), map, why: Box::new(why) };
        if let Some(Unresolved { map, quantity, source }) = self.unresolved.first() {
            let found = self.found();
            let nearest =
                suggest::nearest(source, found.iter().map(|found| &*found.source)).map(str::to_owned);
            let (signal, signals) = (source.clone(), self.listing(*quantity));
            return Err(fail(map.clone(), MapFault::NoSignal { signal, nearest, signals }));
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
            let Series { quantity, name, trace, .. } = series;
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
        if let Source::Signal { message, bus: None, .. } = &series.source {
            let seen = self.seen.get(&self.database.messages[*message].id);
            let buses = seen.map(|seen| seen.buses.as_slice()).unwrap_or_default();
            if buses.len() > 1 {
                return Err(MapFault::SeveralBuses { signal, buses: buses.to_vec() });
            }
        }
        let Counts { frames, absent, short, not_increasing, out_of_range, timeless, .. } = series.counts;
        if let Some(last) = series.trace.stamps.last() {
            let kept = series.trace.len() as u64;
            if not_increasing <= kept {
                return Ok(());
            }
            let last_s = last.nanos() as f64 / 1e9;
            return Err(MapFault::TimesJump { signal, dropped: not_increasing, kept, last_s });
        }
        let signals = self.listing(series.quantity);
        match &series.source {
            Source::Signal { message, bus, .. } if frames == 0 => {
                let of = &self.database.messages[*message];
                let (message, id) = (of.name.clone(), of.id.to_string());
                let seen = self.seen.get(&of.id).map(|seen| seen.buses.clone()).unwrap_or_default();
                match bus {
                    Some(bus) if !seen.is_empty() => {
                        Err(MapFault::NoBus { message, bus: bus.clone(), buses: seen })
                    }
                    _ => Err(MapFault::NoFrame { message, id, signals }),
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

impl Series {
    fn notes(&self, notes: &mut Vec<Note>) {
        let signal = || self.name.clone();
        let Counts { not_finite, short, out_of_range, timeless, not_increasing, .. } = self.counts;
        let counts = [
            (not_finite, "NaN or infinite values"),
            (short, "too few data bytes for it"),
            (out_of_range, "a value outside of its range in the DBC file"),
            (timeless, Unusable::Time.in_words()),
        ];
        for (count, what) in counts.into_iter().filter(|(count, _)| *count > 0) {
            notes.push(Note::SignalDropped { signal: signal(), count, what });
        }
        if not_increasing > 0 {
            notes.push(Note::SignalNotIncreasing { signal: signal(), count: not_increasing });
        }
    }
}

impl FrameSink for Channels<'_> {
    fn frame(&mut self, frame: &BusFrame<'_>) {
        let database = self.database;
        let seen = self.seen.entry(frame.id).or_default();
        if seen.frames == 0 {
            seen.message = database.messages.iter().position(|message| message.id == frame.id);
        }
        seen.frames += 1;
        if !seen.buses.iter().any(|bus| frame.bus.is(bus)) && seen.buses.len() < 64 {
            seen.buses.push(frame.bus.to_string());
        }
        for &index in &seen.series {
            let series = &mut self.series[index];
            let Source::Signal { message, signal, bus } = &series.source else { continue };
            if bus.as_ref().is_some_and(|bus| !frame.bus.is(bus)) {
                continue;
            }
            let signals = &database.messages[*message].signals;
            let decoded = decode(signals, *signal, frame.data);
            // As from a bus: see `input.rs`.
            let is_allowed = |value| signals[*signal].is_in_range(value);
            series.counts.frames += 1;
            match decoded {
                Decoded::Value(value) if !is_allowed(value) => series.counts.out_of_range += 1,
                Decoded::Value(value) => series.push(frame.nanos, value),
                Decoded::Absent => series.counts.absent += 1,
                Decoded::Short => series.counts.short += 1,
            }
        }
    }

    fn unusable(&mut self, what: Unusable) {
        *self.unusable.entry(what).or_default() += 1;
    }
}
