//! The file of a bag that is being written, in either storage.

use super::RunError;
use super::bag_types::{BagOptions, Message, Storage, Topic};
use super::mcap_write::McapFile;
use super::sqlite_write::SqliteFile;
use std::path::Path;

/// The current file, in either storage.
pub(super) enum OpenFile {
    Mcap(Box<McapFile>),
    Sqlite(SqliteFile),
}

impl OpenFile {
    pub(super) fn create(path: &Path, options: &BagOptions) -> Result<Self, RunError> {
        match options.storage {
            Storage::Mcap => McapFile::create(path, options).map(Box::new).map(Self::Mcap),
            Storage::Sqlite3 => SqliteFile::create(path, options).map(Self::Sqlite),
        }
    }

    pub(super) fn topic(&mut self, topic: &Topic<'_>) -> Result<(), RunError> {
        match self {
            Self::Mcap(file) => file.topic(topic),
            Self::Sqlite(file) => file.topic(topic),
        }
    }

    pub(super) fn message(&mut self, message: &Message<'_>) -> Result<(), RunError> {
        match self {
            Self::Mcap(file) => file.message(message),
            Self::Sqlite(file) => file.message(message),
        }
    }

    pub(super) fn flush(&mut self) -> Result<(), RunError> {
        match self {
            Self::Mcap(file) => file.flush(),
            Self::Sqlite(file) => file.flush(),
        }
    }

    pub(super) fn bytes(&self) -> Result<u64, RunError> {
        match self {
            Self::Mcap(file) => file.bytes(),
            Self::Sqlite(file) => file.bytes(),
        }
    }

    /// Completes the file; nothing may be written after this.
    pub(super) fn finish(&mut self, metadata: String) -> Result<(), RunError> {
        match self {
            Self::Mcap(file) => file.finish(metadata),
            Self::Sqlite(file) => file.finish(&metadata),
        }
    }
}
