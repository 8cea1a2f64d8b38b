//! Reads sqlite3 bags: topics and messages of a `.db3` file with any of rosbag2's schemas, also of a damaged one.
//!
//! The reader writes nothing next to the user's file. A database without a journal is opened as immutable, which takes no
//! lock and makes no journal. If the recorder was killed, the database has a journal (`-wal`, `-journal`); both files are
//! then copied, and SQLite recovers the copy.
//!
//! The schemas differ in their description of topics (quality of service, type hashes, definitions), but have the same
//! columns for the data that are read here. Columns are selected by name, and others are ignored. The content of a database
//! is not trusted: only plain tables are read, lengths are limited, and rows must come in order.

use super::bag_sink::{LogTimeFault, Sink, TopicInfo};
use super::{Note, RunError};
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row};
use std::collections::HashMap;
use std::fs;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// First bytes of a sqlite3 database.
pub(super) const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
/// Rows longer than this, in bytes, count as damaged, as in MCAP files.
const LENGTH_LIMIT: i32 = 256 << 20;
/// Maximum number of topics in a database; the limit of MCAP.
const TOPICS_LIMIT: usize = 65_535;
/// Number of damaged places after which the rest of a file is not read.
const HOLES_LIMIT: usize = 1000;
/// Suffixes of the journals that a killed recorder leaves: the write-ahead log and the rollback journal.
const JOURNALS: [&str; 2] = ["-wal", "-journal"];

/// A table of this project. It names the run's column for topics whose name differs from it.
pub(super) const COLUMNS_TABLE: &str = "mr_damper_columns";
/// A table of this project. It holds the original names of topics that the recorder remapped.
pub(super) const TOPICS_TABLE: &str = "mr_damper_topics";

/// Reads a whole database into `sink`. The database is at `file`; messages call it `path`. Damaged rows are skipped, with a
/// note.
///
/// # Errors
/// When the file is not a database of rosbag2, or the system fails.
pub(super) fn read(
    path: &Path,
    file: &Path,
    sink: &mut impl Sink,
    notes: &mut Vec<Note>,
) -> Result<(), RunError> {
    let opened = Opened::open(path, file, notes)?;
    let mut reader = Reader { path, connection: &opened.connection, messages: 0, notes };
    reader.prepare()?;
    reader.topics(sink)?;
    reader.all_messages(sink)?;
    if let Some((length, whole)) = opened.cut {
        let (path, messages) = (path.to_owned(), reader.messages);
        let why = format!("the file ends here, but its header says that it has {whole} bytes");
        notes.push(Note::CutShort { path, offset: length, messages, why });
    }
    Ok(())
}

/// A database that is open for reading.
struct Opened {
    connection: Connection,
    /// Its length and the length in its header, in bytes, if the header's is larger.
    cut: Option<(u64, u64)>,
    /// The directory of the copy, which is deleted when this is dropped.
    _copy: Option<TempDir>,
}

impl Opened {
    fn open(path: &Path, file: &Path, notes: &mut Vec<Note>) -> Result<Self, RunError> {
        let journal = JOURNALS.iter().find(|journal| {
            fs::metadata(beside(file, journal)).is_ok_and(|journal| journal.is_file() && journal.len() > 0)
        });
        if let Some(journal) = journal {
            let copy = copied(file, journal)?;
            let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
            let connection = Connection::open_with_flags(copy.path().join(COPY), flags)
                .map_err(|error| database(path, &error))?;
            notes.push(Note::Journal { path: path.to_owned(), journal });
            return Ok(Self { connection, cut: None, _copy: Some(copy) });
        }
        let cut = length_and_claim(path, file)?;
        let flags =
            OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
        let connection =
            Connection::open_with_flags(immutable(file), flags).map_err(|error| database(path, &error))?;
        Ok(Self { connection, cut, _copy: None })
    }
}

/// File name of the copy of a database that has a journal.
const COPY: &str = "bag.db3";

