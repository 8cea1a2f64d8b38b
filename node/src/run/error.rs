//! What can go wrong with a run, and what was noted while reading one.

use super::map::flag;
use super::mcap::at;
use crate::error::advice;
use crate::extract::{Dimension, Unfit};
use std::fmt;
use std::path::PathBuf;

/// Why a run could not be read or written. Every message says what, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}{}", path.display(), advice(source.kind()))]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What was tried, as a verb: `open`, `read`, ...
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
        /// What it is instead.
        why: String,
    },
    /// SQLite cannot read or write a database, for another reason than its content.
    #[error("{}: cannot {action}: {why}", path.display())]
    Database {
        /// The file.
        path: PathBuf,
        /// What was tried, as a verb.
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
        /// What is wrong and what to do.
        why: String,
    },
    /// A value that is not a finite number.
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
        /// What is wrong with it.
        why: &'static str,
    },
    /// A row with too few or too many fields.
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
        /// Fields in the row.
        found: usize,
        /// Fields in the header.
        expected: usize,
        /// The first column without a value, or the first surplus value.
        hint: String,
    },
    /// Time that does not increase.
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
        /// The column of time.
        column: String,
        /// The time in seconds.
        value: String,
        /// The last accepted time, as exact decimal seconds.
        previous: String,
    },
    /// Dropping bad rows would drop most of the file.
    #[error(
        "{}: {skipped} bad rows against {kept} good ones, so this is not a run with a few faults; the first: \
         {first}",
        path.display()
    )]
    MostlyBad {
        /// The CSV file.
        path: PathBuf,
        /// Rows that were dropped.
        skipped: u64,
        /// Rows that were kept.
        kept: u64,
        /// The first fault.
        first: String,
    },
    /// Nothing to read or to write.
    #[error("{}: no sample of displacement; {hint}", path.display())]
    NoDisplacement {
        /// The run.
        path: PathBuf,
        /// What was found instead and what to do.
        hint: String,
    },
    /// Both kinds of drive were recorded.
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
    /// Several dampers in one bag.
    #[error(
        "{}: {what}: {}; choose one with --bag-namespace",
        path.display(), found.join(", ")
    )]
    Namespaces {
        /// The bag.
        path: PathBuf,
        /// The open choice.
        what: &'static str,
        /// The namespaces.
        found: Vec<String>,
    },
    /// A topic of a known name with a type that cannot stand for it.
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
        /// The types that would do.
        accepted: Box<str>,
        /// The flag that maps displacement to a topic, where one could serve.
        instead: Option<String>,
    },
    /// What `--map` says cannot be read from this run.
    #[error("{}: --map {map}: {why}", path.display())]
    Map {
        /// The run.
        path: PathBuf,
        /// The mapping.
        map: String,
        /// Why not.
        why: Box<MapFault>,
    },
    /// `metadata.yaml` cannot be used.
    #[error(
        "{}: {why}; `ros2 bag reindex` writes it anew, or name the .mcap or .db3 file itself",
        path.display()
    )]
    Metadata {
        /// The metadata file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A file that is not what its name or its beginning promises.
    #[error("{}: not {format}: {why}", path.display())]
    NotABag {
        /// The file.
        path: PathBuf,
        /// What it should be: `an MCAP file`, `a rosbag2 database`, ...
        format: &'static str,
        /// What it is instead.
        why: String,
    },
    /// Compression that this build does not read.
    #[error(
        "{}{}: compressed with `{name}`, which is not read (zstd and none are); convert it once with \
         `rosbags-convert --src BAG --dst OUT --dst-storage mcap` (from PyPI: rosbags) or `ros2 bag \
         convert`, and give OUT",
        path.display(), at(*offset)
    )]
    Compression {
        /// The file.
        path: PathBuf,
        /// Byte offset of the chunk; `None` when the whole file is meant.
        offset: Option<u64>,
        /// The compression's name.
        name: String,
    },
    /// The target exists.
    #[error("{}: exists already and is not overwritten; remove it or choose another name", path.display())]
    Exists {
        /// The target.
        path: PathBuf,
    },
    /// A path that no run can be written to.
    #[error(
        "{}: cannot tell what to write: name a .csv, .mcap or .db3 file, or a directory without extension for a \
         rosbag2 bag",
        path.display()
    )]
    Target {
        /// The target.
        path: PathBuf,
    },
    /// A run, topic or message that the format cannot hold.
    #[error("{}: cannot write {what}: {why}", path.display())]
    Unwritable {
        /// The target.
        path: PathBuf,
        /// The column or topic.
        what: String,
        /// Why not, and what to do.
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

/// Why a channel cannot be read from where it is mapped to.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapFault {
    /// The topic is not in the bag.
    #[error("topic {topic} is not in the bag{}; {topics}", did_you_mean(nearest))]
    NoTopic {
        /// The topic.
        topic: String,
        /// The one with the nearest name.
        nearest: Option<String>,
        /// Those that are.
        topics: String,
    },
    /// A column was named for a bag.
    #[error(
        "`{column}` is a column, and this run is a bag: name a topic, which begins with a slash; {topics}"
    )]
    ColumnOfBag {
        /// The source as given.
        column: String,
        /// The topics.
        topics: String,
    },
    /// Time was mapped for a bag.
    #[error("messages of a bag have their stamps: leave out the map of time, which is for CSV files")]
    TimeOfBag,
    /// The topic's type does not fit.
    #[error("{unfit}{}", instead.as_ref().map(|line| format!("; this bag has {line}")).unwrap_or_default())]
    Unfit {
        /// Why not.
        unfit: Unfit,
        /// The flag for a topic of this bag that fits.
        instead: Option<String>,
    },
    /// The joint is not in the messages.
    #[error("joint `{joint}` is not in the messages{}; joints are {}", did_you_mean(nearest), joints.join(", "))]
    NoJoint {
        /// The joint.
        joint: String,
        /// The one with the nearest name.
        nearest: Option<String>,
        /// Those that are.
        joints: Vec<String>,
    },
    /// The topic is there and empty.
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
        /// The first one's fault.
        fault: String,
    },
    /// Messages hold no number.
    #[error("none of the {messages} messages of {topic} has a finite value of it: map another topic")]
    NoValue {
        /// The topic.
        topic: String,
        /// How many there are.
        messages: u64,
    },
    /// Not in CDR.
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
        /// The one with the nearest name.
        nearest: Option<String>,
        /// Those that are.
        columns: String,
    },
    /// The column holds another quantity.
    #[error("column `{column}` holds a {found}, and {channel} is a {wanted}: map another column")]
    Quantity {
        /// The column.
        column: String,
        /// Its quantity, by its name.
        found: Dimension,
        /// The channel.
        channel: &'static str,
        /// The channel's quantity.
        wanted: Dimension,
    },
    /// One column is time and something else.
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
    /// An adapter for `map_err` on I/O results.
    pub(super) fn io(path: &std::path::Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, action, source }
    }
}

