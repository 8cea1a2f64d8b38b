//! Writes rosbag2 bags: a directory with files of one storage and `metadata.yaml`.
//!
//! Messages are collected in a chunk until it is old or large enough; then the chunk is passed to the operating system. If
//! the process is killed, the bag holds everything up to the last chunk and can be read without repair, even without
//! `metadata.yaml`, which is written at the end. [`OpenFile`] writes the chunks of either storage.

use super::RunError;
use super::bag_file::OpenFile;
use super::bag_types::{BagOptions, Message, Storage, Topic};
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
use std::time::Instant;

/// A topic of a [`BagWriter`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(usize);

/// Summary of a written bag.
#[derive(Debug, Clone)]
#[must_use]
pub struct BagSummary {
    /// The bag's directory.
    pub path: PathBuf,
    /// Number of messages of each topic, in the order in which topics were added.
    pub topics: Vec<(String, u64)>,
    /// Number of files.
    pub files: usize,
    /// Their total size in bytes.
    pub bytes: u64,
}

struct TopicState {
    name: String,
    type_name: String,
    definition: String,
    type_hash: String,
    column: Option<String>,
    stands_for: Option<String>,
    /// Messages in all files.
    messages: u64,
    /// Messages in the files before the current one.
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

/// Where a bag is written.
enum Place {
    /// A directory, and the prefix of its file names.
    Directory(PathBuf, String),
    /// One file, without a bag directory and without `metadata.yaml`.
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

/// Writes one bag. If it is dropped without [`finish`](Self::finish), the files are readable, but `metadata.yaml` is missing.
pub struct BagWriter {
    place: Place,
    path: PathBuf,
    file: OpenFile,
    /// Content of the current file.
    entry: FileEntry,
    /// The files before it.
    finished: Vec<FileEntry>,
    /// Threads that bring these files to the disk, compress them if requested, and return their sizes in bytes.
    settling: Vec<JoinHandle<Result<u64, RunError>>>,
    options: BagOptions,
    topics: Vec<TopicState>,
    by_name: HashMap<String, TopicId>,
    /// Original names of remapped topics, by their new names.
    stand_for: HashMap<String, String>,
    /// Time at which the oldest message in memory was written, and the number of bytes in memory.
    waiting: Option<(Instant, usize)>,
    /// Size of the current file without the messages in memory.
    flushed_bytes: u64,
    /// Reused for encoding messages.
    buffer: Vec<u8>,
}

impl BagWriter {
    /// Creates the directory `dir` and the bag in it.
    ///
    /// # Errors
    /// When `dir` exists, as a directory or anything else, or cannot be created.
    pub fn create(dir: &Path, options: BagOptions) -> Result<Self, RunError> {
        // The name is written to metadata.yaml as plain text, so it only has characters without a meaning in YAML.
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

    /// Creates one file instead, which is not split and not compressed as a whole.
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

    /// Notes the original name of the topic `name`, which is added later. If both names are equal, nothing is noted.
    pub fn note_renamed(&mut self, name: &str, stands_for: &str) {
        if name != stands_for {
            self.stand_for.insert(name.to_owned(), stands_for.to_owned());
        }
    }

    /// Adds a topic, or returns the existing topic with that name.
    ///
    /// # Errors
    /// When the name or the type is not valid in ROS 2, the topic exists with another type, or the file cannot hold more.
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

    /// Writes one message, given as CDR with its 4-byte header, and passes the chunk to the operating system when it is due.
    /// The times are nanoseconds since the epoch: when the message was recorded, and when it was published.
    ///
    /// # Errors
    /// When a time is negative, which bags cannot hold, or the write fails. After a failed write every further call fails.
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

    /// Writes one message of a known type. The first message of a topic adds the topic.
    ///
    /// # Errors
    /// The errors of [`topic`](Self::topic) and [`write`](Self::write).
    pub fn write_message<M: mr_damper_msgs::Message>(
        &mut self,
        name: &str,
        message: &M,
        log_time_ns: i64,
        publish_time_ns: i64,
    ) -> Result<(), RunError> {
        let id = self.topic(&Topic::of::<M>(name))?;
        // The buffer is taken out and put back, so that its memory is reused.
        let mut buffer = std::mem::take(&mut self.buffer);
        let encoded = cdr::write_into(message, &mut buffer);
        let written = match encoded {
            Ok(()) => self.write(id, log_time_ns, publish_time_ns, &buffer),
            Err(error) => Err(self.unwritable(name, error.to_string())),
        };
        self.buffer = buffer;
        written
    }

    /// Passes the chunk to the operating system if it is old or large enough. A recorder must call this at least every
    /// [`BagOptions::chunk_max_age`], also while no message arrives.
    ///
    /// # Errors
    /// When the write fails.
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

    /// Ends the current chunk and passes it to the operating system.
    ///
    /// # Errors
    /// When the write fails.
    pub fn flush(&mut self) -> Result<(), RunError> {
        self.waiting = None;
        self.file.flush()?;
        if self.options.max_file_bytes.is_some() {
            self.flushed_bytes = self.file.bytes()?;
        }
        Ok(())
    }

    /// True if a message with this log time belongs in another file.
    fn is_full(&self, log_time: u64) -> bool {
        let Some((first, _)) = self.entry.bounds else { return false };
        let waiting = self.waiting.map_or(0, |(_, bytes)| bytes as u64);
        let long = u128::from(log_time.saturating_sub(first));
        self.options.max_file_bytes.is_some_and(|most| self.flushed_bytes + waiting >= most)
            || self.options.max_file_duration.is_some_and(|most| long >= most.as_nanos())
    }

    /// Completes the current file and starts another one with the same topics.
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
        // On a separate thread: the disk may take seconds, and the recorder must go on meanwhile.
        let (path, packs) = (self.path.clone(), self.options.packs());
        let settling =
            std::thread::Builder::new().name("bag-settling".into()).spawn(move || settle(&path, packs));
        self.settling.push(settling.map_err(RunError::io(&self.path, "start a thread to end"))?);
        Ok(())
    }

