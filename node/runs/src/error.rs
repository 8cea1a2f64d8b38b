//! Errors of reading and writing runs, and notes on a run that was read.

use super::map::flag;
use crate::extract::{Dimension, UnsuitableSource};
use mr_damper_base::disk::advice;
use std::fmt;
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
    /// The path is neither CSV nor a bag.
    #[error(
        "{}: not a run: {why}; a run is a CSV file, a rosbag2 directory with metadata.yaml, or an .mcap or .db3 file",
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
        /// Line of the header, from 1.
        line: u64,
        /// The fault, and advice.
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
    /// The MCAP writer failed.
    #[error("{}: cannot write: {source}{}", path.display(), of_mcap(source))]
    Write {
        /// The MCAP file.
        path: PathBuf,
        /// The library's reason.
        source: ::mcap::McapError,
    },
}

/// Why a channel cannot be read from the source that it is mapped to.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapFault {
    /// The topic is not in the bag.
    #[error("topic {topic} is not in the bag{}; {topics}", did_you_mean(nearest))]
    NoTopic {
        /// The topic.
        topic: String,
        /// The topic with the most similar name.
        nearest: Option<String>,
        /// List of the topics in the bag.
        topics: String,
    },
    /// The source is a column, but the run is a bag.
    #[error(
        "`{column}` is a column, and this run is a bag: name a topic, which begins with a slash; {topics}"
    )]
    ColumnOfBag {
        /// The source as given.
        column: String,
        /// List of the topics in the bag.
        topics: String,
    },
    /// Time is mapped, but the run is a bag.
    #[error("messages of a bag have their stamps: leave out the map of time, which is for CSV files")]
    TimeOfBag,
    /// The topic's type does not fit the channel.
    #[error("{unfit}{}", instead.as_ref().map(|line| format!("; this bag has {line}")).unwrap_or_default())]
    Unfit {
        /// The reason.
        unfit: UnsuitableSource,
        /// The flag for a topic of this bag that fits.
        instead: Option<String>,
    },
    /// The joint is not in the messages.
    #[error("joint `{joint}` is not in the messages{}; joints are {}", did_you_mean(nearest), joints.join(", "))]
    NoJoint {
        /// The joint.
        joint: String,
        /// The joint with the most similar name.
        nearest: Option<String>,
        /// The joints in the messages.
        joints: Vec<String>,
    },
    /// The topic is in the bag, but has no message.
    #[error(
        "topic {topic} is in the bag, but no message was recorded: map another topic, or record it again"
    )]
    NoMessage {
        /// The topic.
        topic: String,
    },
    /// No message can be decoded.
    #[error("no message of {topic} could be decoded: {fault}")]
    Undecodable {
        /// The topic.
        topic: String,
        /// The fault of the first message.
        fault: String,
    },
    /// No message has a finite value.
    #[error(
        "none of the {messages} messages of {topic} has a finite value for this channel: map another topic"
    )]
    NoValue {
        /// The topic.
        topic: String,
        /// Number of messages.
        messages: u64,
    },
    /// The messages are not in CDR.
    #[error("its messages are in `{encoding}`, and only CDR is read")]
    Encoding {
        /// The encoding.
        encoding: String,
    },
    /// The column is not in the file.
    #[error("there is no column `{column}`{}; columns are {columns}", did_you_mean(nearest))]
    NoColumn {
        /// The column.
        column: String,
        /// The column with the most similar name.
        nearest: Option<String>,
        /// List of the columns in the file.
        columns: String,
    },
    /// The column holds another quantity.
    #[error("column `{column}` holds a {found}, and {channel} is a {needed}: map another column")]
    Quantity {
        /// The column.
        column: String,
        /// Its quantity, according to its name.
        found: Dimension,
        /// The channel.
        channel: &'static str,
        /// The channel's quantity.
        needed: Dimension,
    },
    /// The column holds the time.
    #[error("column `{column}` is the time: map another column")]
    IsTime {
        /// The column.
        column: String,
    },
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map(|nearest| format!("; did you mean {nearest}?")).unwrap_or_default()
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

