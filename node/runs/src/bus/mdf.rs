//! Reads MDF4 files (ASAM MDF 4.0 to 4.3): plain channels, and frames of a CAN bus (ASAM MDF bus logging).
//!
//! Data may be sorted or not, in lists, and packed with deflate, zstd or LZ4. Of a file that ends early, or has a damaged block of data, the
//! records before are read. A recorder that did not finish its file leaves counts of zero; its records are then counted by the data.

mod blocks;
mod data;
mod origin;
mod packed;
mod structure;
mod value;

use super::channels::{Channels, Source};
use super::dbc::Database;
use super::frame::{Bus, BusFrame, CanId, FrameSink, MOST_BYTES, Unusable, bytes_of_code};
use crate::decimal::{parse_nanos, push_value};
use crate::error::MapFault;
use crate::suggest::FoundSignal;
use crate::unit::TimeUnit;
use crate::{LoadOptions, Note, RunError};
use blocks::{BlockFault, Blocks, Stop};
use mr_damper_model::sample::Run;
use origin::Origins;
use std::io::{Read, Seek};
use std::path::Path;
use structure::{Channel, ChannelGroup, DataGroup, Role};
use value::Conversion;

/// Name of the structure with the parts of a data frame.
const FRAME: &str = "CAN_DataFrame";
/// Names of all structures with parts of frames.
const FRAMES: [&str; 4] = [FRAME, "CAN_ErrorFrame", "CAN_RemoteFrame", "CAN_OverloadFrame"];
/// Most bytes of variable length that are kept.
const MOST_VARIABLE: usize = 1 << 30;
/// Length of the field before bytes of variable length, bytes.
const LENGTH_FIELD: usize = 4;

/// Reads the run in an MDF4 file.
pub(super) fn load<R: Read + Seek>(
    path: &Path,
    source: R,
    options: &LoadOptions,
    database: &Database,
    notes: &mut Vec<Note>,
) -> Result<Run, RunError> {
    let blocks = Blocks::new(path, source)?;
    let not_mdf = |why: String| RunError::NotABag { path: path.to_owned(), format: "a whole MDF4 file", why };
    let of_stop = |stop| match stop {
        Stop::Damaged(fault) => not_mdf(shown(&fault)),
        Stop::Failed(error) => error,
    };
    let state = identification(&blocks).map_err(of_stop)?;
    let (groups, mut fault) = structure::read(&blocks).map_err(of_stop)?;
    let numbered: Vec<Numbered<'_>> = numbered(&groups);
    if numbered.is_empty() {
        let why = fault.map_or_else(|| "it has no group of channels".to_owned(), |fault| shown(&fault));
        return Err(not_mdf(why));
    }
    let (plain, places) = plain_channels(&numbered, state.is_finished);
    if plain.is_empty() && options.dbc.is_empty() {
        return Err(RunError::NoDbc { path: path.to_owned() });
    }
    let mut channels = Channels::new(path, options, database, plain)?;
    let origins = origin::origins(&numbered);
    channels.sources.clone_from(&origins.sources);
    let wanted = wanted(path, &channels, &numbered, &places)?;
    let (mut records, mut ended) = (0, None);
    for (index, group) in groups.iter().enumerate() {
        let own: Vec<&Numbered<'_>> = numbered.iter().filter(|it| it.data_group == index).collect();
        let mut readers = readers(&blocks, group, &own, &wanted, database, &mut ended).map_err(of_stop)?;
        if readers.is_empty() {
            continue;
        }
        let mut read = Records { group, state, counts: vec![0; group.groups.len()], pending: Vec::new() };
        let end = read.all(&blocks, &mut |number, record| {
            for reader in readers.iter_mut().filter(|reader| reader.group_index == number) {
                reader.take(record, &origins, &mut channels);
            }
        });
        ended = ended.or(end.map_err(of_stop)?);
        records += readers.iter().map(|reader| reader.taken).sum::<u64>();
    }
    if records == 0
        && let Some(fault) = &ended
    {
        return Err(not_mdf(shown(fault)));
    }
    fault = fault.or(ended);
    if !state.is_finished {
        notes.push(Note::LogUnfinished { path: path.to_owned() });
    }
    if let Some(BlockFault { at, why }) = fault {
        notes.push(Note::LogCutShort {
            path: path.to_owned(),
            place: format!("byte {at}"),
            frames: records,
            why,
        });
    }
    channels.into_run(path, notes)
}

