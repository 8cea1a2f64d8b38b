//! Numbers of lines. The library's numbers are too small after blank lines and in files with CRLF, because a record begins where the
//! one before ends.

use memchr::memchr2;
use std::collections::VecDeque;
use std::io::{self, Read};

/// A reader that notes where lines begin.
pub(super) struct Lines<R> {
    inner: R,
    /// Number of bytes that were read.
    offset: u64,
    /// The line of the next byte, from 1.
    line: u64,
    /// The next byte begins a line.
    begins: bool,
    after_cr: bool,
    /// First byte and number of each line that is not blank and was not asked for.
    starts: VecDeque<(u64, u64)>,
}

impl<R> Lines<R> {
    /// A reader whose first line has the number `line`.
    pub(super) const fn from_line(inner: R, line: u64) -> Self {
        Self { inner, offset: 0, line, begins: true, after_cr: false, starts: VecDeque::new() }
    }

    /// The line of a record that begins at `offset`, or after blank lines from there on. Offsets must not decrease.
    pub(super) fn of_record(&mut self, offset: u64) -> u64 {
        while self.starts.pop_front_if(|(start, _)| *start < offset).is_some() {}
        self.starts.front().map_or(self.line, |(_, line)| *line)
    }

    fn note(&mut self, byte: u8) {
        match byte {
            // CRLF ends one line.
            b'\n' if self.after_cr => {}
            b'\n' | b'\r' => {
                self.line += 1;
                self.begins = true;
            }
            _ if self.begins => {
                self.starts.push_back((self.offset, self.line));
                self.begins = false;
            }
            _ => {}
        }
        self.after_cr = byte == b'\r';
        self.offset += 1;
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        let mut rest = &buffer[..count];
        while let Some((first, after)) = rest.split_first() {
            // Within a line, only its end matters.
            let skipped = match self.begins || self.after_cr {
                true => 0,
                false => memchr2(b'\n', b'\r', rest).unwrap_or(rest.len()),
            };
            if skipped == 0 {
                self.note(*first);
                rest = after;
            } else {
                self.offset += skipped as u64;
                rest = &rest[skipped..];
            }
        }
        Ok(count)
    }
}
