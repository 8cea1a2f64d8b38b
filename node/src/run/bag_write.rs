//! Writing rosbag2 bags: files of one storage, and `metadata.yaml`, in a directory of their own.
//!
//! Messages wait in a chunk until that is old or big enough; then the operating system has them. When the
//! process is killed, the bag holds everything up to the last chunk and reads without repair (also without
//! `metadata.yaml`, which comes at the end). How a chunk becomes durable is the storage's affair:
//! [`OpenFile`].

use super::RunError;
use super::bag_file::{Message, OpenFile};
use super::metadata::{self, FileEntry, TopicEntry, Written};
use super::names::{is_topic_name, is_type_name};
use super::pack::{pack_file, packed_name};
use super::whole::write_file;
use mr_damper_msgs::cdr;
use std::collections::HashMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What the files of a bag are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Storage {
    /// MCAP, the default of ROS 2 since Iron.
    #[default]
    Mcap,
    /// An SQLite database, the default before that.
    Sqlite3,
}

impl Storage {
    /// The name that `metadata.yaml` and `ros2 bag` have for it.
    #[must_use]
    pub fn identifier(self) -> &'static str {
        match self {
            Self::Mcap => "mcap",
            Self::Sqlite3 => "sqlite3",
        }
    }

    fn extension(self) -> &'static str {
        match self {
            Self::Mcap => "mcap",
            Self::Sqlite3 => "db3",
        }
    }

    pub(super) fn of_identifier(name: &str) -> Option<Self> {
        [Self::Mcap, Self::Sqlite3].into_iter().find(|storage| storage.identifier() == name)
    }

    /// The storage of a file by its name, packed or not.
    pub(super) fn of_file(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let (_, extension) = name.strip_suffix(".zstd").unwrap_or(&name).rsplit_once('.')?;
        [Self::Mcap, Self::Sqlite3].into_iter().find(|storage| storage.extension() == extension)
    }
}

/// How a bag is written.
#[derive(Debug, Clone)]
pub struct BagOptions {
    /// What its files are.
    pub storage: Storage,
    /// The longest time for which a message stays in memory before its chunk is handed to the operating
    /// system, as long as the writer is called: what a `SIGKILL` can cost at most.
    pub chunk_max_age: Duration,
    /// Size at which a chunk is handed over before its time, in bytes before compression.
    pub chunk_max_bytes: usize,
    /// Compress with zstd: chunks of MCAP, whole files of sqlite3 once they are complete (mode `FILE`).
    pub compress: bool,
    /// When data are forced to the disk.
    pub sync: Sync,
    /// Size at which another file is begun, in bytes as they lie on the disk before files are packed. A file with
    /// its index may be a little larger; it holds one message at least.
    pub max_file_bytes: Option<u64>,
    /// Duration of log times after which another file is begun.
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
    /// The same for another storage. A database is not packed then, which would have to wait for its end.
    #[must_use]
    pub fn stored(self, storage: Storage) -> Self {
        let compress = if self.storage == storage { self.compress } else { storage == Storage::Mcap };
        Self { storage, compress, ..self }
    }

    /// Files are packed as a whole.
    fn packs(&self) -> bool {
        self.storage == Storage::Sqlite3 && self.compress
    }
}

/// When written data are forced from the operating system's cache to the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sync {
    /// Once, in [`BagWriter::finish`]. A killed process loses at most the last chunk; a power cut may lose as
    /// much as the system holds back, typically 5 to 30 s. A chunk costs no wait for the disk (in sqlite3: but for
    /// one in about 4 MB, when its log is merged).
    AtEnd,
    /// After every chunk. A power cut, too, loses at most the last chunk. A chunk waits for the disk, some
    /// milliseconds on flash and tens of them on a loaded disk: call the writer on a thread that may wait.
    EveryChunk,
}

/// A topic to be written.
#[derive(Debug, Clone, Copy)]
pub struct Topic<'a> {
    /// Absolute name, such as `/front_left/displacement`.
    pub name: &'a str,
    /// ROS type, such as `mr_damper_msgs/msg/Displacement`.
    pub type_name: &'a str,
    /// Definition in `ros2msg` form: the `.msg` text, then each type it uses after a line of 80 `=` and a
    /// line `MSG: package/Name`.
    pub definition: &'a str,
    /// Hash of the type's description (`RIHS01_...`), or empty when it is not known.
    pub type_hash: &'a str,
    /// The run's column behind the topic, where the topic's name cannot say it; kept in the channel's
    /// metadata.
    pub column: Option<&'a str>,
    /// What the topic would be called without a renaming, where it was renamed: `/front_left/displacement`. Kept beside the
    /// topic, so that it is read as that.
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

