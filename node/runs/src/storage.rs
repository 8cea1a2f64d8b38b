//! Reads one file of a bag, in either storage, compressed or not, into a sink.
//!
//! The format is found from the first bytes of the file and not from its name, because bags get renamed. The readers are
//! [`mcap`](super::mcap) and [`sqlite`](super::sqlite); both read a damaged file as far as possible.

use super::bag_sink::Sink;
use super::hash::{Hash, HashingReader};
use super::pack::{UNPACK_RATIO, Unpacked, is_packed};
use super::sqlite::SQLITE_MAGIC;
use super::{Note, RunError, mcap, sqlite};
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

/// Unpacked size of a database, in bytes, that is always allowed.
const UNPACK_FREE: u64 = 1 << 30;

/// Reads a whole file into `sink`. If the file ends early or is damaged, the data before that are read, and a note is added.
///
/// # Errors
/// When the file begins like neither storage, or the system cannot read it or cannot store the unpacked copy.
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

/// True if the first bytes are SQLite's. Also true for a `.db3` file with unknown first bytes, which the sqlite3 reader
/// then refuses.
fn is_sqlite(path: &Path, head: &[u8]) -> bool {
    let named = path.to_string_lossy().trim_end_matches(".zstd").ends_with(".db3");
    head == SQLITE_MAGIC || (named && !head.starts_with(::mcap::MAGIC))
}

/// The first bytes: as many as are needed to recognise a database, or fewer if the file is shorter.
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
            || "its unpacked content is empty".to_owned(),
            |(_, why)| format!("nothing can be unpacked: {why}"),
        );
        return Err(RunError::NotABag { path: path.to_owned(), format: "a packed bag", why });
    }
    let whole = (&head[..]).chain(&mut unpacked);
    if is_sqlite(path, &head) {
        // SQLite needs random access. The unpacked data go to a file, because they may be larger than memory.
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
