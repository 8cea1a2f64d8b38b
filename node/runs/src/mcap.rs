//! Reads MCAP records from a byte stream, up to the first damage that cannot be skipped. Memory is bounded by the largest
//! chunk.
//!
//! This module reads the framing of records; the `mcap` crate's sans-I/O reader reads the content of chunks. In this way
//! notes have exact byte offsets, a damaged chunk loses only its own messages, and length fields are checked before the
//! crate uses them, which trusts some of them.

use super::bag_sink::{LogTimeFault, Sink, TopicInfo};
use super::bag_types::{COLUMN_KEY, TOPIC_KEY};
use super::pack::UNPACK_RATIO;
use super::{Note, RunError};
use mcap::McapError;
use mcap::records::{Channel, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::HashMap;
use std::io::{self, Read};
use std::path::Path;

/// Records and decompressed chunks larger than this, in bytes, count as damaged. Writers make chunks of about 1 MB.
const RECORD_LIMIT: usize = 256 << 20;
/// Unpacked size of a chunk, in bytes, that is always allowed. Above it, [`UNPACK_RATIO`] limits the size.
const UNPACK_FREE: usize = 32 << 20;
/// Length of opcode and length field, in bytes.
const FRAME: usize = 9;
/// Length of a chunk's fields before the name of its compression, in bytes.
const CHUNK_HEAD: usize = 32;

/// Reads a whole MCAP file into `sink`. If the file ends early or is damaged, the data before that are read, and a note is
/// added.
///
/// # Errors
/// When the file does not begin like MCAP, the system cannot read it, or the compression of a chunk is not supported.
pub(super) fn read(
    path: &Path,
    source: impl Read,
    sink: &mut impl Sink,
    notes: &mut Vec<Note>,
) -> Result<(), RunError> {
    let mut file = File { path, source, offset: 0, messages: 0, body: Vec::new() };
    match file.records(&mut Records { sink, types: HashMap::new() }, notes) {
        Ok(()) => Ok(()),
        Err(Stop::Damaged(offset, why)) => {
            notes.push(Note::CutShort { path: path.to_owned(), offset, messages: file.messages, why });
            Ok(())
        }
        Err(Stop::Failed(error)) => Err(error),
    }
}

/// Passes records to a sink, with the names of types in place of the file's type ids.
struct Records<'a, S> {
    sink: &'a mut S,
    types: HashMap<u16, String>,
}

impl<S: Sink> Records<'_, S> {
    fn channel(&mut self, mut channel: Channel) {
        let type_name = self.types.get(&channel.schema_id).cloned().unwrap_or_default();
        let column = channel.metadata.remove(COLUMN_KEY);
        let stands_for = channel.metadata.remove(TOPIC_KEY);
        let (name, encoding) = (channel.topic, channel.message_encoding);
        let topic = TopicInfo { name, type_name, encoding, column, stands_for };
        self.sink.topic(channel.id.into(), topic);
    }
}

/// Why reading stopped before the footer.
enum Stop {
    /// The data end or are damaged at this offset.
    Damaged(u64, String),
    Failed(RunError),
}

struct File<'a, R> {
    path: &'a Path,
    source: R,
    /// Number of bytes read.
    offset: u64,
    messages: u64,
    /// The current record.
    body: Vec<u8>,
}