fn shown(fault: &BlockFault) -> String {
    format!("byte {}: {}", fault.at, fault.why)
}

/// How the recorder left the file.
#[derive(Debug, Clone, Copy)]
struct State {
    /// True if it wrote all counts.
    is_finished: bool,
    /// True if the last data block has no length.
    is_open: bool,
}

/// Checks the identification of the file.
fn identification<R: Read + Seek>(blocks: &Blocks<'_, R>) -> Result<State, Stop> {
    let bytes = blocks.bytes(0, 64)?;
    let is_finished = bytes.starts_with(b"MDF     ");
    if bytes.len() < 64 || !(is_finished || bytes.starts_with(b"UnFinMF ")) {
        let why = match bytes.len() {
            0 => "it is empty".to_owned(),
            64 => format!("it begins with `{}`", bytes[..8].escape_ascii()),
            count => format!("it has {count} bytes"),
        };
        return Err(blocks::damaged(0, why));
    }
    let version = u16::from_le_bytes([bytes[28], bytes[29]]);
    if !(400..500).contains(&version) {
        let why =
            format!("MDF {}.{}: convert it to MDF 4, for example with asammdf", version / 100, version % 100);
        return Err(blocks::damaged(8, why));
    }
    let flags = u16::from_le_bytes([bytes[60], bytes[61]]);
    const NO_LENGTH: u16 = 4;
    Ok(State { is_finished, is_open: !is_finished && flags & NO_LENGTH != 0 })
}

/// A channel group with its number in the file, as asammdf counts: groups of variable length hold no channel.
struct Numbered<'a> {
    number: usize,
    data_group: usize,
    /// Index in the data group.
    index: usize,
    group: &'a ChannelGroup,
}

fn numbered(groups: &[DataGroup]) -> Vec<Numbered<'_>> {
    let mut out = Vec::new();
    for (data_group, of) in groups.iter().enumerate() {
        for (index, group) in of.groups.iter().enumerate().filter(|(_, group)| !group.is_variable) {
            out.push(Numbered { number: out.len(), data_group, index, group });
        }
    }
    out
}

