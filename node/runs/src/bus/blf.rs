//! Reads Vector's binary logs (BLF).
//!
//! After a header with the start of the measurement come objects. Most are containers with zlib data, which hold further objects; an
//! object may begin in one container and end in the next. A damaged container is left out, and what a cut file still holds is read.
//! Stamps count from the start of the measurement; the time of a frame is their sum, since 1970.

use super::frame::{Bus, BusFrame, CanId, FrameSink, MOST_BYTES, Unusable};
use super::unpack::{Inflate, read_up_to};
use crate::{Note, RunError};
use std::io::Read;
use std::path::Path;

/// Length of the file header up to the start of the measurement and its end, bytes.
const FILE_HEADER: usize = 72;
/// Place of the size of the file in the file header.
const FILE_SIZE: usize = 16;
/// Place of the start of the measurement in the file header.
const START: usize = 40;
/// Length of the first part of an object's header, bytes.
const OBJECT: usize = 16;
/// Length of an object's header with its stamp, in the first version; later versions are longer.
const STAMPED: usize = 32;
/// Length of a container's fields before its data, bytes.
const CONTAINER_HEAD: usize = 16;
/// Containers and objects larger than this, packed or unpacked, in bytes, count as damaged. Writers make containers of 128 kB.
const LARGEST: usize = 32 << 20;
/// Greatest number of padding bytes between objects.
const PADDING: usize = 8;

/// The first bytes of an object.
const SIGNATURE: &[u8] = b"LOBJ";

const CAN_MESSAGE: u32 = 1;
const LOG_CONTAINER: u32 = 10;
const CAN_MESSAGE2: u32 = 86;
const CAN_FD_MESSAGE: u32 = 100;
const CAN_FD_MESSAGE_64: u32 = 101;
/// Flag of a remote frame.
const REMOTE: u8 = 0x80;
/// Flag of a remote frame in an object of the kind [`CAN_FD_MESSAGE_64`].
const REMOTE_64: u32 = 0x10;
/// Header flag of stamps in units of 10 µs; otherwise they are in ns.
const TEN_MICROSECONDS: u32 = 1;

/// Why reading stopped before the end of the file.
enum Stop {
    /// The data end or are damaged at this offset.
    Damaged(u64, String),
    Failed(RunError),
}

/// Passes the frames of a log to `sink`.
///
/// # Errors
/// When the file does not begin like BLF, or the system cannot read it.
pub(super) fn read(
    path: &Path,
    source: impl Read,
    sink: &mut impl FrameSink,
    notes: &mut Vec<Note>,
) -> Result<(), RunError> {
    let mut file = File { path, source, offset: 0 };
    let mut objects = Objects { start_ns: 0, rest: Vec::new(), is_cut: false, frames: 0, sink };
    match file.objects(&mut objects, notes) {
        Ok(()) => Ok(()),
        Err(Stop::Damaged(offset, why)) => {
            let (path, place) = (path.to_owned(), format!("byte {offset}"));
            notes.push(Note::LogCutShort { path, place, frames: objects.frames, why });
            Ok(())
        }
        Err(Stop::Failed(error)) => Err(error),
    }
}

struct File<'a, R> {
    path: &'a Path,
    source: R,
    /// Number of bytes read.
    offset: u64,
}

