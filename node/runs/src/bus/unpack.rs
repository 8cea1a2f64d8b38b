//! Unpacks data into memory, up to a limit: zlib data (RFC 1950) of BLF and MDF4 files, and the data of other decoders.

use miniz_oxide::inflate::stream::{InflateState, inflate};
use miniz_oxide::{DataFormat, MZError, MZFlush, MZStatus};
use std::io::{self, Read};

/// Bytes by which a buffer grows at least.
pub(super) const CHUNK: usize = 64 << 10;

/// Reads the data in zlib data. miniz_oxide's own function pads the data before a fault with zeros, which would be read as values.
pub(super) struct Inflate<'a> {
    packed: &'a [u8],
    state: Box<InflateState>,
    is_ended: bool,
}

impl<'a> Inflate<'a> {
    pub(super) fn new(packed: &'a [u8]) -> Self {
        Self { packed, state: InflateState::new_boxed(DataFormat::Zlib), is_ended: false }
    }
}

impl Read for Inflate<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while !self.is_ended && !buffer.is_empty() {
            let step = inflate(&mut self.state, self.packed, buffer, MZFlush::None);
            self.packed = self.packed.get(step.bytes_consumed..).unwrap_or_default();
            self.is_ended = step.status == Ok(MZStatus::StreamEnd);
            // A fault comes again with the next call.
            if step.bytes_written > 0 {
                return Ok(step.bytes_written);
            }
            match step.status {
                Ok(_) => {}
                Err(MZError::Buf) => {
                    return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the zlib data end early"));
                }
                Err(_) => {
                    return Err(io::Error::new(io::ErrorKind::InvalidData, "wrong zlib data or checksum"));
                }
            }
        }
        Ok(0)
    }
}

/// The data of a decoder, at most `size` bytes, and the fault that ended them early. More data are a fault. The buffer grows with the
/// data, so `size` may be wrong.
pub(super) fn read_up_to(mut source: impl Read, size: usize) -> (Vec<u8>, Result<(), String>) {
    let mut data = Vec::new();
    while data.len() < size {
        let more = data.len().max(CHUNK).min(size - data.len());
        data.reserve_exact(more);
        match source.by_ref().take(more as u64).read_to_end(&mut data) {
            Ok(count) if count < more => return (data, Ok(())),
            Ok(_) => {}
            Err(error) => return (data, Err(error.to_string())),
        }
    }
    // A decoder checks sizes and checksums when it reads the end of its data.
    let ended = match io::copy(&mut source.take(1), &mut io::sink()) {
        Ok(0) => Ok(()),
        Ok(_) => Err(format!("more than {size} bytes")),
        Err(error) => Err(error.to_string()),
    };
    (data, ended)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cut_zlib_data_give_only_the_data_before_the_cut() {
        let data: Vec<u8> =
            (0..50_000_u32).flat_map(|n| n.wrapping_mul(2_654_435_761).to_le_bytes()).collect();
        let packed = miniz_oxide::deflate::compress_to_vec_zlib(&data, 6);
        assert_eq!(read_up_to(Inflate::new(&packed), data.len()), (data.clone(), Ok(())));
        for end in [0, 1, 2, 3, 100, packed.len() / 2, packed.len() - 5, packed.len() - 1] {
            let (part, fault) = read_up_to(Inflate::new(&packed[..end]), data.len());
            assert!(data.starts_with(&part) && part.len() <= end, "{end}: {} bytes", part.len());
            assert!(part.len() + 70_000 > end, "{end}: {} bytes", part.len());
            assert_eq!(fault, Err("the zlib data end early".to_owned()), "{end}");
        }
    }
}
