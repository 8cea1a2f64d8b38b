//! The interface between the readers of a bag's files, one for each storage, and the bag.

/// Description of a topic in a file.
pub(super) struct TopicInfo {
    pub(super) name: String,
    /// Empty if the file does not state it.
    pub(super) type_name: String,
    /// Encoding of its messages, such as `cdr`.
    pub(super) encoding: String,
    /// The run's column, if it differs from the topic's name.
    pub(super) column: Option<String>,
    /// The topic's original name, if the recorder remapped it.
    pub(super) stands_for: Option<String>,
}

/// Why the recording time of a message is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum LogTimeFault {
    /// It does not fit into 63 bits.
    #[error("log time {nanos} ns is out of range")]
    Range { nanos: u64 },
    /// The database row lacks it.
    #[error("row {row} has no time")]
    Absent { row: i64 },
}

/// Receives topics and messages of the files of a bag, in file order.
pub(super) trait Sink {
    /// A file begins. Topic ids are valid within one file.
    fn begin_file(&mut self);
    /// A topic and its id.
    fn topic(&mut self, id: i64, topic: TopicInfo);
    /// A message: the id of its topic, its recording time in nanoseconds (or why that is not known), and its bytes.
    fn message(&mut self, topic: i64, log_time: Result<i64, LogTimeFault>, data: &[u8]);
}