    fn written<'a>(&self, files: &'a [FileEntry], topics: Vec<TopicEntry<'a>>) -> Written<'a> {
        Written { storage: self.options.storage, packed: self.options.packs(), files, topics }
    }

    /// Completes the current file with its index and writes `metadata.yaml`. Everything is on the disk when this returns.
    ///
    /// # Errors
    /// When a write fails.
    pub fn finish(mut self) -> Result<BagSummary, RunError> {
        self.end_file()?;
        let mut bytes = 0;
        for settling in std::mem::take(&mut self.settling) {
            let why = || std::io::Error::other("the thread that completes the file panicked");
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

/// Brings a complete file to the disk, and compresses it if `packs`; returns its size on disk in bytes.
fn settle(path: &Path, packs: bool) -> Result<u64, RunError> {
    if packs {
        return pack_file(path);
    }
    let file = fs::File::open(path).map_err(RunError::io(path, "open"))?;
    file.sync_all().map_err(RunError::io(path, "write to disk"))?;
    Ok(file.metadata().map_err(RunError::io(path, "look at"))?.len())
}

/// The entry of a file in `metadata.yaml`, with the name that the file has when it is complete.
fn entry_of(path: &Path, options: &BagOptions) -> FileEntry {
    let path = if options.packs() { packed_name(path) } else { path.to_owned() };
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    FileEntry { name, bounds: None, messages: 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_msgs::Message as _;
    use mr_damper_msgs::standard::Float64;
    use std::time::Duration;

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
    fn invalid_targets_topics_types_and_times_are_refused() {
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
    fn chunks_are_flushed_by_age_and_by_size() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let length = |writer: &BagWriter| writer.file.bytes().expect("size");
        // By age: a single message waits, and is flushed without another message.
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
