//! Notes on a run that was read.

use super::map::flag;
use mr_damper_base::shown::count as counted;
use std::fmt;
use std::path::PathBuf;

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
    /// A column that nothing uses holds text, so it was left out.
    TextColumn {
        /// The column.
        column: String,
        /// Line of its first cell that is not empty.
        line: u64,
        /// The text of this cell.
        text: String,
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
    /// A log of a bus ended early or was damaged; what comes before was read.
    LogCutShort {
        /// The file.
        path: PathBuf,
        /// The place of the fault: a byte or a line.
        place: String,
        /// Number of frames or records before it.
        frames: u64,
        /// The fault.
        why: String,
    },
    /// The recorder did not finish an MDF4 file.
    LogUnfinished {
        /// The file.
        path: PathBuf,
    },
    /// Frames without a usable value of a signal were dropped.
    SignalDropped {
        /// The signal.
        signal: String,
        /// Number of frames.
        count: u64,
        /// What they have.
        what: &'static str,
    },
    /// Several channel groups of an MDF4 file have frames of a signal and do not name their bus. They were read as one bus.
    BusesUnnamed {
        /// The signal.
        signal: String,
        /// Number of groups.
        groups: usize,
    },
    /// Frames of a J1939 message came from several senders. The frames of the sender in the DBC file were read.
    OtherSenders {
        /// The signal.
        signal: String,
        /// The address of the sender in the DBC file.
        used: String,
        /// The addresses of the others.
        others: Vec<String>,
    },
    /// Frames of a log that cannot be used were dropped.
    FramesDropped {
        /// The file.
        path: PathBuf,
        /// Number of frames.
        count: u64,
        /// What they have.
        what: &'static str,
    },
    /// Frames whose time is not after the one before were dropped.
    SignalNotIncreasing {
        /// The signal.
        signal: String,
        /// Number of frames.
        count: u64,
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
    /// A topic of a bag whose messages are not played, because their type is not known.
    TypeUnknown {
        /// The topic.
        topic: String,
        /// Type and encoding.
        kind: String,
    },
    /// Topics of the bag that do not belong to the run.
    TopicsLeft {
        /// Their names.
        topics: Vec<String>,
    },
    /// Outputs of a node, such as estimates, which do not belong to a run. They are expected, so the note is not a warning.
    OutputsLeft {
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

impl Note {
    /// False if the note only says what is expected, as for a bag of our own recorder.
    #[must_use]
    pub const fn is_warning(&self) -> bool {
        !matches!(self, Self::OutputsLeft { .. })
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RowsSkipped { count, first } => {
                write!(f, "{} skipped; the first: {}", counted(*count, "bad row"), first.join(" | "))
            }
            Self::EmptyCells { column, count } => {
                write!(f, "column `{column}`: {} taken as no sample", counted(*count, "empty cell"))
            }
            Self::TextColumn { column, line, text } => {
                write!(f, "column `{column}` is left out: it holds text (line {line}: `{text}`)")
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
                write!(
                    f,
                    "{}: read up to byte {offset}, {}; there: {why}",
                    path.display(),
                    counted(*messages, "message")
                )
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
            Self::LogCutShort { path, place, frames, why } => {
                write!(
                    f,
                    "{}: read up to {place}, {}; there: {why}",
                    path.display(),
                    counted(*frames, "frame")
                )
            }
            Self::LogUnfinished { path } => write!(
                f,
                "{}: its recorder did not finish it (recording cut off?); its records were counted by the data",
                path.display()
            ),
            Self::SignalDropped { signal, count, what } => {
                write!(f, "signal {signal}: {} with {what} dropped", counted(*count, "frame"))
            }
            Self::BusesUnnamed { signal, groups } => write!(
                f,
                "signal {signal}: its frames are in {groups} groups of the file that do not name their bus, and were read as one bus; if \
                 they are of several buses, record them with BusChannel"
            ),
            Self::OtherSenders { signal, used, others } => write!(
                f,
                "signal {signal}: frames of address {used} were read, because the DBC file has it; others came from {}: name another one \
                 after @",
                others.join(", ")
            ),
            Self::FramesDropped { path, count, what } => {
                write!(f, "{}: {} with {what} dropped", path.display(), counted(*count, "frame"))
            }
            Self::SignalNotIncreasing { signal, count } => {
                write!(
                    f,
                    "signal {signal}: {} dropped whose time is not after the one before",
                    counted(*count, "frame")
                )
            }
            Self::Undecodable { topic, count, first } => {
                write!(
                    f,
                    "topic {topic}: {} could not be decoded; the first: {first}",
                    counted(*count, "message")
                )
            }
            Self::NotFinite { topic, count } => {
                write!(f, "topic {topic}: {} with NaN or infinite values dropped", counted(*count, "message"))
            }
            Self::NotIncreasing { topic, count } => {
                write!(
                    f,
                    "topic {topic}: {} dropped whose stamp is not after the one before",
                    counted(*count, "message")
                )
            }
            Self::Unstamped { topic, count } => {
                write!(
                    f,
                    "topic {topic}: {} without a stamp took the time of recording",
                    counted(*count, "message")
                )
            }
            Self::TypeUnknown { topic, kind } => {
                write!(f, "topic {topic} is left out: mr-damper has no definition of its type, {kind}")
            }
            Self::TopicsLeft { topics } => {
                write!(f, "not part of the run: {}", topics.join(", "))
            }
            Self::OutputsLeft { topics } => {
                write!(f, "outputs of the node do not belong to the run: {}", topics.join(", "))
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