/// A topic of a [`BagWriter`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(usize);

/// What was written.
#[derive(Debug, Clone)]
#[must_use]
pub struct BagSummary {
    /// The bag's directory.
    pub path: PathBuf,
    /// Messages, by topic in the order of their first mention.
    pub topics: Vec<(String, u64)>,
    /// How many files it has.
    pub files: usize,
    /// Their size in bytes.
    pub bytes: u64,
}

struct TopicState {
    name: String,
    type_name: String,
    definition: String,
    type_hash: String,
    column: Option<String>,
    stands_for: Option<String>,
    /// Messages in all files, and in those before the one at hand.
    messages: u64,
    before: u64,
}

impl TopicState {
    fn new(topic: &Topic<'_>) -> Self {
        Self {
            name: topic.name.to_owned(),
            type_name: topic.type_name.to_owned(),
            definition: topic.definition.to_owned(),
            type_hash: topic.type_hash.to_owned(),
            column: topic.column.map(str::to_owned),
            stands_for: topic.stands_for.map(str::to_owned),
            messages: 0,
            before: 0,
        }
    }

    fn entry(&self, messages: u64) -> TopicEntry<'_> {
        TopicEntry { name: &self.name, type_name: &self.type_name, type_hash: &self.type_hash, messages }
    }
}

/// Where a bag goes.
enum Place {
    /// A directory, and what its files' names begin with.
    Directory(PathBuf, String),
    /// One file, without a directory of its own and without `metadata.yaml`.
    File(PathBuf),
}

impl Place {
    fn file(&self, number: usize, storage: Storage) -> PathBuf {
        match self {
            Self::Directory(dir, stem) => dir.join(format!("{stem}_{number}.{}", storage.extension())),
            Self::File(path) => path.clone(),
        }
    }
}

/// Writes one bag. Dropped without [`finish`](Self::finish), it leaves readable files and no `metadata.yaml`.
pub struct BagWriter {
    place: Place,
    path: PathBuf,
    file: OpenFile,
    /// What the file at hand holds.
    entry: FileEntry,
    /// Files before it, and those who bring them to the disk, packed or not, and tell their sizes.
    finished: Vec<FileEntry>,
    settling: Vec<JoinHandle<Result<u64, RunError>>>,
    options: BagOptions,
    topics: Vec<TopicState>,
    by_name: HashMap<String, TopicId>,
    /// What renamed topics would be called without that, by their names.
    stand_for: HashMap<String, String>,
    /// When the oldest message that is still in memory came, and how many bytes wait.
    waiting: Option<(Instant, usize)>,
    /// Size of the file at hand without what waits.
    flushed_bytes: u64,
    /// For encoding messages.
    buffer: Vec<u8>,
}

