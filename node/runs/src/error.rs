//! Errors of reading and writing runs.

mod dbc_fault;
mod line_fault;
mod map_fault;

pub use dbc_fault::DbcFault;
pub use line_fault::LineFault;
pub use map_fault::MapFault;

use mr_damper_base::disk::advice;
use std::path::PathBuf;

/// Why a run could not be read or written. Every message says what failed, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The operating system reported an error.
    #[error("{}: cannot {action}: {source}{}", path.display(), advice(source.kind()))]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// The action that failed, as a verb: `open`, `read`, ...
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The path is neither CSV, a bag, nor a log of a bus.
    #[error(
        "{}: not a run: {why}; a run is a CSV file, a rosbag2 directory with metadata.yaml, an .mcap or .db3 file, or a log of a bus \
         (.mf4, .asc, .blf, .log)",
        path.display()
    )]
    NotARun {
        /// The path.
        path: PathBuf,
        /// Description of what is at the path.
        why: String,
    },
    /// SQLite cannot read or write a database, for another reason than the content of the database.
    #[error("{}: cannot {action}: {why}", path.display())]
    Database {
        /// The file.
        path: PathBuf,
        /// The action that failed, as a verb.
        action: &'static str,
        /// SQLite's reason.
        why: String,
    },
    /// The header row does not describe a run.
    #[error("{}, line {line}: {why}", path.display())]
    Header {
        /// The CSV file.
        path: PathBuf,
        /// Line of the header, or of a row below it that shows the fault, from 1.
        line: u64,
        /// The fault, and advice.
        why: String,
    },
    /// The columns of a table in memory do not describe a run.
    #[error("{}: {why}", path.display())]
    Table {
        /// Name of the table.
        path: PathBuf,
        /// The fault, and advice.
        why: String,
    },
    /// A cell of a table in memory cannot be used.
    #[error(
        "{}, row {row}, column `{column}`: `{value}` {why}; correct it, or drop such rows with skip_bad_rows",
        path.display()
    )]
    Row {
        /// Name of the table.
        path: PathBuf,
        /// Row, from 0.
        row: u64,
        /// Name of the column.
        column: String,
        /// The cell as text.
        value: String,
        /// The fault.
        why: String,
    },
    /// A cell cannot be read as a time or as a finite number.
    #[error(
        "{}, line {line}, column `{column}`: `{value}` {why}; correct it, or drop such rows with \
         --skip-bad-rows",
        path.display()
    )]
    Cell {
        /// The CSV file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The column's header.
        column: String,
        /// The text of the cell.
        value: String,
        /// The fault.
        why: &'static str,
    },
    /// A row has too few or too many fields.
    #[error(
        "{}, line {line}: {found} fields, {expected} expected ({hint}); correct the row, or drop such rows \
         with --skip-bad-rows",
        path.display()
    )]
    RowLength {
        /// The CSV file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Number of fields in the row.
        found: usize,
        /// Number of fields in the header.
        expected: usize,
        /// The first column without a value, or the first surplus value.
        hint: String,
    },
    /// Time does not increase.
    #[error(
        "{}, line {line}, column `{column}`: {value} s does not come after {previous} s of the row before; \
         times must increase by 1 ns at least: sort or correct the file, or drop such rows with \
         --skip-bad-rows",
        path.display()
    )]
    TimeOrder {
        /// The CSV file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The column that holds the time.
        column: String,
        /// The time in seconds.
        value: String,
        /// The last accepted time, as exact decimal seconds.
        previous: String,
    },
    /// More than half of the rows are bad, so they are not dropped.
    #[error(
        "{}: {skipped} bad rows against {kept} good ones, so this is not a run with a few faults; the first: \
         {first}",
        path.display()
    )]
    MostlyBad {
        /// The CSV file.
        path: PathBuf,
        /// Number of bad rows.
        skipped: u64,
        /// Number of good rows.
        kept: u64,
        /// The first fault.
        first: String,
    },
    /// The run has no displacement.
    #[error("{}: no sample of displacement; {hint}", path.display())]
    NoDisplacement {
        /// The run.
        path: PathBuf,
        /// The reason, and advice.
        hint: String,
    },
    /// The sign of a channel was given, but the run does not have the channel.
    #[error("{}: has no {channel}, so its sign cannot be changed; leave it out of --sign", path.display())]
    SignOfNothing {
        /// The run.
        path: PathBuf,
        /// The channel.
        channel: &'static str,
    },
    /// Both kinds of drive were recorded, and none was chosen.
    #[error(
        "{}: both a coil current ({current}) and a command voltage ({command}) are recorded, and a model \
         takes one of them; choose with --drive current_a or --drive command_v",
        path.display()
    )]
    BothDrives {
        /// The run.
        path: PathBuf,
        /// Column or topic of the current.
        current: String,
        /// Column or topic of the voltage.
        command: String,
    },
    /// The bag has several dampers, and none was chosen.
    #[error(
        "{}: {what}: {}; choose one with --bag-namespace",
        path.display(), found.join(", ")
    )]
    Namespaces {
        /// The bag.
        path: PathBuf,
        /// The ambiguity.
        what: &'static str,
        /// The namespaces.
        found: Vec<String>,
    },
    /// A topic with a known name has a type that cannot hold its quantity.
    #[error(
        "{}: topic {topic} holds {found}; accepted are {accepted}, in CDR{}",
        path.display(),
        instead.as_ref().map(|line| format!("; say where displacement is, for example {line}")).unwrap_or_default()
    )]
    TopicType {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Its type and message encoding.
        found: String,
        /// The accepted types.
        accepted: Box<str>,
        /// The flag that maps displacement to a topic that may hold it, if there is one.
        instead: Option<String>,
    },
    /// A mapping of `--map` cannot be used with this run.
    #[error("{}: --map {map}: {why}", path.display())]
    Map {
        /// The run.
        path: PathBuf,
        /// The mapping.
        map: String,
        /// The reason.
        why: Box<MapFault>,
    },
    /// A DBC file cannot be used.
    #[error("{}, line {line}: {fault}", path.display())]
    Dbc {
        /// The DBC file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The fault, and advice.
        fault: DbcFault,
    },
    /// A log of frames was given without a DBC file.
    #[error(
        "{}: holds frames of a bus, and nothing says which signals are in them: give the DBC file of the bus with --dbc FILE.dbc",
        path.display()
    )]
    NoDbc {
        /// The log.
        path: PathBuf,
    },
    /// A line of a log cannot be read.
    #[error("{}, line {line}: {fault}", path.display())]
    LogLine {
        /// The log.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The fault, and advice.
        fault: LineFault,
    },
    /// `metadata.yaml` cannot be used.
    #[error(
        "{}: {why}; `ros2 bag reindex` rewrites it, or name the .mcap or .db3 file itself",
        path.display()
    )]
    Metadata {
        /// The metadata file.
        path: PathBuf,
        /// The fault.
        why: String,
    },
    /// A file does not have the format that its name or its first bytes indicate.
    #[error("{}: not {format}: {why}", path.display())]
    NotABag {
        /// The file.
        path: PathBuf,
        /// The expected format: `an MCAP file`, `a rosbag2 database`, ...
        format: &'static str,
        /// The reason.
        why: String,
    },
    /// The bag has a compression that this build cannot read.
    #[error(
        "{}{}: compressed with `{name}`, which is not read (zstd and none are); convert it once with \
         `rosbags-convert --src BAG --dst OUT --dst-storage mcap` (from PyPI: rosbags) or `ros2 bag \
         convert`, and give OUT",
        path.display(), at(*offset)
    )]
    Compression {
        /// The file.
        path: PathBuf,
        /// Byte offset of the chunk; `None` for the whole file.
        offset: Option<u64>,
        /// Name of the compression.
        name: String,
    },
    /// The target exists already.
    #[error("{}: exists already and is not overwritten; remove it or choose another name", path.display())]
    Exists {
        /// The target.
        path: PathBuf,
    },
    /// The extension of the target names no format.
    #[error(
        "{}: cannot tell what to write: name a .csv, .mcap or .db3 file, or a directory without extension for a \
         rosbag2 bag",
        path.display()
    )]
    Target {
        /// The target.
        path: PathBuf,
    },
    /// The format cannot hold a run, topic or message.
    #[error("{}: cannot write {what}: {why}", path.display())]
    Unwritable {
        /// The target.
        path: PathBuf,
        /// The column or topic.
        what: String,
        /// The reason, and advice.
        why: String,
    },
    /// No message of a bag can be played.
    #[error("{}: no message of a type that mr-damper knows; play a bag of `mr-damper record`, or name its channels with --map", path.display())]
    NoMessages {
        /// The bag.
        path: PathBuf,
    },
    /// The MCAP writer failed.
    #[error("{}: cannot write: {source}{}", path.display(), of_mcap(source))]
    Write {
        /// The MCAP file.
        path: PathBuf,
        /// The library's reason.
        source: ::mcap::McapError,
    },
}

impl RunError {
    /// An adapter for `map_err` of I/O results.
    pub(super) fn io(path: &std::path::Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, action, source }
    }
}

/// `, at byte N`, or an empty text.
fn at(offset: Option<u64>) -> String {
    offset.map(|offset| format!(", at byte {offset}")).unwrap_or_default()
}

/// The system's error and advice, which the message of the MCAP library does not contain.
fn of_mcap(error: &::mcap::McapError) -> String {
    match error {
        ::mcap::McapError::Io(error) => format!(": {error}{}", advice(error.kind())),
        _ => String::new(),
    }
}