/// The plain channels that hold numbers, and the group and channel of each.
fn plain_channels(groups: &[Numbered<'_>], is_finished: bool) -> (Vec<FoundSignal>, Vec<(usize, usize)>) {
    let (mut found, mut places) = (Vec::new(), Vec::new());
    for Numbered { number, group, .. } in groups {
        for (index, channel) in group.channels.iter().enumerate() {
            if channel.role != Role::Value
                || !channel.place.is_number()
                || FRAMES.iter().any(|frame| channel.name.starts_with(frame))
            {
                continue;
            }
            let frames = if is_finished { group.records } else { group.records.max(1) };
            let (source, unit) = (channel.name.clone(), channel.unit.clone());
            found.push(FoundSignal { source, unit, frames, group: *number });
            places.push((*number, index));
        }
    }
    (found, places)
}

/// A channel of the run: its index, and group and channel of the file.
struct Wanted {
    series: usize,
    group: usize,
    channel: usize,
}

fn wanted(
    path: &Path,
    channels: &Channels<'_>,
    groups: &[Numbered<'_>],
    places: &[(usize, usize)],
) -> Result<Vec<Wanted>, RunError> {
    let mut wanted = Vec::new();
    for (index, series) in channels.series.iter().enumerate() {
        let Source::Plain(plain) = series.source else { continue };
        let (number, channel) = places[plain];
        let group = groups[number].group;
        let fault = match (group.time(), group.channels[channel].conversion) {
            (_, Conversion::Other(kind)) => Some(MapFault::Conversion { channel: series.name.clone(), kind }),
            (None, _) if group.has_remote_master => {
                Some(MapFault::RemoteTime { channel: series.name.clone() })
            }
            (None, _) => Some(MapFault::NoTime { channel: series.name.clone() }),
            (Some(Channel { conversion: Conversion::Other(kind), .. }), _) => {
                Some(MapFault::Conversion { channel: format!("{} (its time)", series.name), kind: *kind })
            }
            (Some(time), _) if time_exponent(time).is_none() => {
                Some(MapFault::TimeUnit { channel: series.name.clone(), unit: time.unit.clone() })
            }
            _ => None,
        };
        if let Some(why) = fault {
            let (path, map) = (path.to_owned(), series.name.clone());
            return Err(RunError::Map { path, map, why: Box::new(why) });
        }
        wanted.push(Wanted { series: index, group: number, channel });
    }
    Ok(wanted)
}

/// The unit of a time channel, as a power of ten of a second; `None` if it is not known. MDF4 demands seconds; a file with another unit
/// means what it says.
fn time_exponent(time: &Channel) -> Option<i32> {
    match time.unit.trim() {
        "" | "sec" | "second" | "seconds" => Some(0),
        unit => TimeUnit::named(unit).map(|unit| unit.exponent),
    }
}

/// Reads the records of one channel group.
struct Reader<'a> {
    /// Number of the group in the file.
    number: usize,
    group_index: usize,
    group: &'a ChannelGroup,
    time: &'a Channel,
    /// The unit of the time, as a power of ten of a second.
    exponent: i32,
    values: Vec<(usize, &'a Channel)>,
    frame: Option<FrameParts<'a>>,
    taken: u64,
}

/// The parts of a frame in a record.
struct FrameParts<'a> {
    id: &'a Channel,
    /// True for 29 bits.
    extended: Option<&'a Channel>,
    length: Option<&'a Channel>,
    code: Option<&'a Channel>,
    bus: Option<&'a Channel>,
    bytes: &'a Channel,
    /// The bytes of variable length of all records.
    variable: Vec<u8>,
}

/// The readers of the groups that hold wanted channels or frames. `ended` becomes the first fault that ends bytes of variable length
/// early. Frames are not read if all of their bytes are lost.
fn readers<'a, R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    data_group: &'a DataGroup,
    groups: &[&Numbered<'a>],
    wanted: &[Wanted],
    database: &Database,
    ended: &mut Option<BlockFault>,
) -> Result<Vec<Reader<'a>>, Stop> {
    let mut readers = Vec::new();
    for Numbered { number, index, group, .. } in groups {
        let own = wanted.iter().filter(|wanted| wanted.group == *number);
        let values: Vec<_> = own.map(|wanted| (wanted.series, &group.channels[wanted.channel])).collect();
        let mut frame = if database.messages.is_empty() { None } else { frame_parts(group) };
        if let Some(parts) = &mut frame {
            let (bytes, end) = variable(blocks, data_group, parts.bytes)?;
            let is_lost = bytes.is_empty() && end.is_some();
            parts.variable = bytes;
            *ended = ended.take().or(end);
            if is_lost {
                frame = None;
            }
        }
        let Some(time) = group.time() else { continue };
        if !values.is_empty() || frame.is_some() {
            // That of wanted channels is known.
            let exponent = time_exponent(time).unwrap_or(0);
            readers.push(Reader {
                number: *number,
                group_index: *index,
                group,
                time,
                exponent,
                values,
                frame,
                taken: 0,
            });
        }
    }
    Ok(readers)
}

/// The parts of frames, if the group holds data frames.
fn frame_parts(group: &ChannelGroup) -> Option<FrameParts<'_>> {
    let part = |name: &str| {
        let is_it = |channel: &&Channel| {
            channel.name.strip_prefix(FRAME).and_then(|rest| rest.strip_prefix('.')) == Some(name)
        };
        group.channels.iter().find(is_it)
    };
    Some(FrameParts {
        id: part("ID")?,
        extended: part("IDE"),
        length: part("DataLength"),
        code: part("DLC"),
        bus: part("BusChannel"),
        bytes: part("DataBytes")?,
        variable: Vec::new(),
    })
}

