//! Writing rosbag2 bags: one MCAP file and `metadata.yaml` in a directory of their own.
//!
//! The file is written in chunks that are complete when they reach the operating system, and never rewritten:
//! when the process is killed, the bag holds everything up to the last chunk and reads without repair (also
//! without `metadata.yaml`, which comes at the end).

use super::metadata::{self, TopicEntry, Written};
use super::names::{is_topic_name, is_type_name};
use super::{RunError, write_file};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions};
use mr_damper_msgs::{Message, cdr};
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How a bag is written.
#[derive(Debug, Clone)]
pub struct BagOptions {
    /// The longest time for which a message stays in memory before its chunk is handed to the operating
    /// system, as long as the writer is called: what a `SIGKILL` can cost at most.
    pub chunk_max_age: Duration,
    /// Size at which a chunk is handed over before its time, in bytes before compression.
    pub chunk_max_bytes: usize,
    /// Compress chunks with zstd.
    pub compress: bool,
    /// When data are forced to the disk.
    pub sync: Sync,
}

impl Default for BagOptions {
    /// One second, 1 MiB, zstd, and one sync at the end.
    fn default() -> Self {
        Self {
            chunk_max_age: Duration::from_secs(1),
            chunk_max_bytes: 1 << 20,
            compress: true,
            sync: Sync::AtEnd,
        }
    }
}

/// When written data are forced from the operating system's cache to the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sync {
    /// Once, in [`BagWriter::finish`]. A killed process loses at most the last chunk; a power cut may lose as
    /// much as the system holds back, typically 5 to 30 s. A chunk costs no wait for the disk.
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
}

impl<'a> Topic<'a> {
    /// A topic of one of our message types.
    #[must_use]
    pub fn of<M: Message>(name: &'a str) -> Self {
        Self { name, type_name: M::TYPE, definition: M::DEFINITION, type_hash: M::TYPE_HASH, column: None }
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
    /// Size of the MCAP file in bytes.
    pub bytes: u64,
}

struct TopicState {
    name: String,
    type_name: String,
    type_hash: String,
    channel: u16,
    messages: u64,
}

/// Writes one bag. Dropped without [`finish`](Self::finish), it leaves a readable MCAP file and no
/// `metadata.yaml`.
pub struct BagWriter {
    dir: PathBuf,
    file_name: String,
    path: PathBuf,
    writer: mcap::Writer<BufWriter<File>>,
    /// A second handle of the same file: the writer keeps its own to itself.
    file: File,
    options: BagOptions,
    topics: Vec<TopicState>,
    by_name: HashMap<String, TopicId>,
    /// When the oldest message that is still in memory came, and how many bytes wait.
    waiting: Option<(Instant, usize)>,
    bounds: Option<(u64, u64)>,
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
        let file_name = format!("bag_{}_0.mcap", stem.chars().map(harmless).collect::<String>());
        if let Some(parent) = dir.parent() {
            fs::create_dir_all(parent).map_err(RunError::io(parent, "create"))?;
        }
        fs::create_dir(dir).map_err(|error| match error.kind() {
            std::io::ErrorKind::AlreadyExists => RunError::Exists { path: dir.to_owned() },
            _ => RunError::io(dir, "create")(error),
        })?;
        let path = dir.join(&file_name);
        let file = File::create_new(&path).map_err(RunError::io(&path, "create"))?;
        let handle = file.try_clone().map_err(RunError::io(&path, "create"))?;
        let writer = WriteOptions::new()
            .profile("ros2")
            .library(concat!("mr-damper ", env!("CARGO_PKG_VERSION")))
            .compression(options.compress.then_some(Compression::Zstd))
            // Worker threads do not pay for chunks of this size.
            .compression_threads(0)
            // Chunks are ended here, by age and size, and put together in memory: the file only ever grows by
            // whole chunks.
            .chunk_size(None)
            .disable_seeking(true)
            .create(BufWriter::new(file))
            .map_err(|source| RunError::Write { path: path.clone(), source })?;
        Ok(Self {
            dir: dir.to_owned(),
            file_name,
            path,
            writer,
            file: handle,
            options,
            topics: Vec::new(),
            by_name: HashMap::new(),
            waiting: None,
            bounds: None,
            buffer: Vec::new(),
        })
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
        // rosbag2's own keys, and ours.
        let mut keys = BTreeMap::from([("offered_qos_profiles".into(), metadata::offered_qos().to_owned())]);
        if !topic.type_hash.is_empty() {
            keys.insert("topic_type_hash".into(), topic.type_hash.to_owned());
        }
        if let Some(column) = topic.column {
            keys.insert(COLUMN_KEY.into(), column.to_owned());
        }
        let schema = self.writer.add_schema(topic.type_name, "ros2msg", topic.definition.as_bytes());
        let channel = schema.and_then(|schema| self.writer.add_channel(schema, topic.name, "cdr", &keys));
        let channel = channel.map_err(|source| self.failed(source))?;
        let id = TopicId(self.topics.len());
        self.topics.push(TopicState {
            name: topic.name.to_owned(),
            type_name: topic.type_name.to_owned(),
            type_hash: topic.type_hash.to_owned(),
            channel,
            messages: 0,
        });
        self.by_name.insert(topic.name.to_owned(), id);
        Ok(id)
    }

