//! Writes one sqlite3 file of a bag, with rosbag2's schema 4 (Iron to Jazzy).
//!
//! Messages are collected in memory and written together in one transaction. The database uses a write-ahead log: a
//! committed transaction survives the end of the process, and an uncommitted one leaves no trace. The log is a second file
//! next to the database and is part of it until it is merged at the end.

use super::bag_types::{BagOptions, Message, Sync, Topic};
use super::sqlite::{COLUMNS_TABLE, TOPICS_TABLE};
use super::{RunError, metadata};
use mr_damper_base::disk::advice;
use rusqlite::{Connection, ErrorCode, OpenFlags, params};
use std::fs::File;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Tables and index, as in rosbag2.
const SCHEMA: &str = "
    CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
    CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
        serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
        type_description_hash TEXT NOT NULL);
    CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
        encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
        data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);";
const SCHEMA_VERSION: u32 = 4;

/// A message that waits for its transaction.
struct Waiting {
    /// Id of its topic in the file.
    topic: i64,
    log_time: i64,
    /// Range of its bytes in the data buffer.
    data: Range<usize>,
}

/// The file.
pub(super) struct SqliteFile {
    path: PathBuf,
    connection: Connection,
    waiting: Vec<Waiting>,
    data: Vec<u8>,
    /// Types whose definitions are in the file.
    types: Vec<String>,
    topics: i64,
}

impl SqliteFile {
    pub(super) fn create(path: &Path, options: &BagOptions) -> Result<Self, RunError> {
        // SQLite treats an empty file as a new database.
        File::create_new(path).map_err(RunError::io(path, "create"))?;
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let create = || {
            let connection = Connection::open_with_flags(path, flags)?;
            // `NORMAL` waits for the disk only when the log is merged, `FULL` after every transaction.
            let synchronous = if options.sync == Sync::EveryChunk { "FULL" } else { "NORMAL" };
            connection.execute_batch(&format!(
                "PRAGMA journal_mode=WAL; PRAGMA synchronous={synchronous}; BEGIN; {SCHEMA} COMMIT;"
            ))?;
            connection.execute(
                "INSERT INTO schema (schema_version, ros_distro) VALUES (?1, ?2)",
                params![SCHEMA_VERSION, metadata::ROS_DISTRO],
            )?;
            Ok(connection)
        };
        let connection = create().map_err(|error| failed(path, &error))?;
        let (waiting, data, types) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { path: path.to_owned(), connection, waiting, data, types, topics: 0 })
    }

    /// Adds the bag's next topic.
    pub(super) fn topic(&mut self, topic: &Topic<'_>) -> Result<(), RunError> {
        self.topics += 1;
        let id = self.topics;
        let new_type = !self.types.iter().any(|known| known == topic.type_name);
        let add = || {
            let transaction = self.connection.unchecked_transaction()?;
            transaction.execute(
                "INSERT INTO topics (id, name, type, serialization_format, offered_qos_profiles, \
                 type_description_hash) VALUES (?1, ?2, ?3, 'cdr', ?4, ?5)",
                params![id, topic.name, topic.type_name, metadata::offered_qos(), topic.type_hash],
            )?;
            if new_type {
                transaction.execute(
                    "INSERT INTO message_definitions (topic_type, encoding, encoded_message_definition, \
                     type_description_hash) VALUES (?1, 'ros2msg', ?2, ?3)",
                    params![topic.type_name, topic.definition, topic.type_hash],
                )?;
            }
            // rosbag2 does not have these tables, so they are created only if they are needed.
            for (table, name) in [(COLUMNS_TABLE, topic.column), (TOPICS_TABLE, topic.stands_for)] {
                let Some(name) = name else { continue };
                transaction.execute_batch(&format!(
                    "CREATE TABLE IF NOT EXISTS {table}(topic_id INTEGER PRIMARY KEY, name TEXT NOT NULL)"
                ))?;
                let insert = format!("INSERT INTO {table} (topic_id, name) VALUES (?1, ?2)");
                transaction.execute(&insert, params![id, name])?;
            }
            transaction.commit()
        };
        add().map_err(|error| failed(&self.path, &error))?;
        if new_type {
            self.types.push(topic.type_name.to_owned());
        }
        Ok(())
    }

    pub(super) fn message(&mut self, message: &Message<'_>) -> Result<(), RunError> {
        let Ok(log_time) = i64::try_from(message.log_time) else {
            let why = format!("time {} ns does not fit into 63 bits", message.log_time);
            return Err(RunError::Unwritable { path: self.path.clone(), what: "a message".into(), why });
        };
        let begin = self.data.len();
        self.data.extend_from_slice(message.cdr);
        // Topic ids count from 1, in the order of the bag.
        let topic = message.topic as i64 + 1;
        self.waiting.push(Waiting { topic, log_time, data: begin..self.data.len() });
        Ok(())
    }

    /// Writes the waiting messages in one transaction. They are with the operating system when this returns.
    pub(super) fn flush(&mut self) -> Result<(), RunError> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let write = || {
            let transaction = self.connection.unchecked_transaction()?;
            let mut insert = transaction
                .prepare("INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)")?;
            for Waiting { topic, log_time, data } in &self.waiting {
                insert.execute(params![topic, log_time, &self.data[data.clone()]])?;
            }
            drop(insert);
            transaction.commit()
        };
        write().map_err(|error| failed(&self.path, &error))?;
        self.waiting.clear();
        self.data.clear();
        Ok(())
    }

    /// Size of the file including its log, in bytes.
    pub(super) fn bytes(&self) -> Result<u64, RunError> {
        let size =
            |pragma: &str| self.connection.pragma_query_value(None, pragma, |row| row.get::<_, i64>(0));
        let pages = size("page_count").and_then(|count| Ok(count * size("page_size")?));
        pages.map(i64::unsigned_abs).map_err(|error| failed(&self.path, &error))
    }

    /// Completes the file, which has no log any more when this returns. `metadata` is the metadata of the bag.
    pub(super) fn finish(&mut self, metadata: &str) -> Result<(), RunError> {
        self.flush()?;
        let end = || {
            self.connection.execute(
                "INSERT INTO metadata (metadata_version, metadata) VALUES (?1, ?2)",
                params![metadata::VERSION, metadata],
            )?;
            // Merges the log and removes it. If another process reads the database at this moment, the log is merged when
            // the last of both closes it.
            self.connection.query_row("PRAGMA journal_mode=DELETE", [], |_| Ok(()))
        };
        end().map_err(|error| failed(&self.path, &error))
    }
}

impl Drop for SqliteFile {
    fn drop(&mut self) {
        // For a bag that is dropped before it is complete. An error cannot be returned here.
        let _ = self.flush();
    }
}

fn failed(path: &Path, error: &rusqlite::Error) -> RunError {
    let kind = match error.sqlite_error_code() {
        Some(ErrorCode::DiskFull) => ErrorKind::StorageFull,
        Some(ErrorCode::ReadOnly) => ErrorKind::ReadOnlyFilesystem,
        _ => ErrorKind::Other,
    };
    RunError::Database { path: path.to_owned(), action: "write", why: format!("{error}{}", advice(kind)) }
}