/// Copies a database and its journal to a temporary directory, where SQLite may write.
fn copied(file: &Path, journal: &str) -> Result<TempDir, RunError> {
    let dir =
        tempfile::tempdir().map_err(RunError::io(&std::env::temp_dir(), "make a temporary directory in"))?;
    let to = dir.path().join(COPY);
    for (from, to) in [(file.to_owned(), to.clone()), (beside(file, journal), beside(&to, journal))] {
        fs::copy(&from, &to).map_err(RunError::io(&from, "copy to the temporary directory"))?;
    }
    Ok(dir)
}

/// The path of a database's journal, given the journal's suffix.
pub(super) fn beside(file: &Path, journal: &str) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(journal);
    name.into()
}

/// The URI with which SQLite opens a file as immutable.
fn immutable(file: &Path) -> String {
    let whole = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let mut address = "file://".to_owned();
    for &byte in whole.as_os_str().as_bytes() {
        match byte {
            b'/' | b'.' | b'-' | b'_' | b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' => {
                address.push(char::from(byte));
            }
            _ => address += &format!("%{byte:02x}"),
        }
    }
    address + "?mode=ro&immutable=1"
}

/// Refuses a file that does not begin like a database. Returns its length and the length in its header, in bytes, if the
/// header's is larger.
fn length_and_claim(path: &Path, file: &Path) -> Result<Option<(u64, u64)>, RunError> {
    let mut source = fs::File::open(file).map_err(RunError::io(path, "open"))?;
    let length = source.metadata().map_err(RunError::io(path, "look at"))?.len();
    let mut head = Vec::with_capacity(100);
    (&mut source).take(100).read_to_end(&mut head).map_err(RunError::io(path, "read"))?;
    let not =
        |why: String| Err(RunError::NotABag { path: path.to_owned(), format: "a sqlite3 database", why });
    let Some(head) = head.first_chunk::<100>() else {
        return not(if head.is_empty() { "it is empty".into() } else { format!("it has {length} bytes") });
    };
    if !head.starts_with(SQLITE_MAGIC) {
        return not(format!("it begins with `{}`", head[..8].escape_ascii()));
    }
    let word = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let page = match u16::from_be_bytes([head[16], head[17]]) {
        1 => 65_536,
        size => u64::from(size),
    };
    // Old writers do not set the number of pages; it is valid only if the two change counters are equal.
    let claimed = if word(24) == word(92) { page * u64::from(word(28)) } else { 0 };
    Ok((claimed > length).then_some((length, claimed)))
}

/// True for an error in the data, false for an error of the system.
fn is_damage(error: &rusqlite::Error) -> bool {
    matches!(
        error.sqlite_error_code(),
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase | ErrorCode::TooBig)
    )
}

fn database(path: &Path, error: &rusqlite::Error) -> RunError {
    RunError::Database { path: path.to_owned(), action: "read", why: error.to_string() }
}

struct Reader<'a> {
    path: &'a Path,
    connection: &'a Connection,
    messages: u64,
    notes: &'a mut Vec<Note>,
}

/// How a pass over the messages ended.
enum Pass {
    End,
    /// The first row that could not be read, and the reason.
    Damaged(i64, String),
    /// The first row that is out of order. The rows after it are not trusted.
    Disorder(i64),
}