    /// Writes one message, given as CDR with its 4-byte header, and hands the chunk to the system when it is
    /// due. Times are nanoseconds since the epoch: when the message was recorded, and when it was published.
    ///
    /// # Errors
    /// When a time is negative, which MCAP cannot hold, or the disk refuses. After a refusal the writer only
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
        let state = &mut self.topics[topic.0];
        // The sequence number is 32 bits wide and wraps.
        let sequence = state.messages as u32;
        let header = MessageHeader { channel_id: state.channel, sequence, log_time, publish_time };
        state.messages += 1;
        if let Err(source) = self.writer.write_to_known_channel(&header, cdr) {
            return Err(self.failed(source));
        }
        let (first, last) = self.bounds.unwrap_or((log_time, log_time));
        self.bounds = Some((first.min(log_time), last.max(log_time)));
        let (since, bytes) = self.waiting.unwrap_or_else(|| (Instant::now(), 0));
        self.waiting = Some((since, bytes + cdr.len()));
        self.flush_if_due()
    }

    /// Writes one message of our own types, adding its topic at the first.
    ///
    /// # Errors
    /// Those of [`topic`](Self::topic) and [`write`](Self::write).
    pub fn write_message<M: Message>(
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
        self.writer.flush().map_err(|source| self.failed(source))?;
        if self.options.sync == Sync::EveryChunk {
            self.file.sync_data().map_err(RunError::io(&self.path, "write to disk"))?;
        }
        Ok(())
    }

    /// Ends the file with its index and writes `metadata.yaml`; both are on the disk when this returns.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn finish(mut self) -> Result<BagSummary, RunError> {
        let topics = self.topics.iter().map(|topic| TopicEntry {
            name: &topic.name,
            type_name: &topic.type_name,
            type_hash: &topic.type_hash,
            messages: topic.messages,
        });
        let written = Written { file: &self.file_name, bounds: self.bounds, topics: topics.collect() };
        let text = written.file_text();
        // rosbag2 keeps a copy inside, so that the bare file can be opened too.
        let record = Metadata {
            name: "rosbag2".into(),
            metadata: BTreeMap::from([("serialized_metadata".into(), written.yaml(""))]),
        };
        let end = self.writer.write_metadata(&record).and_then(|()| self.writer.finish().map(|_| ()));
        end.map_err(|source| self.failed(source))?;
        self.file.sync_all().map_err(RunError::io(&self.path, "write to disk"))?;
        let bytes = self.file.metadata().map_err(RunError::io(&self.path, "look at"))?.len();
        let path = self.dir.join(metadata::FILE_NAME);
        write_file(&path, |sink| sink.write_all(text.as_bytes()).map_err(RunError::io(&path, "write")))?;
        let topics = self.topics.iter().map(|topic| (topic.name.clone(), topic.messages)).collect();
        Ok(BagSummary { path: self.dir.clone(), topics, bytes })
    }

    fn failed(&self, source: mcap::McapError) -> RunError {
        RunError::Write { path: self.path.clone(), source }
    }

    fn unwritable(&self, topic: &str, why: String) -> RunError {
        RunError::Unwritable { path: self.path.clone(), what: format!("topic {topic}"), why }
    }
}

/// Key of a channel's metadata that names the run's column.
pub(super) const COLUMN_KEY: &str = "mr_damper_column";

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_msgs::standard::Float64;

    const FLOAT: Topic<'static> = Topic {
        name: "/x",
        type_name: Float64::TYPE,
        definition: Float64::DEFINITION,
        type_hash: Float64::TYPE_HASH,
        column: None,
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
        let length = |writer: &BagWriter| writer.file.metadata().expect("size").len();
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
