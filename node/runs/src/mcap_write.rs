//! Writes one MCAP file of a bag.
//!
//! The file is written in chunks. A chunk is complete when it reaches the operating system, and it is never rewritten. If
//! the process is killed, the file holds everything up to the last chunk and can be read without repair.

use super::bag_types::{BagOptions, COLUMN_KEY, Message, Sync, TOPIC_KEY, Topic};
use super::{RunError, metadata};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions};
use mr_damper_base::provenance::TOOL;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// The file.
pub(super) struct McapFile {
    path: PathBuf,
    writer: mcap::Writer<BufWriter<File>>,
    /// A second handle of the same file, because the writer does not give access to its own.
    file: File,
    sync: Sync,
    /// Ids of the bag's topics in this file.
    channels: Vec<u16>,
}

impl McapFile {
    pub(super) fn create(path: &Path, options: &BagOptions) -> Result<Self, RunError> {
        let file = File::create_new(path).map_err(RunError::io(path, "create"))?;
        let handle = file.try_clone().map_err(RunError::io(path, "create"))?;
        let writer = WriteOptions::new()
            .profile("ros2")
            .library(TOOL)
            .compression(options.compress.then_some(Compression::Zstd))
            // For chunks of this size worker threads bring no gain.
            .compression_threads(0)
            // The caller ends chunks, by age and size. They are assembled in memory, so the file only grows by whole
            // chunks.
            .chunk_size(None)
            .disable_seeking(true)
            .create(BufWriter::new(file))
            .map_err(|source| RunError::Write { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), writer, file: handle, sync: options.sync, channels: Vec::new() })
    }

    /// Adds the bag's next topic.
    pub(super) fn topic(&mut self, topic: &Topic<'_>) -> Result<(), RunError> {
        // Keys of rosbag2 and keys of this project.
        let mut keys = BTreeMap::from([("offered_qos_profiles".into(), metadata::offered_qos().to_owned())]);
        if !topic.type_hash.is_empty() {
            keys.insert("topic_type_hash".into(), topic.type_hash.to_owned());
        }
        if let Some(column) = topic.column {
            keys.insert(COLUMN_KEY.into(), column.to_owned());
        }
        if let Some(name) = topic.stands_for {
            keys.insert(TOPIC_KEY.into(), name.to_owned());
        }
        let schema = self.writer.add_schema(topic.type_name, "ros2msg", topic.definition.as_bytes());
        let channel = schema.and_then(|schema| self.writer.add_channel(schema, topic.name, "cdr", &keys));
        self.channels.push(channel.map_err(|source| self.failed(source))?);
        Ok(())
    }

    pub(super) fn message(&mut self, message: &Message<'_>) -> Result<(), RunError> {
        let header = MessageHeader {
            channel_id: self.channels[message.topic],
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        self.writer.write_to_known_channel(&header, message.cdr).map_err(|source| self.failed(source))
    }

    /// Ends the current chunk and passes it to the operating system.
    pub(super) fn flush(&mut self) -> Result<(), RunError> {
        self.writer.flush().map_err(|source| self.failed(source))?;
        if self.sync == Sync::EveryChunk {
            self.file.sync_data().map_err(RunError::io(&self.path, "write to disk"))?;
        }
        Ok(())
    }

    /// Number of bytes that the operating system has so far.
    pub(super) fn bytes(&self) -> Result<u64, RunError> {
        Ok(self.file.metadata().map_err(RunError::io(&self.path, "look at"))?.len())
    }

    /// Completes the file with its index. `metadata` is the metadata of the bag.
    pub(super) fn finish(&mut self, metadata: String) -> Result<(), RunError> {
        // rosbag2 keeps a copy of the metadata in the file, so that the bare file can be opened too.
        let record = Metadata {
            name: "rosbag2".into(),
            metadata: BTreeMap::from([("serialized_metadata".into(), metadata)]),
        };
        let end = self.writer.write_metadata(&record).and_then(|()| self.writer.finish().map(|_| ()));
        end.map_err(|source| self.failed(source))
    }

    fn failed(&self, source: mcap::McapError) -> RunError {
        RunError::Write { path: self.path.clone(), source }
    }
}