impl Reader<'_> {
    fn prepare(&self) -> Result<(), RunError> {
        let limited = self.connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, LENGTH_LIMIT);
        limited.map_err(|error| self.failed(&error))?;
        // The first setting keeps a schema from running functions, and the second finds damage early. The third allows
        // opening a file that is shorter than its header says, or whose schema is damaged in other places.
        let settings = "PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON; PRAGMA writable_schema=ON;";
        self.connection.execute_batch(settings).map_err(|error| self.failed(&error))?;
        for (table, columns) in
            [("topics", &["id", "name", "type"][..]), ("messages", &["topic_id", "timestamp", "data"][..])]
        {
            let found = self.columns(table)?;
            if let Some(missing) = columns.iter().find(|column| !found.iter().any(|known| known == *column)) {
                let why = match found.as_slice() {
                    [] => format!("it has no table `{table}`"),
                    found => format!("table `{table}` has no column `{missing}`, only {}", found.join(", ")),
                };
                return Err(self.not_a_bag(why));
            }
        }
        Ok(())
    }

    /// The columns of a plain table; empty if the table does not exist, or is a view or a virtual table.
    fn columns(&self, table: &str) -> Result<Vec<String>, RunError> {
        let query = || {
            let plain = "SELECT count(*) FROM sqlite_schema WHERE type='table' AND name=?1 AND rootpage>0";
            let count: i64 = self.connection.query_row(plain, [table], |row| row.get(0))?;
            if count == 0 {
                return Ok(Vec::new());
            }
            let mut statement = self.connection.prepare("SELECT name FROM pragma_table_info(?1)")?;
            statement.query_map([table], |row| row.get(0))?.collect()
        };
        query().map_err(|error: rusqlite::Error| match error {
            error if is_damage(&error) => {
                self.not_a_bag(format!("its table of contents is damaged: {error}"))
            }
            error => self.failed(&error),
        })
    }

    fn topics(&mut self, sink: &mut impl Sink) -> Result<(), RunError> {
        let known = self.columns("topics")?;
        let encoding = if known.iter().any(|column| column == "serialization_format") {
            "serialization_format"
        } else {
            "'cdr'"
        };
        let mut columns = self.names(COLUMNS_TABLE)?;
        let mut stand_for = self.names(TOPICS_TABLE)?;
        self.few_rows(&format!("SELECT id, name, type, {encoding} FROM topics ORDER BY id"), |row| {
            let id = integer(row, 0);
            let (column, stands_for) = (columns.remove(&id), stand_for.remove(&id));
            let (name, type_name, encoding) = (text(row, 1), text(row, 2), text(row, 3));
            let topic = TopicInfo { name, type_name, encoding, column, stands_for };
            sink.topic(id.unwrap_or(-1), topic);
        })
    }

    /// The names in one of this project's tables, by topic id; empty if the table does not exist.
    fn names(&mut self, table: &str) -> Result<HashMap<Option<i64>, String>, RunError> {
        let mut names = HashMap::new();
        if !self.columns(table)?.is_empty() {
            self.few_rows(&format!("SELECT topic_id, name FROM {table}"), |row| {
                names.insert(integer(row, 0), text(row, 1));
            })?;
        }
        Ok(names)
    }

    /// Passes the rows of a small table to `take`, up to the first damage.
    fn few_rows(&mut self, query: &str, mut take: impl FnMut(&Row<'_>)) -> Result<(), RunError> {
        let mut run = || {
            let mut statement = self.connection.prepare(query)?;
            let mut rows = statement.query([])?;
            let mut count = 0;
            while let Some(row) = rows.next()? {
                take(row);
                count += 1;
                if count == TOPICS_LIMIT {
                    break;
                }
            }
            Ok(())
        };
        match run() {
            Ok(()) => Ok(()),
            Err(error) if is_damage(&error) => {
                let (path, why) = (self.path.to_owned(), format!("topics: {error}"));
                self.notes.push(Note::RowsDamaged { path, first: None, last: None, why });
                Ok(())
            }
            Err(error) => Err(self.failed(&error)),
        }
    }

    /// Reads all messages in the order in which they were written, and skips damaged rows.
    fn all_messages(&mut self, sink: &mut impl Sink) -> Result<(), RunError> {
        let mut from = i64::MIN;
        for _ in 0..HOLES_LIMIT {
            match self.messages_from(from, sink)? {
                Pass::End => return Ok(()),
                Pass::Disorder(row) => {
                    let why = "rows do not come in order of their id".to_owned();
                    self.hole(row, None, why);
                    return Ok(());
                }
                Pass::Damaged(row, why) => {
                    let next = self.first_readable_behind(row)?;
                    self.hole(row, next.map(|next| next - 1), why);
                    let Some(next) = next else { return Ok(()) };
                    from = next;
                }
            }
        }
        let why = format!("{HOLES_LIMIT} places are damaged, so the rest is not read");
        self.hole(from, None, why);
        Ok(())
    }

    fn hole(&mut self, first: i64, last: Option<i64>, why: String) {
        let path = self.path.to_owned();
        self.notes.push(Note::RowsDamaged { path, first: Some(first), last, why });
    }

    fn messages_from(&mut self, from: i64, sink: &mut impl Sink) -> Result<Pass, RunError> {
        // Ids start at 1, unless they were assigned by hand.
        let mut next = from.max(1);
        let mut last = None;
        let mut run = || {
            let mut statement = self.connection.prepare(ROWS)?;
            let mut rows = statement.query([from])?;
            while let Some(row) = rows.next()? {
                let id: i64 = row.get(0)?;
                if id < from || last.is_some_and(|last| id <= last) {
                    return Ok(Pass::Disorder(id));
                }
                last = Some(id);
                next = id.saturating_add(1);
                let log_time = match row.get_ref(2)? {
                    ValueRef::Integer(nanos) => Ok(nanos),
                    _ => Err(LogTimeFault::Absent { row: id }),
                };
                // A value that is not a blob yields no bytes and counts as undecodable.
                let data = row.get_ref(3)?.as_bytes().unwrap_or_default();
                sink.message(integer(row, 1).unwrap_or(-1), log_time, data);
                self.messages += 1;
            }
            Ok(Pass::End)
        };
        match run() {
            Ok(pass) => Ok(pass),
            Err(error) if is_damage(&error) => Ok(Pass::Damaged(next, error.to_string())),
            Err(error) => Err(self.failed(&error)),
        }
    }

    /// The lowest id after `row` from which rows can be read again, as found by bisection; `None` if all later rows are
    /// unreadable.
    fn first_readable_behind(&self, row: i64) -> Result<Option<i64>, RunError> {
        let (mut bad, mut step) = (row, 1_i64);
        let mut good = loop {
            let Some(probe) = row.checked_add(step).filter(|_| step < 1 << 40) else { return Ok(None) };
            if self.is_readable(probe)? {
                break probe;
            }
            bad = probe;
            step *= 2;
        };
        while good - bad > 1 {
            let middle = bad + (good - bad) / 2;
            if self.is_readable(middle)? { good = middle } else { bad = middle }
        }
        Ok(Some(good))
    }

    /// True if the first row from `id` on can be read, or if there is no such row.
    fn is_readable(&self, id: i64) -> Result<bool, RunError> {
        let probe = || {
            let mut statement = self.connection.prepare(ROWS)?;
            let mut rows = statement.query([id])?;
            rows.next().map(|_| ())
        };
        match probe() {
            Ok(()) => Ok(true),
            Err(error) if is_damage(&error) => Ok(false),
            Err(error) => Err(self.failed(&error)),
        }
    }

    fn failed(&self, error: &rusqlite::Error) -> RunError {
        if error.sqlite_error_code() == Some(ErrorCode::NotADatabase) {
            return self.not_a_bag(error.to_string());
        }
        database(self.path, error)
    }

    fn not_a_bag(&self, why: String) -> RunError {
        RunError::NotABag { path: self.path.to_owned(), format: "a rosbag2 database", why }
    }
}

const ROWS: &str = "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid >= ?1 ORDER BY rowid";

fn integer(row: &Row<'_>, column: usize) -> Option<i64> {
    row.get_ref(column).ok()?.as_i64().ok()
}

/// The text of a column, with invalid UTF-8 replaced; empty if the column holds no text.
fn text(row: &Row<'_>, column: usize) -> String {
    let bytes = row.get_ref(column).ok().and_then(|value| value.as_bytes().ok()).unwrap_or_default();
    String::from_utf8_lossy(bytes).into_owned()
}