impl BagWriter {
    /// Creates the directory `dir` and the bag in it.
    ///
    /// # Errors
    /// When `dir` exists, in whatever form, or cannot be made.
    pub fn create(dir: &Path, options: BagOptions) -> Result<Self, RunError> {
        // The name goes into metadata.yaml as plain text, so it keeps to harmless characters.
        let stem = dir.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        let harmless = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '.' | '-') { c } else { '_' };
        let stem = format!("bag_{}", stem.chars().map(harmless).collect::<String>());
        if let Some(parent) = dir.parent() {
            fs::create_dir_all(parent).map_err(RunError::io(parent, "create"))?;
        }
        fs::create_dir(dir).map_err(|error| match error.kind() {
            std::io::ErrorKind::AlreadyExists => RunError::Exists { path: dir.to_owned() },
            _ => RunError::io(dir, "create")(error),
        })?;
        Self::begin(Place::Directory(dir.to_owned(), stem), options)
    }

    /// Creates one file instead, which is neither split nor packed.
    pub(super) fn create_file(path: &Path, options: BagOptions) -> Result<Self, RunError> {
        let compress = options.compress && !options.packs();
        let options = BagOptions { max_file_bytes: None, max_file_duration: None, compress, ..options };
        Self::begin(Place::File(path.to_owned()), options)
    }

    fn begin(place: Place, options: BagOptions) -> Result<Self, RunError> {
        let path = place.file(0, options.storage);
        let file = OpenFile::create(&path, &options)?;
        Ok(Self {
            entry: entry_of(&path, &options),
            place,
            path,
            file,
            finished: Vec::new(),
            settling: Vec::new(),
            options,
            topics: Vec::new(),
            by_name: HashMap::new(),
            stand_for: HashMap::new(),
            waiting: None,
            flushed_bytes: 0,
            buffer: Vec::new(),
        })
    }

    /// Says what the topic `name`, which comes later, would be called without a renaming; nothing where it is called so.
    pub fn note_renamed(&mut self, name: &str, stands_for: &str) {
        if name != stands_for {
            self.stand_for.insert(name.to_owned(), stands_for.to_owned());
        }
    }

    /// Adds a topic, or finds it again by its name.
    ///
    /// # Errors
    /// When the name or the type is not one of ROS 2, or the file cannot hold more.
    pub fn topic(&mut self, topic: &Topic<'_>) -> Result<TopicId, RunError> {
        if let Some(&id) = self.by_name.get(topic.name) {
            if self.topics[id.0].type_name != topic.type_name {
                let why = format!("it is in the bag with type {} already", self.topics[id.0].type_name);
                return Err(self.unwritable(topic.name, why));
            }
            return Ok(id);
        }
        if !is_topic_name(topic.name) {
            let why = "not an absolute ROS 2 topic name, as in /front_left/displacement".to_owned();
            return Err(self.unwritable(topic.name, why));
        }
        if !is_type_name(topic.type_name) {
            let why = format!("`{}` is not a ROS 2 type, as in std_msgs/msg/Float64", topic.type_name);
            return Err(self.unwritable(topic.name, why));
        }
        let stands_for = topic.stands_for.or_else(|| self.stand_for.get(topic.name).map(String::as_str));
        let topic = &Topic { stands_for, ..*topic };
        self.file.topic(topic)?;
        let id = TopicId(self.topics.len());
        self.topics.push(TopicState::new(topic));
        self.by_name.insert(topic.name.to_owned(), id);
        Ok(id)
    }

    /// Writes one message, given as CDR with its 4-byte header, and hands the chunk to the system when it is
    /// due. Times are nanoseconds since the epoch: when the message was recorded, and when it was published.
    ///
    /// # Errors
    /// When a time is negative, which bags cannot hold, or the disk refuses. After a refusal the writer only
    /// repeats it.
    pub fn write(
        &mut self,
        topic: TopicId,
        log_time_ns: i64,
        publish_time_ns: i64,
        cdr: &[u8],
    ) -> Result<(), RunError> {
        let (Ok(log_time), Ok(publish_time)) = (u64::try_from(log_time_ns), u64::try_from(publish_time_ns))
        else {
            let why = format!(
                "time {} s is negative, and bags count from 1970 on: shift the run's times",
                super::decimal::seconds_text(log_time_ns.min(publish_time_ns))
            );
            return Err(self.unwritable(&self.topics[topic.0].name, why));
        };
        if self.is_full(log_time) {
            self.split()?;
        }
        let state = &mut self.topics[topic.0];
        // The sequence number is 32 bits wide and wraps.
        let sequence = state.messages as u32;
        state.messages += 1;
        self.entry.messages += 1;
        self.file.message(&Message { topic: topic.0, sequence, log_time, publish_time, cdr })?;
        let (first, last) = self.entry.bounds.unwrap_or((log_time, log_time));
        self.entry.bounds = Some((first.min(log_time), last.max(log_time)));
        let (since, bytes) = self.waiting.unwrap_or_else(|| (Instant::now(), 0));
        self.waiting = Some((since, bytes + cdr.len()));
        self.flush_if_due()
    }

    /// Writes one message of our own types, adding its topic at the first.
    ///
    /// # Errors
    /// Those of [`topic`](Self::topic) and [`write`](Self::write).
    pub fn write_message<M: mr_damper_msgs::Message>(
        &mut self,
        name: &str,
        message: &M,
        log_time_ns: i64,
        publish_time_ns: i64,
    ) -> Result<(), RunError> {
        let id = self.topic(&Topic::of::<M>(name))?;
        // Taken out and put back, so that its memory is reused.
        let mut buffer = std::mem::take(&mut self.buffer);
        let encoded = cdr::write_into(message, &mut buffer);
        let written = match encoded {
            Ok(()) => self.write(id, log_time_ns, publish_time_ns, &buffer),
            Err(error) => Err(self.unwritable(name, error.to_string())),
        };
        self.buffer = buffer;
        written
    }

    /// Hands the chunk to the system when it is old or big enough. A recorder calls this also when no message
    /// comes, at least every [`BagOptions::chunk_max_age`].
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn flush_if_due(&mut self) -> Result<(), RunError> {
        match self.waiting {
            Some((since, bytes))
                if bytes >= self.options.chunk_max_bytes || since.elapsed() >= self.options.chunk_max_age =>
            {
                self.flush()
            }
            _ => Ok(()),
        }
    }

    /// Ends the chunk at hand and hands it to the system.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn flush(&mut self) -> Result<(), RunError> {
        self.waiting = None;
        self.file.flush()?;
        if self.options.max_file_bytes.is_some() {
            self.flushed_bytes = self.file.bytes()?;
        }
        Ok(())
    }

    /// Whether a message of this time belongs into another file.
    fn is_full(&self, log_time: u64) -> bool {
        let Some((first, _)) = self.entry.bounds else { return false };
        let waiting = self.waiting.map_or(0, |(_, bytes)| bytes as u64);
        let long = u128::from(log_time.saturating_sub(first));
        self.options.max_file_bytes.is_some_and(|most| self.flushed_bytes + waiting >= most)
            || self.options.max_file_duration.is_some_and(|most| long >= most.as_nanos())
    }

    /// Ends the file at hand and begins another one with the same topics.
    fn split(&mut self) -> Result<(), RunError> {
        self.end_file()?;
        self.path = self.place.file(self.finished.len(), self.options.storage);
        self.file = OpenFile::create(&self.path, &self.options)?;
        self.entry = entry_of(&self.path, &self.options);
        for topic in &self.topics {
            let TopicState { name, type_name, definition, type_hash, column, stands_for, .. } = topic;
            let (column, stands_for) = (column.as_deref(), stands_for.as_deref());
            self.file.topic(&Topic { name, type_name, definition, type_hash, column, stands_for })?;
        }
        Ok(())
    }

    fn end_file(&mut self) -> Result<(), RunError> {
        let topics = self.topics.iter().map(|topic| topic.entry(topic.messages - topic.before)).collect();
        let entry = self.entry.clone();
        let metadata = self.written(std::slice::from_ref(&entry), topics).yaml("");
        self.file.finish(metadata)?;
        for topic in &mut self.topics {
            topic.before = topic.messages;
        }
        self.finished.push(entry);
        self.waiting = None;
        self.flushed_bytes = 0;
        // On a thread of its own: the disk may take seconds, and a recorder has more to do meanwhile.
        let (path, packs) = (self.path.clone(), self.options.packs());
        let settling =
            std::thread::Builder::new().name("bag-settling".into()).spawn(move || settle(&path, packs));
        self.settling.push(settling.map_err(RunError::io(&self.path, "start a thread to end"))?);
        Ok(())
    }

    fn written<'a>(&self, files: &'a [FileEntry], topics: Vec<TopicEntry<'a>>) -> Written<'a> {
        Written { storage: self.options.storage, packed: self.options.packs(), files, topics }
    }

    /// Ends the file at hand with its index and writes `metadata.yaml`; all is on the disk when this returns.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn finish(mut self) -> Result<BagSummary, RunError> {
        self.end_file()?;
        let mut bytes = 0;
        for settling in std::mem::take(&mut self.settling) {
            let why = || std::io::Error::other("the thread that did it panicked");
            bytes += settling.join().map_err(|_| RunError::io(&self.path, "end")(why()))??;
        }
        let topics = self.topics.iter().map(|topic| topic.entry(topic.messages)).collect();
        let text = self.written(&self.finished, topics).file_text();
        let path = match &self.place {
            Place::Directory(dir, _) => {
                let path = dir.join(metadata::FILE_NAME);
                write_file(&path, |sink| {
                    sink.write_all(text.as_bytes()).map_err(RunError::io(&path, "write"))
                })?;
                dir
            }
            Place::File(path) => path,
        };
        let topics = self.topics.iter().map(|topic| (topic.name.clone(), topic.messages)).collect();
        Ok(BagSummary { path: path.clone(), topics, files: self.finished.len(), bytes })
    }

    fn unwritable(&self, topic: &str, why: String) -> RunError {
        RunError::Unwritable { path: self.path.clone(), what: format!("topic {topic}"), why }
    }
}