impl<R: Read> File<'_, R> {
    fn objects(
        &mut self,
        objects: &mut Objects<'_, impl FrameSink>,
        notes: &mut Vec<Note>,
    ) -> Result<(), Stop> {
        let header = self.take(FILE_HEADER)?;
        if !header.starts_with(b"LOGG") || header.len() < FILE_HEADER {
            let why = match header.len() {
                0 => "it is empty".to_owned(),
                count if header.starts_with(b"LOGG") => format!("it ends after {count} bytes"),
                _ => format!("it begins with `{}`", header[..header.len().min(8)].escape_ascii()),
            };
            let (path, format) = (self.path.to_owned(), "a BLF file");
            return Err(Stop::Failed(RunError::NotABag { path, format, why }));
        }
        objects.start_ns = start_ns(&header);
        let more = (u32_at(&header, 4).unwrap_or(0) as usize).clamp(FILE_HEADER, LARGEST) - FILE_HEADER;
        if self.take(more)?.len() < more {
            return Err(Stop::Damaged(self.offset, "the file ends in its header".to_owned()));
        }
        while let Some(head) = self.object_head()? {
            let at = self.offset - OBJECT as u64;
            let size = u32_at(&head, 8).unwrap_or(0) as usize;
            if !(OBJECT..=LARGEST).contains(&size) {
                return Err(Stop::Damaged(at, format!("an object of {size} bytes")));
            }
            let body = self.take(size - OBJECT)?;
            let is_whole = body.len() == size - OBJECT;
            if u32_at(&head, 12) == Some(LOG_CONTAINER) {
                let unpacked = container(&body);
                let (data, mut fault) = unpacked.unwrap_or_else(|why| (Vec::new(), Some(why)));
                if !objects.add(&data) {
                    fault.get_or_insert_with(|| "no object begins where one should".to_owned());
                }
                if let (Some(why), true) = (fault, is_whole) {
                    objects.is_cut = true;
                    notes.push(Note::ChunkDamaged { path: self.path.to_owned(), offset: at, why });
                }
            } else if is_whole {
                objects.object(&[head, body].concat());
            }
            if !is_whole {
                return Err(Stop::Damaged(at, "the file ends inside an object".to_owned()));
            }
        }
        // The recorder writes the size at its end, so it is 0 or too small in a file that was not finished.
        let size = u64_at(&header, FILE_SIZE).unwrap_or(0);
        if size > self.offset + PADDING as u64 {
            return Err(Stop::Damaged(
                self.offset,
                format!("the file ends, and its header says {size} bytes"),
            ));
        }
        Ok(())
    }

    /// The head of the next object after its padding; `None` at the end of the file.
    fn object_head(&mut self) -> Result<Option<Vec<u8>>, Stop> {
        let mut head = self.take(OBJECT)?;
        for _ in 0..=PADDING {
            if head.starts_with(SIGNATURE) && head.len() == OBJECT {
                return Ok(Some(head));
            }
            if head.len() < OBJECT {
                let is_padding = head.iter().all(|byte| *byte == 0);
                let at = self.offset - head.len() as u64;
                return if is_padding {
                    Ok(None)
                } else {
                    Err(Stop::Damaged(at, "the file ends inside an object".to_owned()))
                };
            }
            head.remove(0);
            head.append(&mut self.take(1)?);
        }
        Err(Stop::Damaged(self.offset - (OBJECT + PADDING) as u64, "no object begins there".to_owned()))
    }

    /// The next `count` bytes, or fewer at the end of the file. Memory grows with the content of the file only.
    fn take(&mut self, count: usize) -> Result<Vec<u8>, Stop> {
        let mut bytes = Vec::new();
        let read = self.source.by_ref().take(count as u64).read_to_end(&mut bytes);
        read.map_err(|error| Stop::Failed(RunError::io(self.path, "read")(error)))?;
        self.offset += bytes.len() as u64;
        Ok(bytes)
    }
}

/// The unpacked data of a container, and the fault if it is damaged after them.
fn container(body: &[u8]) -> Result<(Vec<u8>, Option<String>), String> {
    let (Some(method), Some(size)) = (u16_at(body, 0), u32_at(body, 8)) else {
        return Err("it is too short".to_owned());
    };
    let data = body.get(CONTAINER_HEAD..).unwrap_or_default();
    match method {
        0 => Ok((data.to_vec(), None)),
        2 if size as usize > LARGEST => Err(format!("its data have {size} bytes")),
        2 => {
            let (data, ended) = read_up_to(Inflate::new(data), size as usize);
            Ok((data, ended.err().map(|why| format!("its zlib data are damaged ({why})"))))
        }
        other => Err(format!("its compression {other} is not known (0, none, and 2, zlib, are)")),
    }
}

/// The objects in the containers, which may cross from one container to the next.
struct Objects<'a, S> {
    start_ns: i64,
    /// The beginning of an object that the next container ends.
    rest: Vec<u8>,
    /// True after a damaged container: the next one begins inside an object.
    is_cut: bool,
    frames: u64,
    sink: &'a mut S,
}