/// The bytes of variable length of a channel, each with its length before it, and the fault that ended them early.
fn variable<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    data_group: &DataGroup,
    channel: &Channel,
) -> Result<(Vec<u8>, Option<BlockFault>), Stop> {
    let mut bytes = Vec::new();
    if channel.role != Role::Variable || channel.data == 0 {
        return Ok((bytes, None));
    }
    let at = channel.data;
    let mut keep = |more: &[u8]| {
        if bytes.len() + more.len() > MOST_VARIABLE {
            return Err(blocks::damaged(at, "more than 1 GiB of variable length"));
        }
        bytes.extend_from_slice(more);
        Ok(())
    };
    let head = match blocks.head(at) {
        Err(Stop::Damaged(fault)) => return Ok((bytes, Some(fault))),
        head => head?,
    };
    let ended = match &head.id {
        b"##CG" => {
            let state = State { is_finished: false, is_open: true };
            let mut records = Records {
                group: data_group,
                state,
                counts: vec![0; data_group.groups.len()],
                pending: Vec::new(),
            };
            let mut full = Ok(());
            records.all(blocks, &mut |index, record| {
                if data_group.groups[index].at == at && full.is_ok() {
                    full = keep(&(record.len() as u32).to_le_bytes()).and_then(|()| keep(record));
                }
            })?;
            full?;
            // The records of the data group are read again, and then give the fault.
            None
        }
        _ => data::stream(blocks, at, false, keep)?,
    };
    Ok((bytes, ended))
}

impl Reader<'_> {
    fn take(&mut self, record: &[u8], origins: &Origins, channels: &mut Channels<'_>) {
        let index = self.taken;
        self.taken += 1;
        let Some(nanos) = self.nanos(record, index) else {
            self.values.iter().for_each(|(series, _)| channels.series[*series].count_timeless());
            if self.frame.is_some() {
                channels.unusable(Unusable::Time);
            }
            return;
        };
        for (series, channel) in &self.values {
            let series = &mut channels.series[*series];
            series.count();
            if self.group.is_valid(channel, record)
                && let Some(value) = channel.place.value(&channel.conversion, record)
            {
                series.push(nanos, value);
            }
        }
        let Some(parts) = &self.frame else { return };
        match parts.of(record) {
            Some((bus, Some(id), data)) => {
                let named = || origins.bus(self.number).map_or(Bus::Number(0), Bus::Name);
                let bus = bus.map_or_else(named, Bus::Number);
                channels.place = origins.places.get(self.number).copied().unwrap_or_default();
                channels.frame(&BusFrame { nanos, bus, id, data });
            }
            Some((_, None, _)) => channels.unusable(Unusable::Identifier),
            None => {}
        }
    }

    /// The time of a record, ns. It is read from the shortest decimal text of the seconds, as for a table in memory.
    fn nanos(&self, record: &[u8], index: u64) -> Option<i64> {
        let seconds = match self.time.role {
            Role::VirtualTime => match self.time.conversion {
                Conversion::Identity => index as f64,
                Conversion::Linear { factor, offset } => index as f64 * factor + offset,
                Conversion::Rational(_) | Conversion::Other(_) => return None,
            },
            _ => self.time.place.value(&self.time.conversion, record)?,
        };
        if !seconds.is_finite() {
            return None;
        }
        let mut text = String::new();
        push_value(&mut text, seconds);
        parse_nanos(&text, self.exponent)
    }
}

