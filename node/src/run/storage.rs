//! One file of a bag, of either storage, packed or not, into one sink.
//!
//! What a file is, its first bytes say, not its name: bags are renamed. The readers behind this are
//! [`mcap`](super::mcap) and [`sqlite`](super::sqlite); both go as far as a damaged file goes.

use super::hash::{Hash, HashingReader};
use super::pack::{Unpacked, is_packed};
use super::{Note, RunError, mcap, sqlite};
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

/// A topic as a file describes it.
pub(super) struct TopicInfo {
    pub(super) name: String,
    /// Empty when the file does not say it.
    pub(super) type_name: String,
    /// How its messages are encoded: `cdr`.
    pub(super) encoding: String,
    /// The run's column behind it, where its name cannot say that.
    pub(super) column: Option<String>,
    /// What the topic would be called without the recorder's renaming, where it was renamed.
    pub(super) stands_for: Option<String>,
}

/// Takes what matters from the files of a bag, in file order.
pub(super) trait Sink {
    /// A file begins: ids of topics hold within one file.
    fn begin_file(&mut self);
    /// A topic and its id.
    fn topic(&mut self, id: i64, topic: TopicInfo);
    /// A message: its topic's id, when it was recorded in nanoseconds (or why that is not known), its bytes.
    fn message(&mut self, topic: i64, log_time: Result<i64, String>, data: &[u8]);
}

/// What a sqlite3 database begins with.
pub(super) const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
/// How far what is packed may grow, beyond what is free: no recording shrinks to a thousandth, so more is damage or malice.
pub(super) const UNPACK_RATIO: u64 = 1000;
/// What any packed database may grow to.
const UNPACK_FREE: u64 = 1 << 30;

/// Reads a whole file into `sink`. A file that ends or breaks early gives what came before and a note.
///
/// # Errors
/// When the file begins as neither storage, or the system fails to read or to keep it while it is unpacked.
pub(super) fn read(
    path: &Path,
    sink: &mut impl Sink,
    notes: &mut Vec<Note>,
    hash: &mut Hash,
) -> Result<(), RunError> {
    let file = File::open(path).map_err(RunError::io(path, "open"))?;
    let length = file.metadata().map_err(RunError::io(path, "look at"))?.len();
    let mut source = HashingReader::new(BufReader::with_capacity(1 << 18, file), hash);
    let head = peek(&mut source).map_err(RunError::io(path, "read"))?;
    sink.begin_file();
    if is_packed(&head) {
        read_packed(path, length, (&head[..]).chain(&mut source), sink, notes)?;
    } else if is_sqlite(path, &head) {
        sqlite::read(path, path, sink, notes)?;
    } else {
        mcap::read(path, (&head[..]).chain(&mut source), sink, notes)?;
    }
    source.drain().map_err(RunError::io(path, "read"))
}

/// By its first bytes; a file of that name with other first bytes is for the sqlite3 reader to refuse.
fn is_sqlite(path: &Path, head: &[u8]) -> bool {
    let named = path.to_string_lossy().trim_end_matches(".zstd").ends_with(".db3");
    head == SQLITE_MAGIC || (named && !head.starts_with(::mcap::MAGIC))
}

/// The first bytes, as many as there are, at most as many as tell a database.
fn peek(source: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut head = Vec::with_capacity(SQLITE_MAGIC.len());
    source.take(SQLITE_MAGIC.len() as u64).read_to_end(&mut head)?;
    Ok(head)
}

fn read_packed(
    path: &Path,
    length: u64,
    source: impl Read,
    sink: &mut impl Sink,
    notes: &mut Vec<Note>,
) -> Result<(), RunError> {
    let mut unpacked = Unpacked::new(BufReader::new(source)).map_err(RunError::io(path, "unpack"))?;
    let head = peek(&mut unpacked).map_err(RunError::io(path, "read"))?;
    if head.is_empty() {
        let why = unpacked.fault().map_or_else(
            || "it is empty inside".to_owned(),
            |(_, why)| format!("nothing can be unpacked: {why}"),
        );
        return Err(RunError::NotABag { path: path.to_owned(), format: "a packed bag", why });
    }
    let whole = (&head[..]).chain(&mut unpacked);
    if is_sqlite(path, &head) {
        // SQLite reads here and there, so it needs the whole; a file, as it may be larger than the memory.
        let limit = length.saturating_mul(UNPACK_RATIO).max(UNPACK_FREE);
        let mut copy = tempfile::NamedTempFile::new()
            .map_err(RunError::io(&std::env::temp_dir(), "make a temporary file in"))?;
        let keeping = |error| RunError::io(copy.path(), "unpack to")(error);
        let count = io::copy(&mut whole.take(limit + 1), &mut copy.as_file()).map_err(keeping)?;
        copy.flush().map_err(RunError::io(path, "unpack"))?;
        if count > limit {
            let why = format!("it unpacks to more than {limit} bytes, {UNPACK_RATIO} times its size");
            return Err(RunError::NotABag {
                path: path.to_owned(),
                format: "a packed sqlite3 database",
                why,
            });
        }
        sqlite::read(path, copy.path(), sink, notes)?;
    } else {
        mcap::read(path, whole, sink, notes)?;
    }
    if let Some((bytes, why)) = unpacked.fault() {
        notes.push(Note::PackedCutShort { path: path.to_owned(), bytes, why });
    }
    Ok(())
}
