//! CAN buses: runs from logs (candump, Vector ASC and BLF, and MDF4 files), and the messages that a running node reads and sends.
//!
//! # Logs
//!
//! A log of frames needs DBC files, which describe the signals in the frames. The map of the run names the signal of each channel:
//! `displacement=SUSP_FL.Position`. An MDF4 file may hold plain channels in place of frames, or both.
//!
//! | format | time of a frame |
//! |---|---|
//! | candump | as in the file, since 1970, or from zero with `-t z` |
//! | ASC | as in the file, since the start of the measurement; negative before it |
//! | BLF | start of the measurement in the header plus the object's stamp, since 1970 |
//! | MDF4 | the time channel, since the start of the measurement |
//!
//! Each reader passes frames to a `frame::FrameSink`, so the channels do not depend on the format.
//!
//! # A running node
//!
//! [`Signals`] holds the messages of a bus, as DBC files describe them. It gives the [`Inputs`], which decode frames, and each
//! [`OutputMessage`], which encodes them. This module has no socket: the node passes the frames.

mod asc;
mod blf;
mod candump;
mod channels;
mod dbc;
mod encode;
mod error;
mod frame;
mod input;
mod j1939;
mod lookup;
mod mdf;
mod output;
mod places;
mod protection;
mod series;
mod signal;
mod text;
mod unpack;

pub use error::BusError;
pub use frame::{CanId, MOST_BYTES};
pub use input::{FrameReport, InputCheck, InputValue, Inputs, Refusal};
pub use j1939::FrameFilter;
pub use output::{FieldValue, OutputField, OutputMapping, OutputMessage, OutputTopic};

use super::hash::{Hash, HashingReader};
use super::{LoadOptions, Map, Note, RunError};
use channels::Channels;
use dbc::Database;
use frame::{BusFrame, FrameSink};
use mr_damper_model::sample::Run;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A format of logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Candump,
    Asc,
    Blf,
    Mdf4,
}

impl Format {
    /// The format that the extension of a file names.
    pub(super) fn of(extension: &str) -> Option<Self> {
        match extension {
            "log" => Some(Self::Candump),
            "asc" => Some(Self::Asc),
            "blf" => Some(Self::Blf),
            "mf4" | "mdf" => Some(Self::Mdf4),
            _ => None,
        }
    }
}

/// Reads the run in the log at `path`.
pub(super) fn load(
    path: &Path,
    format: Format,
    options: &LoadOptions,
    notes: &mut Vec<Note>,
    hash: &mut Hash,
) -> Result<Run, RunError> {
    let database = Database::read(&options.dbc)?;
    let file = File::open(path).map_err(RunError::io(path, "open"))?;
    if format == Format::Mdf4 {
        // Its blocks are read in any order, so the hash takes a pass of its own.
        let mut whole = HashingReader::new(&file, hash);
        whole.drain().map_err(RunError::io(path, "read"))?;
        return mdf::load(path, &file, options, &database, notes);
    }
    if options.dbc.is_empty() {
        return Err(RunError::NoDbc { path: path.to_owned() });
    }
    let mut channels = Channels::new(path, options, &database, Vec::new())?;
    let mut source = HashingReader::new(file, hash);
    read_frames(path, format, source.by_ref(), options, &mut channels, notes)?;
    source.drain().map_err(RunError::io(path, "read"))?;
    channels.into_run(path, notes)
}

fn read_frames(
    path: &Path,
    format: Format,
    source: impl Read,
    options: &LoadOptions,
    sink: &mut impl FrameSink,
    notes: &mut Vec<Note>,
) -> Result<(), RunError> {
    let skip = options.skip_bad_rows;
    match format {
        Format::Candump => text::read(path, source, candump::Candump, skip, sink, notes),
        Format::Asc => text::read(path, source, asc::Asc::new(), skip, sink, notes),
        Format::Blf | Format::Mdf4 => blf::read(path, std::io::BufReader::new(source), sink, notes),
    }
}

/// The messages of a bus, as DBC files describe them.
#[derive(Debug, Clone, Default)]
pub struct Signals(Database);