/// A fact that the user should know about a run that was read.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Note {
    /// Bad rows of a CSV file were dropped, as requested.
    RowsSkipped {
        /// Number of rows.
        count: u64,
        /// The faults of the first few.
        first: Vec<String>,
    },
    /// Empty cells were read as "no sample of this channel at this time".
    EmptyCells {
        /// The column.
        column: String,
        /// Number of cells.
        count: u64,
    },
    /// A column looks like a known quantity, but its unit is not known; it was carried through and not used.
    UnitUnknown {
        /// The column.
        column: String,
        /// The channel that it looks like.
        channel: &'static str,
        /// The known names of the quantity.
        known: String,
    },
    /// A file of a bag ended early or was damaged; all messages before that were read.
    CutShort {
        /// The file.
        path: PathBuf,
        /// Byte offset of the first record that could not be read; for a database the end of the file.
        offset: u64,
        /// Number of messages read from the file, of all topics.
        messages: u64,
        /// The fault at that offset.
        why: String,
    },
    /// A damaged chunk was skipped; the data after it were read.
    ChunkDamaged {
        /// The file.
        path: PathBuf,
        /// Byte offset of the chunk.
        offset: u64,
        /// The fault.
        why: String,
    },
    /// Rows of a damaged database were skipped.
    RowsDamaged {
        /// The file.
        path: PathBuf,
        /// Id of the first message that could not be read; `None` for rows that are not messages.
        first: Option<i64>,
        /// Id of the last one; `None` if no later message could be read.
        last: Option<i64>,
        /// The fault.
        why: String,
    },
    /// One of several files is not a file of a bag; the others were read.
    FileLeft {
        /// The file, and the reason.
        why: String,
    },
    /// A compressed file ended early or was damaged; the content before that was read.
    PackedCutShort {
        /// The file.
        path: PathBuf,
        /// Number of unpacked bytes.
        bytes: u64,
        /// The fault.
        why: String,
    },
    /// The recorder of a database was killed and left a journal, which was read too.
    Journal {
        /// The database.
        path: PathBuf,
        /// The suffix of the journal's name.
        journal: &'static str,
    },
    /// Messages that could not be decoded were dropped.
    Undecodable {
        /// The topic.
        topic: String,
        /// Number of messages.
        count: u64,
        /// The fault of the first message.
        first: String,
    },
    /// Messages with NaN or infinite values were dropped.
    NotFinite {
        /// The topic.
        topic: String,
        /// Number of messages.
        count: u64,
    },
    /// Messages whose stamp is not after the previous stamp were dropped.
    NotIncreasing {
        /// The topic.
        topic: String,
        /// Number of messages.
        count: u64,
    },
    /// Messages without a stamp were given their recording time.
    Unstamped {
        /// The topic.
        topic: String,
        /// Number of messages.
        count: u64,
    },
    /// Topics of the bag that do not belong to the run.
    TopicsLeft {
        /// Their names.
        topics: Vec<String>,
    },
    /// Topics that were read by their names, although displacement is mapped.
    TakenByName {
        /// Topic and channel of each.
        topics: Vec<String>,
    },
    /// No axis was given for a vector.
    AxisTaken {
        /// The topic.
        topic: String,
        /// The axis that was read.
        axis: String,
    },
    /// Force or drive are missing, and a topic of the bag may hold them.
    CouldServe {
        /// The flags that would map them.
        lines: Vec<String>,
    },
    /// No unit was given for a mapped column.
    UnitTaken {
        /// The column.
        column: String,
        /// The unit that was assumed.
        unit: &'static str,
        /// True if the unit is in the column's name.
        by_name: bool,
    },
    /// A column has the name of a channel that is mapped to another column.
    ColumnReplaced {
        /// The column.
        column: String,
        /// The channel.
        channel: &'static str,
    },
    /// The bag has no `metadata.yaml`, because the recorder was killed. Its files were read in the order of their names.
    NoMetadata {
        /// The bag.
        path: PathBuf,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RowsSkipped { count, first } => {
                write!(f, "{count} bad rows skipped; the first: {}", first.join(" | "))
            }
            Self::EmptyCells { column, count } => {
                write!(f, "column `{column}`: {count} empty cells taken as no sample")
            }
            Self::UnitUnknown { column, channel, known } => {
                write!(
                    f,
                    "column `{column}` is carried through but not used: known names are {known}; or say its \
                     unit, as in {}",
                    flag(channel, &format!("{column},unit=UNIT"))
                )
            }
            Self::CutShort { path, offset, messages, why } => {
                write!(f, "{}: read up to byte {offset}, {messages} messages; there: {why}", path.display())
            }
            Self::ChunkDamaged { path, offset, why } => {
                write!(f, "{}: chunk at byte {offset} left out: {why}", path.display())
            }
            Self::RowsDamaged { path, first: None, why, .. } => {
                write!(f, "{}: damaged, and read as far as possible: {why}", path.display())
            }
            Self::RowsDamaged { path, first: Some(first), last: Some(last), why } => {
                write!(f, "{}: messages {first} to {last} left out: {why}", path.display())
            }
            Self::RowsDamaged { path, first: Some(first), last: None, why } => {
                write!(f, "{}: messages from {first} on left out: {why}", path.display())
            }
            Self::FileLeft { why } => write!(f, "left out: {why}"),
            Self::PackedCutShort { path, bytes, why } => {
                write!(f, "{}: unpacked up to byte {bytes} of its content; there: {why}", path.display())
            }
            Self::Journal { path, journal } => write!(
                f,
                "{0}: its recorder left {0}{journal} (recording cut off, or still running?), which was read too",
                path.display()
            ),
            Self::Undecodable { topic, count, first } => {
                write!(f, "topic {topic}: {count} messages could not be decoded; the first: {first}")
            }
            Self::NotFinite { topic, count } => {
                write!(f, "topic {topic}: {count} messages with NaN or infinite values dropped")
            }
            Self::NotIncreasing { topic, count } => {
                write!(f, "topic {topic}: {count} messages dropped whose stamp is not after the one before")
            }
            Self::Unstamped { topic, count } => {
                write!(f, "topic {topic}: {count} messages without a stamp took their recording time")
            }
            Self::TopicsLeft { topics } => {
                write!(f, "not part of the run: {}", topics.join(", "))
            }
            Self::TakenByName { topics } => {
                write!(f, "read by name, without a map: {}", topics.join(", "))
            }
            Self::AxisTaken { topic, axis } => {
                write!(f, "topic {topic}: axis {axis} was taken; name another one as in {topic}:x")
            }
            Self::CouldServe { lines } => write!(f, "missing channels may be read with {}", lines.join(" ")),
            Self::UnitTaken { column, unit, by_name: true } => {
                write!(f, "column `{column}` is read in {unit}, by its name; give unit=... if that is wrong")
            }
            Self::UnitTaken { column, unit, by_name: false } => {
                write!(
                    f,
                    "column `{column}` is read in {unit}, as its name has no unit; give unit=... if that is wrong"
                )
            }
            Self::ColumnReplaced { column, channel } => {
                write!(f, "column `{column}` is left out, because {channel} is mapped to another one")
            }
            Self::NoMetadata { path } => write!(
                f,
                "{}: no metadata.yaml (recording cut off?); its files were read in order of name",
                path.display()
            ),
        }
    }
}