impl<S: FrameSink> Objects<'_, S> {
    /// Takes the data of a container. False if an object should begin in them and does not; the next one is searched then.
    fn add(&mut self, data: &[u8]) -> bool {
        if self.is_cut {
            self.rest.clear();
        }
        self.rest.extend_from_slice(data);
        let all = std::mem::take(&mut self.rest);
        let (mut at, mut is_good) = (0, true);
        loop {
            let left = &all[at..];
            let window = if self.is_cut { left.len() } else { left.len().min(PADDING + SIGNATURE.len()) };
            let begin = left[..window].windows(SIGNATURE.len()).position(|four| four == SIGNATURE);
            let Some(begin) = begin else {
                if !self.is_cut && window < PADDING + SIGNATURE.len() {
                    self.rest = left.to_vec();
                    return is_good;
                }
                if self.is_cut {
                    return is_good;
                }
                (self.is_cut, is_good) = (true, false);
                continue;
            };
            let object = &left[begin..];
            let Some(size) = u32_at(object, 8).map(|size| size as usize) else {
                self.rest = object.to_vec();
                return is_good;
            };
            if !(OBJECT..=LARGEST).contains(&size) {
                (self.is_cut, is_good) = (true, false);
                at += begin + SIGNATURE.len();
                continue;
            }
            if object.len() < size {
                self.rest = object.to_vec();
                self.is_cut = false;
                return is_good;
            }
            self.is_cut = false;
            self.object(&object[..size]);
            at += begin + size;
        }
    }

    /// Takes an object; others than data frames are left out.
    fn object(&mut self, object: &[u8]) {
        let Some((nanos, bus, id, data)) = frame_of(object, self.start_ns) else { return };
        let Some(id) = id else { return self.sink.unusable(Unusable::Identifier) };
        self.frames += 1;
        self.sink.frame(&BusFrame { nanos, bus: Bus::Number(bus), id, data: &data });
    }
}

/// Time, bus, identifier and data of a data frame; `None` for another object. An identifier that cannot be is `None`.
fn frame_of(object: &[u8], start_ns: i64) -> Option<(i64, u32, Option<CanId>, Vec<u8>)> {
    let head = usize::from(u16_at(object, 4)?);
    let kind = u32_at(object, 12)?;
    let unit = if u32_at(object, OBJECT)? == TEN_MICROSECONDS { 10_000 } else { 1 };
    let stamp = i64::try_from(u64_at(object, OBJECT + 8)?).ok()?;
    let nanos = stamp.checked_mul(unit)?.checked_add(start_ns)?;
    let body = object.get(head.max(STAMPED)..)?;
    let (bus, flags, count, marked, data) = match kind {
        CAN_MESSAGE | CAN_MESSAGE2 => {
            let length = usize::from(*body.get(3)?).min(8);
            (u32::from(u16_at(body, 0)?), body[2], length, u32_at(body, 4)?, body.get(8..)?)
        }
        CAN_FD_MESSAGE => (
            u32::from(u16_at(body, 0)?),
            body[2],
            usize::from(*body.get(14)?),
            u32_at(body, 4)?,
            body.get(20..)?,
        ),
        CAN_FD_MESSAGE_64 => {
            let is_remote = u32_at(body, 12)? & REMOTE_64 != 0;
            let flags = if is_remote { REMOTE } else { 0 };
            let extension = usize::from(*body.get(35)?);
            let end = if extension == 0 { object.len() } else { extension.min(object.len()) };
            let begin = object.len() - body.len() + 40;
            let data = object.get(begin..end).unwrap_or_default();
            (u32::from(body[0]), flags, usize::from(body[2]), u32_at(body, 4)?, data)
        }
        _ => return None,
    };
    if flags & REMOTE != 0 || count > MOST_BYTES {
        return None;
    }
    let mut data = data[..data.len().min(count)].to_vec();
    // Vector's library pads data that are shorter than their stated length.
    data.resize(count, 0);
    Some((nanos, bus, CanId::of_marked(marked), data))
}

/// The start of the measurement, ns since 1970, in the header of a file; 0 if it holds none. It is a date in UTC with
/// milliseconds (SYSTEMTIME of Windows).
fn start_ns(header: &[u8]) -> i64 {
    let part = |index: usize| u16_at(header, START + 2 * index).map(i64::from).unwrap_or(0);
    let (year, month, day) = (part(0), part(1), part(3));
    let (hour, minute, second, milli) = (part(4), part(5), part(6), part(7));
    let is_date = (1970..=2200).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    if !is_date || hour > 23 || minute > 59 || second > 59 || milli > 999 {
        return 0;
    }
    (((days_since_1970(year, month, day) * 24 + hour) * 60 + minute) * 60 + second) * 1_000_000_000
        + milli * 1_000_000
}

/// Days from 1970-01-01 to a date of the Gregorian calendar. March begins the year here, so that the leap day ends it.
const fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let months = (month + 9) % 12;
    let day_of_year = (153 * months + 2) / 5 + day - 1;
    365 * year + year / 4 - year / 100 + year / 400 + day_of_year - 719_468
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|two| u16::from_le_bytes(*two))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|four| u32::from_le_bytes(*four))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..)?.first_chunk().map(|eight| u64::from_le_bytes(*eight))
}
