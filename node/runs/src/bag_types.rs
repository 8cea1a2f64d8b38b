//! Types of a bag that is being written: its storage and other options, its topics, and a message.

use std::path::Path;
use std::time::Duration;

/// Key in a channel's metadata for the name of the run's column.
pub(super) const COLUMN_KEY: &str = "mr_damper_column";
/// Key in a channel's metadata for the topic's original name, if the recorder remapped it.
pub(super) const TOPIC_KEY: &str = "mr_damper_topic";

/// Storage format of the files of a bag.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Storage {
    /// MCAP, the default of ROS 2 since Iron.
    #[default]
    Mcap,
    /// An SQLite database, the default before Iron.
    Sqlite3,
}

impl Storage {
    /// Its name in `metadata.yaml` and in `ros2 bag`.
    #[must_use]
    pub fn identifier(self) -> &'static str {
        match self {
            Self::Mcap => "mcap",
            Self::Sqlite3 => "sqlite3",
        }
    }

    pub(super) fn extension(self) -> &'static str {
        match self {
            Self::Mcap => "mcap",
            Self::Sqlite3 => "db3",
        }
    }

    pub(super) fn of_identifier(name: &str) -> Option<Self> {
        [Self::Mcap, Self::Sqlite3].into_iter().find(|storage| storage.identifier() == name)
    }

    /// The storage of a file, compressed or not, according to its name.
    pub(super) fn of_file(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let (_, extension) = name.strip_suffix(".zstd").unwrap_or(&name).rsplit_once('.')?;
        [Self::Mcap, Self::Sqlite3].into_iter().find(|storage| storage.extension() == extension)
    }
}

/// How a bag is written.
#[derive(Debug, Clone)]
pub struct BagOptions {
    /// Storage format of its files.
    pub storage: Storage,
    /// Longest time for which a message stays in memory before its chunk is passed to the operating system, provided that
    /// the writer is called often enough. A `SIGKILL` loses at most this much.
    pub chunk_max_age: Duration,
    /// Size at which a chunk is passed on before it reaches that age, in bytes before compression.
    pub chunk_max_bytes: usize,
    /// Compress with zstd: in MCAP each chunk, in sqlite3 each complete file (mode `FILE`).
    pub compress: bool,
    /// When data are forced to the disk.
    pub sync: Sync,
    /// Size on disk at which another file is started, in bytes before files are compressed. A file with its index may be a
    /// little larger; it holds at least one message.
    pub max_file_bytes: Option<u64>,
    /// Duration in log time after which another file is started.
    pub max_file_duration: Option<Duration>,
}

impl Default for BagOptions {
    /// MCAP in one file, one second, 1 MiB, zstd, and one sync at the end.
    fn default() -> Self {
        Self {
            storage: Storage::Mcap,
            chunk_max_age: Duration::from_secs(1),
            chunk_max_bytes: 1 << 20,
            compress: true,
            sync: Sync::AtEnd,
            max_file_bytes: None,
            max_file_duration: None,
        }
    }
}

impl BagOptions {
    /// The same options for another storage. If the storage changes, `compress` gets its default for that storage: true for
    /// MCAP, false for sqlite3, which can be compressed only after the file is complete.
    #[must_use]
    pub fn stored(self, storage: Storage) -> Self {
        let compress = if self.storage == storage { self.compress } else { storage == Storage::Mcap };
        Self { storage, compress, ..self }
    }

    /// True if whole files are compressed.
    pub(super) fn packs(&self) -> bool {
        self.storage == Storage::Sqlite3 && self.compress
    }
}

/// When written data are forced from the operating system's cache to the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sync {
    /// Once, in [`BagWriter::finish`](super::BagWriter::finish). A killed process loses at most the last chunk. A power failure may lose the data that
    /// the system has not written yet, typically 5 to 30 s. Writing a chunk does not wait for the disk, except in sqlite3
    /// about every 4 MB, when the log is merged.
    AtEnd,
    /// After every chunk, so that also a power failure loses at most the last chunk. Writing a chunk waits for the disk:
    /// some milliseconds on flash, tens of milliseconds on a loaded disk. Call the writer on a thread that may wait.
    EveryChunk,
}

/// A topic to write.
#[derive(Debug, Clone, Copy)]
pub struct Topic<'a> {
    /// Absolute name, such as `/front_left/displacement`.
    pub name: &'a str,
    /// ROS type, such as `mr_damper_msgs/msg/Displacement`.
    pub type_name: &'a str,
    /// Definition in `ros2msg` form: the `.msg` text, then each type that it uses after a line of 80 `=` and a line
    /// `MSG: package/Name`.
    pub definition: &'a str,
    /// Hash of the type's description (`RIHS01_...`), or empty if it is not known.
    pub type_hash: &'a str,
    /// The run's column, if it differs from the topic's name; stored in the channel's metadata.
    pub column: Option<&'a str>,
    /// The topic's original name, such as `/front_left/displacement`, if it was remapped. It is stored with the topic, which
    /// is then read under that name.
    pub stands_for: Option<&'a str>,
}

impl<'a> Topic<'a> {
    /// A topic of one of our message types.
    #[must_use]
    pub fn of<M: mr_damper_msgs::Message>(name: &'a str) -> Self {
        let (type_name, definition, type_hash) = (M::TYPE, M::DEFINITION, M::TYPE_HASH);
        Self { name, type_name, definition, type_hash, column: None, stands_for: None }
    }
}

/// A message to write.
pub(super) struct Message<'a> {
    /// Index of its topic in the bag.
    pub(super) topic: usize,
    pub(super) sequence: u32,
    pub(super) log_time: u64,
    pub(super) publish_time: u64,
    pub(super) cdr: &'a [u8],
}