impl FrameParts<'_> {
    /// Number of the bus, identifier and data of the frame in a record. The number is `None` if the group lacks it. An identifier that
    /// cannot be is `None`, too.
    fn of<'r>(&'r self, record: &'r [u8]) -> Option<(Option<u32>, Option<CanId>, &'r [u8])> {
        let number = |channel: &Channel| channel.place.bits(record);
        let raw = u32::try_from(number(self.id)?).ok()?;
        // Without a mark, only an identifier of 29 bits can be larger than 0x7FF.
        let extended = self.extended.and_then(number).map_or(raw > 0x7ff, |bit| bit != 0);
        let id = CanId::new(raw & 0x1fff_ffff, extended);
        let by_code = || self.code.and_then(number).map(|code| bytes_of_code(code.min(15) as u8));
        let stored = match self.bytes.role {
            Role::Variable => {
                let from = usize::try_from(number(self.bytes)?).ok()?;
                let rest = self.variable.get(from..)?;
                let length = u32::from_le_bytes(*rest.first_chunk()?) as usize;
                rest.get(LENGTH_FIELD..)?.get(..length)?
            }
            _ => record.get(self.bytes.place.byte..)?.get(..self.bytes.array_bytes)?,
        };
        let length = match self.length.and_then(number) {
            Some(length) => usize::try_from(length).ok()?,
            None => by_code().unwrap_or(stored.len()),
        };
        let data = stored.get(..length.min(stored.len()))?;
        let bus = self.bus.map(|bus| number(bus).and_then(|bus| u32::try_from(bus).ok()).unwrap_or(0));
        (data.len() <= MOST_BYTES).then_some((bus, id, data))
    }
}

/// The index of a channel group, its record, and the bytes behind the record.
type Split<'r> = (usize, &'r [u8], &'r [u8]);

/// The records of a data group while they are read.
struct Records<'a> {
    group: &'a DataGroup,
    state: State,
    /// Number of records of each channel group.
    counts: Vec<u64>,
    /// The beginning of a record whose end is not read yet.
    pending: Vec<u8>,
}

impl Records<'_> {
    /// Passes each record, with the index of its channel group, to `take`. Returns the fault if the data end early.
    fn all<R: Read + Seek>(
        &mut self,
        blocks: &Blocks<'_, R>,
        take: &mut impl FnMut(usize, &[u8]),
    ) -> Result<Option<BlockFault>, Stop> {
        let at = self.group.data;
        let fault = data::stream(blocks, at, self.state.is_open, |bytes| self.add(at, bytes, take))?;
        if fault.is_some() || !self.state.is_finished {
            return Ok(fault);
        }
        let missing =
            self.group.groups.iter().zip(&self.counts).find(|(group, count)| **count < group.records);
        Ok(missing.map(|(group, count)| {
            let why = format!("the data hold {count} records in place of {}", group.records);
            BlockFault { at, why }
        }))
    }

    fn add(&mut self, at: u64, bytes: &[u8], take: &mut impl FnMut(usize, &[u8])) -> Result<(), Stop> {
        self.pending.extend_from_slice(bytes);
        let all = std::mem::take(&mut self.pending);
        let mut rest = all.as_slice();
        while let Some((index, record, after)) = self.split(at, rest)? {
            let is_counted = self.counts[index] < self.group.groups[index].records;
            if is_counted || !self.state.is_finished {
                self.counts[index] += 1;
                take(index, record);
            }
            rest = after;
        }
        self.pending = rest.to_vec();
        Ok(())
    }

    /// The first record of `rest`; `None` if it is not whole.
    fn split<'r>(&self, at: u64, rest: &'r [u8]) -> Result<Option<Split<'r>>, Stop> {
        let Some((id, body)) = rest.split_at_checked(self.group.id_bytes) else { return Ok(None) };
        if body.is_empty() {
            return Ok(None);
        }
        let number = id.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
        let is_it = |group: &ChannelGroup| id.is_empty() || group.record_id == number;
        let Some(index) = self.group.groups.iter().position(is_it) else {
            return Err(blocks::damaged(at, format!("the data hold a record of the unknown kind {number}")));
        };
        let group = &self.group.groups[index];
        let (skip, length) = if group.is_variable {
            let Some(length) = body.first_chunk() else { return Ok(None) };
            (LENGTH_FIELD, u32::from_le_bytes(*length) as usize)
        } else {
            (0, group.bytes.saturating_add(group.invalidation_bytes))
        };
        if skip + length == 0 {
            return Err(blocks::damaged(at, "records without bytes"));
        }
        Ok(body
            .get(skip..)
            .and_then(|body| body.split_at_checked(length))
            .map(|(record, after)| (index, record, after)))
    }
}
