//! zstd compression of bags, in rosbag2's modes `FILE` and `MESSAGE`.
//!
//! Damaged data are unpacked up to the damage. Memory is bounded by the window of the format (128 MiB) and by the longest
//! message that is accepted (64 MiB).

use super::RunError;
use super::whole::write_file;
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use zstd::bulk::Decompressor;
use zstd::stream::read::Decoder;
use zstd::zstd_safe::get_frame_content_size;

/// First bytes of a zstd frame. A CDR message never begins with them, because its first byte is zero.
const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Largest ratio of unpacked to packed size, above a size that is always allowed. No recording is compressed to a
/// thousandth of its size, so a larger ratio means damage or an attack.
pub(super) const UNPACK_RATIO: u64 = 1000;
/// Messages longer than this, in bytes, are not unpacked; the messages of a run have some hundred bytes.
const MESSAGE_LIMIT: usize = 64 << 20;
/// Unpacked size, in bytes, that is allowed for every message. Above it, [`UNPACK_RATIO`] limits the size.
const MESSAGE_FREE: usize = 1 << 20;
/// Base-2 logarithm of the largest window: 2^27 bytes. All levels of zstd keep to it, except with `--ultra --long`.
const WINDOW_LOG_MAX: u32 = 27;
/// zstd's own default, which is fast and close to the best compression.
const LEVEL: i32 = 3;

/// True if `data` begin like a zstd frame.
pub(super) fn is_packed(data: &[u8]) -> bool {
    data.starts_with(&MAGIC)
}

/// The unpacked data of a zstd file. They end at the first damage; [`fault`](Self::fault) returns it.
pub(super) struct Unpacked<R: BufRead> {
    decoder: Decoder<'static, R>,
    bytes: u64,
    fault: Option<String>,
}

impl<R: BufRead> Unpacked<R> {
    pub(super) fn new(source: R) -> io::Result<Self> {
        let mut decoder = Decoder::with_buffer(source)?;
        decoder.window_log_max(WINDOW_LOG_MAX)?;
        Ok(Self { decoder, bytes: 0, fault: None })
    }

    /// The fault that ended the data early, and the number of bytes before it.
    pub(super) fn fault(self) -> Option<(u64, String)> {
        self.fault.map(|why| (self.bytes, why))
    }
}

impl<R: BufRead> Read for Unpacked<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.fault.is_some() {
            return Ok(0);
        }
        match self.decoder.read(buffer) {
            Ok(count) => {
                self.bytes += count as u64;
                Ok(count)
            }
            // Errors of the system have an error number; all others are zstd's errors about the data.
            Err(error) if error.raw_os_error().is_some() || error.kind() == io::ErrorKind::Interrupted => {
                Err(error)
            }
            Err(error) => {
                self.fault = Some(error.to_string());
                Ok(0)
            }
        }
    }
}

/// A message that cannot be unpacked.
#[derive(Debug, thiserror::Error)]
pub(super) enum UnpackError {
    #[error("zstd: {0}")]
    Zstd(#[from] io::Error),
    #[error("zstd: the header of the frame is damaged")]
    Header,
    #[error("zstd: {packed} bytes unpack to more than {limit} bytes")]
    TooLong { packed: usize, limit: usize },
}

/// Unpacks messages one by one into memory that is reused.
pub(super) struct MessageUnpacker {
    bulk: Option<Decompressor<'static>>,
    buffer: Vec<u8>,
}

impl MessageUnpacker {
    pub(super) fn new() -> Self {
        Self { bulk: None, buffer: Vec::new() }
    }