/// What the system said and what to do, which MCAP's library keeps to itself.
fn of_mcap(error: &::mcap::McapError) -> String {
    match error {
        ::mcap::McapError::Io(error) => format!(": {error}{}", advice(error.kind())),
        _ => String::new(),
    }
}

/// Something that the reader of a run should know, though the run was read.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Note {
    /// Bad rows of a CSV file were dropped, as asked.
    RowsSkipped {
        /// How many.
        count: u64,
        /// What was wrong with the first few.
        first: Vec<String>,
    },
    /// Empty cells were taken as "no sample of this channel at this time".
    EmptyCells {
        /// The column.
        column: String,
        /// How many.
        count: u64,
    },
    /// A column looks like a known quantity, but its unit is not known; it was carried and not used.
    UnitUnknown {
        /// The column.
        column: String,
        /// The channel that it looks like.
        channel: &'static str,
        /// Names that would be used.
        known: String,
    },
    /// A bag's file ended or broke before its end; all messages before that were read.
    CutShort {
        /// The file.
        path: PathBuf,
        /// Byte offset of the first record that could not be read; of a database, where the file ends.
        offset: u64,
        /// Messages read from the file, of all topics.
        messages: u64,
        /// What was found there.
        why: String,
    },
    /// A damaged chunk was passed over; reading went on behind it.
    ChunkDamaged {
        /// The file.
        path: PathBuf,
        /// Byte offset of the chunk.
        offset: u64,
        /// What is wrong with it.
        why: String,
    },
    /// Rows of a damaged database were passed over.
    RowsDamaged {
        /// The file.
        path: PathBuf,
        /// The first message that could not be read, by its id; `None` for rows that are no messages.
        first: Option<i64>,
        /// The last one; `None` when nothing behind could be read.
        last: Option<i64>,
        /// What is wrong.
        why: String,
    },
    /// A file of several is none of a bag; the others were read.
    FileLeft {
        /// Which, and what it is instead.
        why: String,
    },
    /// A packed file ended or broke before its end; what came out before that was read.
    PackedCutShort {
        /// The file.
        path: PathBuf,
        /// Bytes that came out.
        bytes: u64,
        /// What was found there.
        why: String,
    },
    /// A database whose recorder was killed has a journal beside it, which was taken into account.
    Journal {
        /// The database.
        path: PathBuf,
        /// What the journal's name has more than the database's.
        journal: &'static str,
    },
    /// Messages that could not be decoded were dropped.
    Undecodable {
        /// The topic.
        topic: String,
        /// How many.
        count: u64,
        /// The first one's fault.
        first: String,
    },
    /// Messages with NaN or infinite values were dropped.
    NotFinite {
        /// The topic.
        topic: String,
        /// How many.
        count: u64,
    },
    /// Messages whose stamp does not come after the one before were dropped.
    NotIncreasing {
        /// The topic.
        topic: String,
        /// How many.
        count: u64,
    },
    /// Messages without a stamp took the time at which they were recorded.
    Unstamped {
        /// The topic.
        topic: String,
        /// How many.
        count: u64,
    },
    /// Topics of the bag that are no part of the run.
    TopicsLeft {
        /// Their names.
        topics: Vec<String>,
    },
    /// Topics that were taken by their names, though displacement is mapped.
    TakenByName {
        /// Topic and channel of each.
        topics: Vec<String>,
    },
    /// No axis was named for a vector.
    AxisTaken {
        /// The topic.
        topic: String,
        /// The axis.
        axis: String,
    },
    /// Force or drive are missing, and a topic of the bag may hold them.
    CouldServe {
        /// The flags that would map them.
        lines: Vec<String>,
    },
    /// No unit was named for a mapped column.
    UnitTaken {
        /// The column.
        column: String,
        /// The unit.
        unit: &'static str,
        /// The column's name says so.
        by_name: bool,
    },
    /// A column that is called as a channel that is mapped to another one.
    ColumnReplaced {
        /// The column.
        column: String,
        /// The channel.
        channel: &'static str,
    },
    /// The bag has no usable `metadata.yaml`: the recorder was killed. Its files were read by name.
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
                write!(f, "{}: damaged, and read as far as it goes: {why}", path.display())
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
                "{0}: its recorder left {0}{journal} (recording cut off, or still on?), which was read with it",
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
                write!(f, "taken by name beside the map: {}", topics.join(", "))
            }
            Self::AxisTaken { topic, axis } => {
                write!(f, "topic {topic}: axis {axis} was taken; name another one as in {topic}:x")
            }
            Self::CouldServe { lines } => write!(f, "what is missing may be read with {}", lines.join(" ")),
            Self::UnitTaken { column, unit, by_name: true } => {
                write!(
                    f,
                    "column `{column}` is read in {unit}, by its name; say unit=... where that is wrong"
                )
            }
            Self::UnitTaken { column, unit, by_name: false } => {
                write!(
                    f,
                    "column `{column}` is read in {unit}, as its name has no unit; say unit=... where that is wrong"
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