impl Signals {
    /// Reads DBC files.
    ///
    /// # Errors
    /// When a file cannot be read, or is not a DBC file.
    pub fn read(paths: &[PathBuf]) -> Result<Self, BusError> {
        Ok(Self(Database::read(paths)?))
    }

    /// The inputs that `map` names. `known` are the channels that the node reads.
    ///
    /// # Errors
    /// When a mapping does not fit the DBC files.
    pub fn inputs(&self, map: &Map, known: &[&'static str]) -> Result<Inputs, BusError> {
        Inputs::new(self.0.clone(), map, known)
    }

    /// The messages that carry the `outputs`. None of them is a message of `inputs`.
    ///
    /// # Errors
    /// When an output does not fit the DBC files, or a message has two uses.
    pub fn outputs(
        &self,
        outputs: &[OutputMapping],
        inputs: &Inputs,
    ) -> Result<Vec<OutputMessage>, BusError> {
        let mut messages: Vec<OutputMessage> = Vec::with_capacity(outputs.len());
        for mapping in outputs {
            let message = OutputMessage::new(&self.0, mapping)?;
            let used = if inputs.message(message.id()).is_some() {
                Some("an input")
            } else if messages.iter().any(|other| other.id() == message.id()) {
                Some("another output")
            } else {
                None
            };
            if let Some(used) = used {
                let (text, id) = (mapping.to_string(), message.id().to_string());
                return Err(BusError::Taken { text, message: message.name().to_owned(), id, used });
            }
            messages.push(message);
        }
        Ok(messages)
    }
}

/// A data frame of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogFrame<'a> {
    /// Time in the log, ns.
    pub nanos: i64,
    /// The identifier.
    pub id: CanId,
    /// At most [`MOST_BYTES`] bytes.
    pub data: &'a [u8],
}

/// Passes the data frames of a log of frames to `on`, in the order of the log: candump, ASC or BLF. With `bus`, only the frames that
/// were on this bus.
///
/// # Errors
/// When the file cannot be read, or is not such a log.
pub fn read_log(path: &Path, bus: Option<&str>, on: impl FnMut(LogFrame<'_>)) -> Result<(), RunError> {
    struct Passing<'a, F>(Option<&'a str>, F);
    impl<F: FnMut(LogFrame<'_>)> FrameSink for Passing<'_, F> {
        fn frame(&mut self, frame: &BusFrame<'_>) {
            if self.0.is_none_or(|bus| frame.bus.is(bus)) {
                self.1(LogFrame { nanos: frame.nanos, id: frame.id, data: frame.data });
            }
        }
    }
    let extension = path.extension().and_then(|it| it.to_str()).map(str::to_ascii_lowercase);
    let format = extension.as_deref().and_then(Format::of).filter(|format| *format != Format::Mdf4);
    let format = format.ok_or_else(|| RunError::NotARun {
        path: path.to_owned(),
        why: "only logs of frames can be played as a bus (.log of candump, .asc, .blf)".to_owned(),
    })?;
    let file = File::open(path).map_err(RunError::io(path, "open"))?;
    read_frames(path, format, file, &LoadOptions::default(), &mut Passing(bus, on), &mut Vec::new())
}

/// A line of a log as `candump -L` writes it, for a frame at `nanos` on the bus `bus`. A frame of more than 8 bytes is one of CAN FD.
#[must_use]
pub fn candump_line(nanos: i64, bus: &str, id: CanId, data: &[u8]) -> String {
    use std::fmt::Write as _;
    let sign = if nanos < 0 { "-" } else { "" };
    let (seconds, rest) = (nanos.unsigned_abs() / 1_000_000_000, nanos.unsigned_abs() % 1_000_000_000);
    let width = if id.extended { 8 } else { 3 };
    let kind = if data.len() > 8 { "##1" } else { "#" };
    let mut line = format!("({sign}{seconds}.{rest:09}) {bus} {:0width$X}{kind}", id.value);
    for byte in data {
        let _ = write!(line, "{byte:02X}");
    }
    line.push('\n');
    line
}

/// A short form of a text of a file, for messages.
fn shown(text: &str) -> String {
    const MOST: usize = 80;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}
