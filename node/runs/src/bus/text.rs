//! The lines of logs that are text: candump and ASC.

use super::frame::{BusFrame, FrameSink};
use crate::error::LineFault;
use crate::{Note, RunError};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Longest line, bytes; a frame of CAN FD has 64 data bytes and less than 500 characters.
const LONGEST: u64 = 64 << 10;
/// Number of faults of skipped lines that are kept for the note.
const FAULTS_KEPT: usize = 5;

/// Reads one format, line by line.
pub(super) trait LineReader {
    /// The frame in a line; `None` for a line without a data frame.
    fn frame<'a>(&mut self, line: &'a str, data: &'a mut Vec<u8>) -> Result<Option<BusFrame<'a>>, LineFault>;
}

/// Passes the frames of a log to `sink`. A last line without a line end is where the recording was cut off; any other bad line is an
/// error, or is left out with `skip_bad_rows`.
pub(super) fn read(
    path: &Path,
    source: impl Read,
    mut format: impl LineReader,
    skip_bad_rows: bool,
    sink: &mut impl FrameSink,
    notes: &mut Vec<Note>,
) -> Result<(), RunError> {
    let mut source = BufReader::new(source);
    let (mut text, mut data) = (Vec::new(), Vec::new());
    let (mut frames, mut skipped, mut faults) = (0_u64, 0_u64, Vec::new());
    for line in 1_u64.. {
        text.clear();
        let count =
            source.by_ref().take(LONGEST).read_until(b'\n', &mut text).map_err(RunError::io(path, "read"))?;
        if count == 0 {
            break;
        }
        let is_whole = text.ends_with(b"\n");
        let fault = if count as u64 == LONGEST && !is_whole {
            // The rest of the line would be read as further lines.
            LineFault::Long { most: LONGEST }
        } else {
            let content = text.strip_prefix(b"\xef\xbb\xbf").filter(|_| line == 1).unwrap_or(&text);
            let content = String::from_utf8_lossy(content.trim_ascii());
            match format.frame(&content, &mut data) {
                // The last number of a line that was cut off may be wrong.
                Ok(Some(_)) if !is_whole => LineFault::NoEnd,
                Ok(frame) => {
                    frames += u64::from(frame.is_some());
                    frame.iter().for_each(|frame| sink.frame(frame));
                    continue;
                }
                Err(fault) => fault,
            }
        };
        let error = RunError::LogLine { path: path.to_owned(), line, fault };
        let is_long = count as u64 == LONGEST;
        if !is_whole && !is_long {
            let RunError::LogLine { fault, .. } = error else { return Err(error) };
            notes.push(Note::LogCutShort {
                path: path.to_owned(),
                place: format!("line {line}"),
                frames,
                why: fault.to_string(),
            });
            break;
        }
        if !skip_bad_rows || is_long {
            return Err(error);
        }
        skipped += 1;
        if faults.len() < FAULTS_KEPT {
            faults.push(error.to_string());
        }
    }
    if skipped > frames {
        let first = faults.into_iter().next().unwrap_or_default();
        return Err(RunError::MostlyBad { path: path.to_owned(), skipped, kept: frames, first });
    }
    if skipped > 0 {
        notes.push(Note::RowsSkipped { count: skipped, first: faults });
    }
    Ok(())
}

/// Appends the bytes of a text of hexadecimal digits, two for each byte.
pub(super) fn push_hex(digits: &str, data: &mut Vec<u8>) -> Result<(), LineFault> {
    let fault = || LineFault::Bytes { found: super::shown(digits) };
    let bytes = digits.as_bytes();
    if !bytes.len().is_multiple_of(2) {
        return Err(fault());
    }
    for pair in bytes.chunks_exact(2) {
        let value = |digit: u8| char::from(digit).to_digit(16);
        let (Some(high), Some(low)) = (value(pair[0]), value(pair[1])) else { return Err(fault()) };
        data.push((high * 16 + low) as u8);
    }
    Ok(())
}