    /// Unpacks the message in `data`.
    pub(super) fn unpack(&mut self, data: &[u8]) -> Result<&[u8], UnpackError> {
        self.buffer.clear();
        let ratio = usize::try_from(UNPACK_RATIO).unwrap_or(1);
        // The frame's stated size decides how much memory is allocated, so it is limited.
        let limit = ratio.saturating_mul(data.len()).clamp(MESSAGE_FREE, MESSAGE_LIMIT);
        let too_long = || UnpackError::TooLong { packed: data.len(), limit };
        let size = get_frame_content_size(data).map_err(|_| UnpackError::Header)?;
        let Some(size) = size else {
            // The writer did not know the size when it began the frame.
            let unpacked = Decoder::with_buffer(data).and_then(|mut decoder| {
                decoder.window_log_max(WINDOW_LOG_MAX)?;
                decoder.take(limit as u64 + 1).read_to_end(&mut self.buffer)
            });
            let count = unpacked?;
            return if count > limit { Err(too_long()) } else { Ok(&self.buffer) };
        };
        let size = usize::try_from(size).ok().filter(|size| *size <= limit).ok_or_else(too_long)?;
        let bulk = match &mut self.bulk {
            Some(bulk) => bulk,
            none => none.insert(Decompressor::new()?),
        };
        self.buffer.reserve(size);
        bulk.decompress_to_buffer(data, &mut self.buffer)?;
        Ok(&self.buffer)
    }
}

/// The name of a file after it is compressed.
pub(super) fn packed_name(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".zstd");
    name.into()
}

/// Compresses a whole file and removes the original; returns the size of the compressed file, in bytes. The compressed file
/// has a temporary name until it is complete and on the disk, so at any time one of the two files is complete.
pub(super) fn pack_file(path: &Path) -> Result<u64, RunError> {
    let packed = packed_name(path);
    write_file(&packed, |sink| {
        let source = BufReader::new(File::open(path).map_err(RunError::io(path, "open"))?);
        zstd::stream::copy_encode(source, sink, LEVEL).map_err(RunError::io(&packed, "write"))
    })?;
    fs::remove_file(path).map_err(RunError::io(path, "remove"))?;
    Ok(fs::metadata(&packed).map_err(RunError::io(&packed, "look at"))?.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn false_sizes_are_refused_before_memory_is_allocated() {
        let mut unpacker = MessageUnpacker::new();
        let message = [7_u8; 3000];
        let packed = zstd::bulk::compress(&message, LEVEL).expect("compressed");
        assert_eq!(unpacker.unpack(&packed).expect("unpacked"), message);
        // A frame without a size in its header.
        let unsized_frame = zstd::stream::encode_all(&message[..], LEVEL).expect("compressed");
        assert_eq!(get_frame_content_size(&unsized_frame).ok(), Some(None), "the size is not known");
        assert_eq!(unpacker.unpack(&unsized_frame).expect("unpacked"), message);
        // Frames whose headers claim 2^60 bytes and the largest allowed message.
        for size in [1_u64 << 60, MESSAGE_LIMIT as u64] {
            let mut huge = [&MAGIC[..], &[0b1110_0000]].concat();
            huge.extend(size.to_le_bytes());
            let refused = unpacker.unpack(&huge).expect_err("refused");
            assert_eq!(refused.to_string(), "zstd: 13 bytes unpack to more than 1048576 bytes");
        }
        assert!(unpacker.buffer.capacity() < MESSAGE_FREE, "{}", unpacker.buffer.capacity());
        let bomb = zstd::stream::encode_all(io::repeat(0).take(MESSAGE_LIMIT as u64 + 1), LEVEL);
        let refused = unpacker.unpack(&bomb.expect("compressed")).expect_err("refused");
        assert!(matches!(refused, UnpackError::TooLong { .. }), "{refused}");
        for damaged in [&packed[..packed.len() - 1], &MAGIC[..], &[]] {
            unpacker.unpack(damaged).expect_err("refused");
        }
    }

    #[test]
    fn a_cut_stream_ends_with_a_fault() {
        let data: Vec<u8> =
            (0..2_000_000_u32).flat_map(|n| n.wrapping_mul(2_654_435_761).to_le_bytes()).collect();
        let packed = zstd::stream::encode_all(&data[..], LEVEL).expect("compressed");
        let mut unpacked = Unpacked::new(&packed[..packed.len() / 2]).expect("begins");
        let mut got = Vec::new();
        unpacked.read_to_end(&mut got).expect("no error of the system");
        assert!(got.len() > data.len() / 4 && data.starts_with(&got), "{} bytes", got.len());
        let (bytes, why) = unpacked.fault().expect("told");
        assert_eq!(bytes, got.len() as u64);
        assert!(why.contains("incomplete"), "{why}");
    }
}
