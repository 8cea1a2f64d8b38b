//! sqlite3 bags: topics and messages of a `.db3` file, of any of rosbag2's schemas, read as far as they go.
//!
//! Nothing is written beside the user's file. A database that stands alone is opened as immutable, which
//! takes no lock and makes no journal. One that its recorder left in the middle of its work has a journal
//! beside it (`-wal`, `-journal`); both are copied, and SQLite puts the copy in order.
//!
//! Schemas differ in what they say of topics (quality of service, type hashes, definitions) and agree in what
//! is read here, so columns are asked for by name and others passed over. A database is hostile until shown
//! otherwise: only plain tables are read, lengths are limited, and rows have to come in order.

use super::storage::{SQLITE_MAGIC, Sink, TopicInfo};
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

/// Rows longer than this are taken for damage, as records of MCAP files are.
const LENGTH_LIMIT: i32 = 256 << 20;
/// Topics that a database may name; MCAP's own bound.
const TOPICS_LIMIT: usize = 65_535;
/// Damaged places after which a file is given up.
const HOLES_LIMIT: usize = 1000;
/// Journals that a killed recorder leaves: of write-ahead logging and of rolling back.
const JOURNALS: [&str; 2] = ["-wal", "-journal"];

/// Table of ours that names the run's column behind a topic, where the topic's name cannot say it.
pub(super) const COLUMNS_TABLE: &str = "mr_damper_columns";
/// Table of ours with what a topic would be called without the recorder's renaming.
pub(super) const TOPICS_TABLE: &str = "mr_damper_topics";

/// Reads a whole database into `sink`; it lies at `file` and is called `path`. What is damaged is left out
/// with a note.
///
/// # Errors
/// When it is no database of rosbag2, or the system fails.
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
        let why = format!("the file ends, though it says to be {whole} bytes long");
        notes.push(Note::CutShort { path, offset: length, messages, why });
    }
    Ok(())
}

/// A database, open for reading.
struct Opened {
    connection: Connection,
    /// Its length and the length that it says to have, if that is more.
    cut: Option<(u64, u64)>,
    /// Keeps a copy alive.
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

/// Name of the copy of a database that has a journal.
const COPY: &str = "bag.db3";

/// Copies a database and its journal where SQLite may write.
fn copied(file: &Path, journal: &str) -> Result<TempDir, RunError> {
    let dir =
        tempfile::tempdir().map_err(RunError::io(&std::env::temp_dir(), "make a temporary directory in"))?;
    let to = dir.path().join(COPY);
    for (from, to) in [(file.to_owned(), to.clone()), (beside(file, journal), beside(&to, journal))] {
        fs::copy(&from, &to).map_err(RunError::io(&from, "copy to the temporary directory"))?;
    }
    Ok(dir)
}

/// The journal beside a database, by the end of its name.
pub(super) fn beside(file: &Path, journal: &str) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(journal);
    name.into()
}

/// The address by which SQLite opens a file as one that nobody changes.
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

/// Refuses what does not begin as a database; returns its length and the one it claims, if that is more.
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
    // Old writers leave the number of pages unset; it counts when the two counters beside it agree.
    let claimed = if word(24) == word(92) { page * u64::from(word(28)) } else { 0 };
    Ok((claimed > length).then_some((length, claimed)))
}

/// What is wrong with a row or a page, against what is wrong with the machine.
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

/// How far a pass over the messages went.
enum Pass {
    End,
    /// The first row that was not read, and why not.
    Damaged(i64, String),
    /// Rows that do not come in order: nothing behind can be trusted.
    Disorder(i64),
}

impl Reader<'_> {
    fn prepare(&self) -> Result<(), RunError> {
        let limited = self.connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, LENGTH_LIMIT);
        limited.map_err(|error| self.failed(&error))?;
        // The first keeps a schema from running functions, the second finds damage early, and the third lets
        // a file be opened that is shorter than it says or has a schema that is damaged elsewhere.
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

    /// The columns of a plain table; none when it is not there, or is a view or virtual.
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

    /// What one of our own tables says of topics, by their ids; nothing where the table is missing.
    fn names(&mut self, table: &str) -> Result<HashMap<Option<i64>, String>, RunError> {
        let mut names = HashMap::new();
        if !self.columns(table)?.is_empty() {
            self.few_rows(&format!("SELECT topic_id, name FROM {table}"), |row| {
                names.insert(integer(row, 0), text(row, 1));
            })?;
        }
        Ok(names)
    }

    /// Takes the rows of a small table as far as they go.
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

    /// All messages in the order in which they were written, around what is damaged.
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
        let why = format!("{HOLES_LIMIT} places are damaged, so the rest is left");
        self.hole(from, None, why);
        Ok(())
    }

    fn hole(&mut self, first: i64, last: Option<i64>, why: String) {
        let path = self.path.to_owned();
        self.notes.push(Note::RowsDamaged { path, first: Some(first), last, why });
    }

    fn messages_from(&mut self, from: i64, sink: &mut impl Sink) -> Result<Pass, RunError> {
        // Ids count from 1, unless somebody gave them by hand.
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
                    _ => Err(format!("row {id} has no time")),
                };
                // What is no blob has no bytes that could be decoded, and counts as such.
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

    /// The least id behind `row` from which rows can be read again, as far as halving finds it; `None` when there
    /// is none.
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

    /// Whether the first row from `id` on, or the end, can be read.
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

/// A text as far as it is one.
fn text(row: &Row<'_>, column: usize) -> String {
    let bytes = row.get_ref(column).ok().and_then(|value| value.as_bytes().ok()).unwrap_or_default();
    String::from_utf8_lossy(bytes).into_owned()
}