impl<R: Read> File<'_, R> {
    fn records(&mut self, sink: &mut Records<'_, impl Sink>, notes: &mut Vec<Note>) -> Result<(), Stop> {
        let mut magic = [0; 8];
        if self.fill(&mut magic)? < magic.len() || magic != *mcap::MAGIC {
            let why = match self.offset {
                0 => "it is empty".to_owned(),
                _ => format!("it begins with `{}`", magic.escape_ascii()),
            };
            let (path, format) = (self.path.to_owned(), "an MCAP file");
            return Err(Stop::Failed(RunError::NotABag { path, format, why }));
        }
        loop {
            let start = self.offset;
            let mut frame = [0; FRAME];
            match self.fill(&mut frame)? {
                FRAME => {}
                0 => return Err(Stop::Damaged(start, "the file ends without a footer".into())),
                _ => return Err(Stop::Damaged(start, "the file ends inside a record".into())),
            }
            let (opcode, length) = split_frame(&frame);
            match opcode {
                op::DATA_END | op::FOOTER => return Ok(()),
                op::CHUNK => self.chunk(start, length, sink, notes)?,
                op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    self.body(start, length)?;
                    if self.body.len() as u64 != length {
                        return Err(Stop::Damaged(start, "the file ends inside a record".into()));
                    }
                    self.messages += emit(opcode, &self.body, sink)
                        .map_err(|fault| Stop::Damaged(start, fault.to_string()))?;
                }
                _ => self.pass_over(start, length)?,
            }
        }
    }

    /// Fills `buffer`, or less at the end of the file; returns the number of bytes.
    fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, Stop> {
        let mut count = 0;
        while count < buffer.len() {
            match self.source.read(&mut buffer[count..]) {
                Ok(0) => break,
                Ok(more) => count += more,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.failed(error)),
            }
        }
        self.offset += count as u64;
        Ok(count)
    }

    fn failed(&self, error: io::Error) -> Stop {
        Stop::Failed(RunError::io(self.path, "read")(error))
    }

    /// Reads up to `length` bytes into `self.body`. Memory grows with the real content of the file, not with the value of a
    /// damaged length field.
    fn body(&mut self, start: u64, length: u64) -> Result<(), Stop> {
        if length > RECORD_LIMIT as u64 {
            return Err(Stop::Damaged(
                start,
                format!("a record of {length} bytes, more than {RECORD_LIMIT}"),
            ));
        }
        self.body.clear();
        let read = (&mut self.source).take(length).read_to_end(&mut self.body);
        let count = read.map_err(|error| self.failed(error))?;
        self.offset += count as u64;
        Ok(())
    }

    /// Skips a record that is not needed: attachment, metadata, index.
    fn pass_over(&mut self, start: u64, length: u64) -> Result<(), Stop> {
        let count = io::copy(&mut (&mut self.source).take(length), &mut io::sink());
        let count = count.map_err(|error| self.failed(error))?;
        self.offset += count;
        if count < length {
            return Err(Stop::Damaged(start, "the file ends inside a record".into()));
        }
        Ok(())
    }

    fn chunk(
        &mut self,
        start: u64,
        length: u64,
        sink: &mut Records<'_, impl Sink>,
        notes: &mut Vec<Note>,
    ) -> Result<(), Stop> {
        self.body(start, length)?;
        let complete = self.body.len() as u64 == length;
        let (messages, end) = read_chunk(&self.body, length, complete, sink);
        self.messages += messages;
        match end {
            Err(ChunkFault::Compression(name)) => Err(Stop::Failed(RunError::Compression {
                path: self.path.to_owned(),
                offset: Some(start),
                name,
            })),
            _ if !complete => Err(Stop::Damaged(start, "the file ends inside a chunk".into())),
            Err(ChunkFault::Damaged(why)) => {
                notes.push(Note::ChunkDamaged { path: self.path.to_owned(), offset: start, why });
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }
}

fn split_frame(frame: &[u8; FRAME]) -> (u8, u64) {
    let [opcode, length @ ..] = *frame;
    (opcode, u64::from_le_bytes(length))
}

enum ChunkFault {
    Compression(String),
    Damaged(String),
}

impl From<McapError> for ChunkFault {
    fn from(error: McapError) -> Self {
        match error {
            McapError::UnsupportedCompression(name) => Self::Compression(name),
            other => Self::Damaged(other.to_string()),
        }
    }
}

/// Emits the records of a chunk; returns the number of messages. A complete chunk with a checksum is checked before any
/// record is emitted. If a chunk is cut off, all complete records in it are emitted.
fn read_chunk(
    body: &[u8],
    length: u64,
    complete: bool,
    sink: &mut Records<'_, impl Sink>,
) -> (u64, Result<(), ChunkFault>) {
    let mut messages = 0;
    let limit = unpack_limit(body.len());
    let end = (|| {
        let body = &body[..check_chunk(body, complete)?];
        let mut reader = LinearReader::new_with_options(LinearReaderOptions {
            skip_start_magic: true,
            skip_end_magic: true,
            prevalidate_chunk_crcs: complete,
            record_length_limit: Some(limit),
            ..LinearReaderOptions::default()
        });
        let mut frame = [op::CHUNK; FRAME];
        frame[1..].copy_from_slice(&length.to_le_bytes());
        let mut rest = (&frame[..]).chain(body);
        while let Some(event) = reader.next_event() {
            match event? {
                LinearReadEvent::ReadRequest(length) => {
                    // The request is limited to the available bytes, so that a false length does not allocate memory.
                    let length = length.clamp(1, FRAME + body.len());
                    // Reading from memory does not fail.
                    let count = rest.read(reader.insert(length)).unwrap_or(0);
                    if count == 0 {
                        break;
                    }
                    reader.notify_read(count);
                }
                LinearReadEvent::Record { opcode, data } => {
                    messages +=
                        emit(opcode, data, sink).map_err(|fault| ChunkFault::Damaged(fault.to_string()))?;
                }
            }
        }
        Ok(())
    })();
    (messages, end)
}

/// Largest unpacked size of `packed` bytes. The limit is needed because the crate allocates the size that a chunk or record
/// states, whatever its real size.
fn unpack_limit(packed: usize) -> usize {
    usize::try_from(UNPACK_RATIO).unwrap_or(1).saturating_mul(packed).clamp(UNPACK_FREE, RECORD_LIMIT)
}

/// Checks the length fields that the crate trusts: the compressed data fit into the record, their stated unpacked size is
/// plausible, and the records of an uncompressed chunk end where the chunk ends. Returns the number of bytes that may be
/// passed to the crate: for an uncompressed chunk that is cut off, up to the end of its last complete record.
fn check_chunk(body: &[u8], complete: bool) -> Result<usize, ChunkFault> {
    let damaged = |why: &str| Err(ChunkFault::Damaged(why.to_owned()));
    let Some((head, rest)) = body.split_at_checked(CHUNK_HEAD) else {
        return damaged("it ends inside its header");
    };
    let name_length = head[CHUNK_HEAD - 4..].try_into().map_or(0, u32::from_le_bytes) as usize;
    let Some((name, rest)) = rest.split_at_checked(name_length) else {
        return damaged("it ends inside its header");
    };
    let Some((size, data)) = rest.split_first_chunk() else {
        return damaged("it ends inside its header");
    };
    // Bytes after the data are allowed, because a later version of the format may define them.
    let size = usize::try_from(u64::from_le_bytes(*size)).unwrap_or(usize::MAX);
    if complete && size > data.len() {
        return damaged("its length does not fit its record");
    }
    let unpacked = head[16..].first_chunk().map_or(0, |size| u64::from_le_bytes(*size));
    if !name.is_empty() && unpacked > unpack_limit(body.len()) as u64 {
        return Err(ChunkFault::Damaged(format!(
            "it claims to unpack from {} to {unpacked} bytes",
            body.len()
        )));
    }
    if !name.is_empty() {
        return Ok(body.len());
    }
    let mut records = &data[..size.min(data.len())];
    let head = body.len() - data.len();
    let all = records.len();
    while !records.is_empty() {
        let behind = records.split_first_chunk().and_then(|(frame, rest)| {
            let (_, length) = split_frame(frame);
            rest.get(usize::try_from(length).ok()?..)
        });
        match behind {
            Some(behind) => records = behind,
            None if complete => return damaged("it ends inside a record"),
            None => return Ok(head + all - records.len()),
        }
    }
    Ok(body.len())
}

/// A record that cannot be read.
#[derive(Debug, thiserror::Error)]
enum RecordFault {
    #[error("a text is longer than its record")]
    Text,
    #[error(transparent)]
    Library(#[from] McapError),
}

/// Passes one record to the sink; returns 1 for a message. Records that are not needed are not parsed.
fn emit(opcode: u8, data: &[u8], sink: &mut Records<'_, impl Sink>) -> Result<u64, RecordFault> {
    if !matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
        return Ok(0);
    }
    check_texts(opcode, data).ok_or(RecordFault::Text)?;
    match mcap::parse_record(opcode, data)? {
        Record::Schema { header, .. } => {
            sink.types.insert(header.id, header.name);
        }
        Record::Channel(channel) => sink.channel(channel),
        Record::Message { header, data } => {
            let log_time =
                i64::try_from(header.log_time).map_err(|_| LogTimeFault::Range { nanos: header.log_time });
            sink.sink.message(header.channel_id.into(), log_time, &data);
            return Ok(1);
        }
        _ => {}
    }
    Ok(0)
}

/// Checks the lengths of the texts of a schema or channel. The crate allocates memory for a text before it checks that the
/// text is there.
fn check_texts(opcode: u8, data: &[u8]) -> Option<()> {
    fn behind_text(data: &[u8]) -> Option<&[u8]> {
        let (length, rest) = data.split_first_chunk()?;
        rest.get(usize::try_from(u32::from_le_bytes(*length)).ok()?..)
    }
    match opcode {
        op::SCHEMA => behind_text(behind_text(data.get(2..)?)?).map(|_data| ()),
        op::CHANNEL => {
            // The metadata are texts with a length field before all of them.
            let (length, rest) = behind_text(behind_text(data.get(4..)?)?)?.split_first_chunk()?;
            let mut texts = rest.get(..usize::try_from(u32::from_le_bytes(*length)).ok()?)?;
            while !texts.is_empty() {
                texts = behind_text(texts)?;
            }
            Some(())
        }
        _ => Some(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts messages.
    #[derive(Default)]
    struct Count(u64);

    impl Sink for Count {
        fn begin_file(&mut self) {}
        fn topic(&mut self, _: i64, _: TopicInfo) {}
        fn message(&mut self, _: i64, _: Result<i64, LogTimeFault>, _: &[u8]) {
            self.0 += 1;
        }
    }

    fn record(opcode: u8, length: u64, body: &[u8]) -> Vec<u8> {
        [&[opcode][..], &length.to_le_bytes(), body].concat()
    }

    fn message() -> Vec<u8> {
        record(op::MESSAGE, 24, &[0; 24])
    }

    /// A chunk without checksum, so that only the length checks protect the reader.
    fn chunk(compression: &str, uncompressed: u64, compressed: u64, data: &[u8]) -> Vec<u8> {
        let name_length = compression.len() as u32;
        [
            &[0; 16][..],
            &uncompressed.to_le_bytes(),
            &[0; 4],
            &name_length.to_le_bytes(),
            compression.as_bytes(),
            &compressed.to_le_bytes(),
            data,
        ]
        .concat()
    }

    /// Number of messages read from a file with these records, and the notes.
    fn messages(records: &[u8]) -> (u64, Vec<String>) {
        let (mut count, mut notes) = (Count::default(), Vec::new());
        let bytes = [mcap::MAGIC, records].concat();
        read(Path::new("x"), &bytes[..], &mut count, &mut notes).expect("begins as MCAP");
        (count.0, notes.iter().map(ToString::to_string).collect())
    }

    #[test]
    fn false_lengths_neither_panic_nor_allocate() {
        let two = [message(), message()].concat();
        let size = two.len() as u64;
        let end = record(op::DATA_END, 4, &[0; 4]);
        let whole =
            |body: Vec<u8>| [record(op::CHUNK, body.len() as u64, &body), message(), end.clone()].concat();

        assert_eq!(messages(&whole(chunk("", size, size, &two))), (3, vec![]));
        // Bytes after the data are allowed.
        let padded = [two.clone(), vec![9; 50]].concat();
        assert_eq!(messages(&whole(chunk("", size, size, &padded))), (3, vec![]));
        let long_record = [message(), record(op::MESSAGE, 1000, &[0; 24])].concat();
        let endless_record = record(op::MESSAGE, u64::MAX, &[]);
        for body in [
            chunk("", size, size, &long_record),
            chunk("", size, size - 1, &two),
            chunk("", 9, 9, &endless_record),
            chunk("", size, size + 1, &two),
            chunk("", size, u64::MAX, &two),
            chunk("zstd", u64::MAX, size, &two),
            chunk("zstd", UNPACK_FREE as u64 + 1, size, &two),
            chunk("zstd", size, u64::MAX, &two),
            chunk("zstd", size, 0, &[]),
            vec![0; 20],
            chunk("", size, size, &two)[..38].to_vec(),
        ] {
            let (count, notes) = messages(&whole(body));
            // Only the chunk is lost: the message after it is read.
            assert_eq!(count, 1, "{notes:?}");
            assert!(notes.len() == 1 && notes[0].contains("chunk at byte 8 left out"), "{notes:?}");
        }
        for records in [
            endless_record,
            record(op::CHUNK, u64::MAX, &[]),
            record(op::CHUNK, 200, &chunk("", size, size, &two)[..50]),
            record(op::CHUNK, 200 << 20, &[0; 20]),
            record(op::ATTACHMENT, u64::MAX, &[0; 20]),
            record(op::MESSAGE, 3, &[0; 3]),
            record(op::SCHEMA, 10, &[255; 10]),
            record(op::CHANNEL, 10, &[255; 10]),
        ] {
            let (count, notes) = messages(&records);
            assert_eq!(count, 0);
            assert!(notes.len() == 1 && notes[0].contains("read up to byte 8, 0 messages"), "{notes:?}");
        }
    }

    #[test]
    fn all_complete_records_of_a_cut_chunk_are_read() {
        let size = 2 * message().len() as u64;
        // The long record is complete, but it reaches beyond the chunk's data; in a cut file it counts as cut off.
        let long = record(op::MESSAGE, 24 + 50, &[0; 24 + 50]);
        for (records, whole) in [
            ([message(), message()].concat(), 2),
            ([message(), long.clone()].concat(), 1),
            ([message(), message(), long.clone()].concat(), 2),
            (long, 0),
        ] {
            let body = chunk("", size, size, &records);
            let (count, notes) = messages(&record(op::CHUNK, body.len() as u64 + 1, &body));
            assert_eq!(count, whole);
            assert!(notes.len() == 1 && notes[0].contains("the file ends inside a chunk"), "{notes:?}");
        }
    }

    #[test]
    fn a_text_that_is_longer_than_its_record_is_refused_before_memory_is_allocated() {
        let text = |length: u32, text: &[u8]| [&length.to_le_bytes()[..], text].concat();
        let ids = [1, 0, 1, 0];
        let texts = [text(2, b"/x"), text(3, b"cdr")].concat();
        for (opcode, body) in [
            (op::SCHEMA, [&ids[..2], &text(1 << 30, b"x")].concat()),
            (op::SCHEMA, [&ids[..2], &text(1, b"x"), &text(u32::MAX, b"")].concat()),
            (op::CHANNEL, [&ids[..], &text(2, b"/x"), &text(1 << 30, b"cdr")].concat()),
            (op::CHANNEL, [&ids[..], &texts, &text(1 << 30, b"")].concat()),
            (op::CHANNEL, [&ids[..], &texts, &text(8, &text(1 << 30, b"mr_d"))].concat()),
            (op::CHANNEL, [&ids[..], &texts, &text(8, &text(5, b"mr_da"))].concat()),
        ] {
            let (count, notes) = messages(&[message(), record(opcode, body.len() as u64, &body)].concat());
            assert_eq!(count, 1);
            assert!(notes.len() == 1 && notes[0].contains("a text is longer than its record"), "{notes:?}");
        }
    }
}
