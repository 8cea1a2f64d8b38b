//! The beginning of a CSV file: comments, and the first line below them.

use super::header::without_bom;
use csv::{ByteRecord, ReaderBuilder, Trim};
use std::io::{BufRead, Read};

/// The beginning of a file.
pub(super) struct Begin {
    /// The first line that is neither blank nor a comment, from 1.
    pub(super) line: u64,
    /// Its text; empty at the end of the file.
    pub(super) text: Vec<u8>,
    /// The last comment above it: its line and its fields.
    pub(super) comment: Option<(u64, ByteRecord)>,
}

impl Begin {
    pub(super) fn read(source: &mut impl BufRead) -> std::io::Result<Self> {
        let mut begin = Self { line: 1, text: Vec::new(), comment: None };
        loop {
            begin.text.clear();
            let is_end = source.read_until(b'\n', &mut begin.text)? == 0;
            let content = if begin.line == 1 { without_bom(&begin.text) } else { &begin.text[..] };
            let content = content.trim_ascii();
            if content.starts_with(b"#") {
                let mut fields = ByteRecord::new();
                records(content).read_byte_record(&mut fields)?;
                begin.comment = Some((begin.line, fields));
            } else if is_end || !content.is_empty() {
                return Ok(begin);
            }
            begin.line += 1;
        }
    }
}

/// A reader of records.
pub(super) fn records<R: Read>(source: R) -> csv::Reader<R> {
    // `flexible`, because rows of the wrong length are reported here, with line and column.
    ReaderBuilder::new().has_headers(false).flexible(true).trim(Trim::All).from_reader(source)
}
