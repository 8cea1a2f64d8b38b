//! Reads runs from logs of a CAN bus: candump, Vector ASC and BLF, and MDF4 files.
//!
//! A log of frames needs DBC files, which describe the signals in the frames. The map of the run names the signal of each channel:
//! `displacement=SUSP_FL.Position`. An MDF4 file may hold plain channels in place of frames, or both.
//!
//! | format | time of a frame |
//! |---|---|
//! | candump | as in the file, since 1970, or from zero with `-t z` |
//! | ASC | as in the file, since the start of the measurement |
//! | BLF | start of the measurement in the header plus the object's stamp, since 1970 |
//! | MDF4 | the time channel, since the start of the measurement |
//!
//! Each reader passes frames to a [`frame::FrameSink`], so the channels do not depend on the format.

mod asc;
mod blf;
mod candump;
mod channels;
mod dbc;
mod frame;
mod mdf;
mod signal;
mod text;

use super::hash::{Hash, HashingReader};
use super::{LoadOptions, Note, RunError};
use channels::Channels;
use dbc::Database;
use mr_damper_model::sample::Run;
use std::fs::File;
use std::io::Read;
use std::path::Path;

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
    sink: &mut Channels<'_>,
    notes: &mut Vec<Note>,
) -> Result<(), RunError> {
    let skip = options.skip_bad_rows;
    match format {
        Format::Candump => text::read(path, source, candump::Candump, skip, sink, notes),
        Format::Asc => text::read(path, source, asc::Asc::new(), skip, sink, notes),
        Format::Blf | Format::Mdf4 => blf::read(path, std::io::BufReader::new(source), sink, notes),
    }
}

/// A short form of a text of a file, for messages.
fn shown(text: &str) -> String {
    const MOST: usize = 80;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}