/// Brings a file that is complete to the disk, packed or not; returns its size there.
fn settle(path: &Path, packs: bool) -> Result<u64, RunError> {
    if packs {
        return pack_file(path);
    }
    let file = fs::File::open(path).map_err(RunError::io(path, "open"))?;
    file.sync_all().map_err(RunError::io(path, "write to disk"))?;
    Ok(file.metadata().map_err(RunError::io(path, "look at"))?.len())
}

/// What `metadata.yaml` will say of a file, by its name when it is complete.
fn entry_of(path: &Path, options: &BagOptions) -> FileEntry {
    let path = if options.packs() { packed_name(path) } else { path.to_owned() };
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    FileEntry { name, bounds: None, messages: 0 }
}

/// Key of a channel's metadata that names the run's column.
pub(super) const COLUMN_KEY: &str = "mr_damper_column";
/// Key of a channel's metadata with what its topic would be called without the recorder's renaming.
pub(super) const TOPIC_KEY: &str = "mr_damper_topic";

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_msgs::Message as _;
    use mr_damper_msgs::standard::Float64;

    const FLOAT: Topic<'static> = Topic {
        name: "/x",
        type_name: Float64::TYPE,
        definition: Float64::DEFINITION,
        type_hash: Float64::TYPE_HASH,
        column: None,
        stands_for: None,
    };

    fn create(dir: &Path, options: BagOptions) -> BagWriter {
        BagWriter::create(dir, options).expect("created")
    }

    #[test]
    fn refuses_what_it_cannot_write() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let bag = dir.path().join("bag");
        let mut writer = create(&bag, BagOptions::default());
        let again = BagWriter::create(&bag, BagOptions::default()).err().expect("refused").to_string();
        assert!(
            again.ends_with("bag: exists already and is not overwritten; remove it or choose another name")
        );
        let error = |result: Result<TopicId, RunError>| result.expect_err("refused").to_string();
        assert!(
            error(writer.topic(&Topic { name: "x y", ..FLOAT })).contains("topic x y: not an absolute ROS 2")
        );
        assert!(
            error(writer.topic(&Topic { type_name: "Float64", ..FLOAT }))
                .contains("`Float64` is not a ROS 2")
        );
        let id = writer.topic(&FLOAT).expect("added");
        assert_eq!(writer.topic(&FLOAT).expect("found again"), id);
        let other = Topic { type_name: "std_msgs/msg/Int8", ..FLOAT };
        assert!(error(writer.topic(&other)).contains("with type std_msgs/msg/Float64 already"));
        let negative = writer.write(id, -1_500_000_000, 0, &[]).expect_err("refused").to_string();
        assert!(negative.contains("topic /x: time -1.5 s is negative"), "{negative}");
    }

    #[test]
    fn chunks_leave_by_age_and_by_size() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let length = |writer: &BagWriter| writer.file.bytes().expect("size");
        // By age: a message alone waits, and leaves without another one.
        let options = BagOptions { chunk_max_age: Duration::from_millis(30), ..BagOptions::default() };
        let mut writer = create(&dir.path().join("age"), options);
        let id = writer.topic(&FLOAT).expect("added");
        writer.write(id, 1, 1, &[0; 12]).expect("written");
        let before = length(&writer);
        std::thread::sleep(Duration::from_millis(40));
        writer.flush_if_due().expect("flushed");
        assert!(length(&writer) > before);
        // By size.
        let options = BagOptions { chunk_max_bytes: 24, compress: false, ..BagOptions::default() };
        let mut writer = create(&dir.path().join("size"), options);
        let id = writer.topic(&FLOAT).expect("added");
        writer.write(id, 1, 1, &[0; 12]).expect("written");
        let before = length(&writer);
        writer.write(id, 2, 2, &[0; 12]).expect("written");
        assert!(length(&writer) > before);
    }
}
