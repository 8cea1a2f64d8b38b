//! Packed blocks of an MDF4 file (ASAM MDF 4.3): deflate, zstd or LZ4, each with or without a transposition.
//!
//! The data of zstd and LZ4 are whole frames of these formats. Memory is bounded by [`UNPACKED`], whatever a block or a frame states: the
//! buffer grows with the data that arrive, up to the size that the block states.
//!
//! Of a block that the file ends in, the data before the end are read. A damaged block gives no data, because only the end of what was
//! unpacked is known to be damaged, and bytes before it may be wrong as well.

use super::super::unpack::{Inflate, read_up_to};
use super::blocks::{Blocks, HEAD, Stop, damaged};
use lz4_flex::frame::FrameDecoder;
use std::io::{Read, Seek};
use zstd::stream::read::Decoder;

/// Base-2 logarithm of [`UNPACKED`], and of the largest window of zstd. Levels above 20 have larger windows, but only for larger blocks.
const UNPACKED_LOG: u32 = 25;
/// Largest block, packed or unpacked, bytes. The standard allows 4 MiB.
const UNPACKED: u64 = 1 << UNPACKED_LOG;
/// Length of the fields of a packed block before its data, bytes.
const PACKED_HEAD: u64 = 24;

/// How the data of a block are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Method {
    Deflate,
    Zstd,
    Lz4,
}

impl Method {
    /// Method and transposition with this number in the file.
    fn of(kind: u8) -> Option<(Self, bool)> {
        let method = match kind / 2 {
            0 => Self::Deflate,
            1 => Self::Zstd,
            2 => Self::Lz4,
            _ => return None,
        };
        Some((method, kind % 2 == 1))
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Deflate => "deflate",
            Self::Zstd => "zstd",
            Self::Lz4 => "LZ4",
        }
    }

    /// The unpacked data, at most `size` bytes, and the fault that ended them early.
    fn unpacked(self, packed: &[u8], size: usize) -> (Vec<u8>, Result<(), String>) {
        match self {
            Self::Deflate => read_up_to(Inflate::new(packed), size),
            Self::Zstd => {
                let decoder = Decoder::with_buffer(packed).and_then(|mut decoder| {
                    decoder.window_log_max(UNPACKED_LOG)?;
                    Ok(decoder)
                });
                match decoder {
                    Ok(decoder) => read_up_to(decoder, size),
                    Err(error) => (Vec::new(), Err(error.to_string())),
                }
            }
            Self::Lz4 => read_up_to(FrameDecoder::new(packed), size),
        }
    }
}

/// The fields of a packed block before its data.
struct Fields {
    /// Method and transposition.
    kind: u8,
    /// Bytes of a row of transposed data.
    columns: u32,
    /// Bytes of the unpacked data.
    unpacked: u64,
    /// Bytes of the packed data.
    size: u64,
}

impl Fields {
    fn of(bytes: &[u8]) -> Option<Self> {
        let word = |from: usize| bytes.get(from..)?.first_chunk().map(|four| u32::from_le_bytes(*four));
        let long = |from: usize| bytes.get(from..)?.first_chunk().map(|eight| u64::from_le_bytes(*eight));
        Some(Self { kind: *bytes.get(2)?, columns: word(4)?, unpacked: long(8)?, size: long(16)? })
    }
}

/// Passes the data of the packed block at `at` to `take`.
pub(super) fn packed<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    at: u64,
    take: &mut impl FnMut(&[u8]) -> Result<(), Stop>,
) -> Result<(), Stop> {
    let Some(fields) = Fields::of(&blocks.bytes(at + HEAD, PACKED_HEAD)?) else {
        return Err(damaged(at, "the file ends in this block ##DZ"));
    };
    let Fields { kind, columns, unpacked, size } = fields;
    if unpacked > UNPACKED || size > UNPACKED {
        let why = format!(
            "a packed block of {size} bytes for {unpacked} bytes, of which at most {UNPACKED} are read"
        );
        return Err(damaged(at, why));
    }
    let Some((method, is_transposed)) = Method::of(kind) else {
        let why = format!(
            "packed by method {kind}, which is not read (deflate, zstd and LZ4 are); save it without, for example with asammdf"
        );
        return Err(damaged(at, why));
    };
    let bytes = blocks.bytes(at + HEAD + PACKED_HEAD, size)?;
    let is_cut = (bytes.len() as u64) < size;
    let (data, ended) = method.unpacked(&bytes, unpacked as usize);
    drop(bytes);
    if is_cut {
        // Transposed data cannot be used in part.
        if !is_transposed {
            take(&data)?;
        }
        return Err(damaged(at, format!("the file ends in data that are packed with {}", method.name())));
    }
    let name = method.name();
    if let Err(why) = ended {
        return Err(damaged(at, format!("the data of this block, packed with {name}, are damaged: {why}")));
    }
    if data.len() as u64 != unpacked {
        let why = format!(
            "the data of this block, packed with {name}, are {} bytes in place of {unpacked}",
            data.len()
        );
        return Err(damaged(at, why));
    }
    take(&if is_transposed { rows(&data, columns as usize) } else { data })
}

/// Undoes a transposition: `data` holds the first byte of each row of `columns` bytes, then the second, and so on. The bytes of a last
/// row that is not full are at the end.
fn rows(data: &[u8], columns: usize) -> Vec<u8> {
    if columns == 0 {
        return data.to_vec();
    }
    let count = data.len() / columns;
    let (whole, rest) = data.split_at(count * columns);
    let mut out = Vec::with_capacity(data.len());
    for row in 0..count {
        out.extend((0..columns).map(|column| whole[column * count + row]));
    }
    out.extend_from_slice(rest);
    out
}

#[cfg(test)]
mod tests {
    use super::super::super::unpack::CHUNK;
    use super::super::blocks::BlockFault;
    use super::*;
    use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
    use std::io;
    use std::path::Path;

    const ALL: [Method; 3] = [Method::Deflate, Method::Zstd, Method::Lz4];

    #[test]
    fn a_transposition_is_undone() {
        // Rows of three bytes: abc, def; and g.
        assert_eq!(rows(b"adbecfg", 3), b"abcdefg");
        assert_eq!(rows(b"ab", 3), b"ab");
        assert_eq!(rows(b"ab", 0), b"ab");
    }

    /// Bytes that no method packs well.
    fn mixed(count: u32) -> Vec<u8> {
        (0..count).flat_map(|n| n.wrapping_mul(2_654_435_761).to_le_bytes()).collect()
    }

    fn compressed(method: Method, data: &[u8]) -> Vec<u8> {
        match method {
            Method::Deflate => miniz_oxide::deflate::compress_to_vec_zlib(data, 6),
            Method::Zstd => zstd::bulk::compress(data, 3).expect("packed"),
            Method::Lz4 => {
                // As the default of the LZ4 library: blocks of 64 KiB that refer to those before.
                let info = FrameInfo::new().block_size(BlockSize::Max64KB).block_mode(BlockMode::Linked);
                let mut encoder = FrameEncoder::with_frame_info(info, Vec::new());
                io::Write::write_all(&mut encoder, data).expect("packed");
                encoder.finish().expect("packed")
            }
        }
    }

    /// A packed block with these fields.
    fn block(kind: u8, columns: u32, unpacked: u64, size: u64, data: &[u8]) -> Vec<u8> {
        let length = HEAD + PACKED_HEAD + data.len() as u64;
        let fields =
            [&b"DT"[..], &[kind, 0], &columns.to_le_bytes(), &unpacked.to_le_bytes(), &size.to_le_bytes()];
        [b"##DZ\0\0\0\0", &length.to_le_bytes()[..], &[0; 8], &fields.concat(), data].concat()
    }

    /// The data of the block at the beginning of the file, and the fault that ended it.
    fn read(file: Vec<u8>) -> (Vec<u8>, Option<BlockFault>) {
        let blocks = Blocks::new(Path::new("x.mf4"), io::Cursor::new(file)).expect("in memory");
        let mut data = Vec::new();
        let ended = packed(&blocks, 0, &mut |part| {
            data.extend_from_slice(part);
            Ok(())
        });
        match ended {
            Ok(()) => (data, None),
            Err(Stop::Damaged(fault)) => (data, Some(fault)),
            Err(Stop::Failed(error)) => panic!("{error}"),
        }
    }

    // Written by Python's zlib, zstd 1.5.7.2 (`zstd.compress(data, 1)`) and lz4 4.4.5 (`lz4.frame.compress(data)`, and with both checksums).
    #[test]
    fn frames_of_other_implementations_are_read() {
        let data = b"damper ".repeat(6);
        for (kind, hex) in [
            (0, "789c4b49cc2d482d5248214c0100537e0f97"),
            (2, "28b52ffd202a6d00003864616d706572200100441623"),
            (4, "04224d1868402a00000000000000cf110000007f64616d7065722007000b506d7065722000000000"),
            (
                4,
                "04224d187c402a0000000000000092110000007f64616d7065722007000b506d706572203a6b612c000000006544db64",
            ),
        ] {
            let packed: Vec<u8> = (0..hex.len())
                .step_by(2)
                .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hex"))
                .collect();
            let file = block(kind, 0, data.len() as u64, packed.len() as u64, &packed);
            assert_eq!(read(file), (data.clone(), None), "kind {kind}: {hex}");
        }
    }

    #[test]
    fn each_method_is_read_with_and_without_transposition() {
        let data = mixed(100_003);
        let columns = 7;
        let count = data.len() / columns;
        let mut transposed = Vec::new();
        (0..columns).for_each(|column| transposed.extend((0..count).map(|row| data[row * columns + column])));
        transposed.extend(&data[count * columns..]);
        for (number, method) in (0_u8..).zip(ALL) {
            for (kind, content) in [(2 * number, &data), (2 * number + 1, &transposed)] {
                let packed = compressed(method, content);
                let file = block(kind, columns as u32, data.len() as u64, packed.len() as u64, &packed);
                assert!(read(file) == (data.clone(), None), "kind {kind}");
            }
        }
    }

    #[test]
    fn of_a_cut_block_the_data_before_the_cut_are_read() {
        let data = mixed(100_003);
        for (number, method) in (0_u8..).zip(ALL) {
            let packed = compressed(method, &data);
            let size = packed.len() as u64;
            let cut = |kind, end: usize| read(block(kind, 4, data.len() as u64, size, &packed[..end]));
            let (part, fault) = cut(2 * number, packed.len() / 2);
            assert!(
                part.len() > data.len() / 4 && data.starts_with(&part),
                "{method:?}: {} bytes",
                part.len()
            );
            let fault = fault.expect("told");
            assert_eq!(
                (fault.at, fault.why),
                (0, format!("the file ends in data that are packed with {}", method.name()))
            );
            let (none, fault) = cut(2 * number + 1, packed.len() - 1);
            assert!(none.is_empty() && fault.is_some(), "{method:?}");
        }
    }

    #[test]
    fn a_damaged_block_gives_no_data() {
        let data = mixed(5000);
        for (number, method) in (0_u8..).zip(ALL) {
            let packed = compressed(method, &data);
            let (true_size, size) = (data.len() as u64, packed.len() as u64);
            let kind = 2 * number;
            let of_byte = |at: usize, change: u8| {
                let mut changed = packed.clone();
                changed[at] ^= change;
                block(kind, 0, true_size, size, &changed)
            };
            for (file, why) in [
                (of_byte(0, 0xff), "are damaged: "),
                (block(kind, 0, true_size, size - 6, &packed[..packed.len() - 6]), "are "),
                (block(kind, 0, true_size + 1, size, &packed), "are 20000 bytes in place of 20001"),
                (block(kind, 0, true_size - 1, size, &packed), "are damaged: "),
                (block(kind, 0, 0, size, &packed), "are damaged: "),
                (block(kind, 0, true_size, 0, &packed), "are "),
                (block(kind, 0, u64::MAX, size, &packed), "of which at most 33554432 are read"),
                (block(kind, 0, true_size, 1 << 60, &packed), "of which at most 33554432 are read"),
                (
                    block(kind + 6, 0, true_size, size, &packed),
                    "which is not read (deflate, zstd and LZ4 are)",
                ),
                (block(kind, 0, true_size, size, &packed)[..40].to_vec(), "the file ends in this block ##DZ"),
            ] {
                let (found, fault) = read(file);
                assert!(found.is_empty(), "{method:?}, {why}: {} bytes", found.len());
                let said = fault.expect(why).why;
                assert!(said.contains(why), "{method:?}: {said}");
                assert!(
                    why.ends_with("are read")
                        || why.contains("not read")
                        || why.contains("##DZ")
                        || said.contains(method.name()),
                    "{said}"
                );
            }
        }
    }

    #[test]
    fn a_checksum_that_differs_is_a_fault() {
        let data = mixed(5000);
        let mut encoder = zstd::bulk::Compressor::new(3).expect("a compressor");
        encoder.include_checksum(true).expect("an option");
        let of_zstd = encoder.compress(&data).expect("packed");
        let info = FrameInfo::new().content_checksum(true);
        let mut encoder = FrameEncoder::with_frame_info(info, Vec::new());
        io::Write::write_all(&mut encoder, &data).expect("packed");
        let of_lz4 = encoder.finish().expect("packed");
        for (kind, packed) in [(0, compressed(Method::Deflate, &data)), (2, of_zstd), (4, of_lz4)] {
            let size = packed.len() as u64;
            assert_eq!(
                read(block(kind, 0, data.len() as u64, size, &packed)),
                (data.clone(), None),
                "{kind}"
            );
            let mut changed = packed;
            let last = changed.len() - 1;
            changed[last] ^= 1;
            let (found, fault) = read(block(kind, 0, data.len() as u64, size, &changed));
            assert!(found.is_empty() && fault.is_some(), "{kind}: {} bytes", found.len());
        }
    }

    #[test]
    fn a_false_size_does_not_decide_how_much_memory_is_allocated() {
        for method in ALL {
            let (data, ended) = method.unpacked(&compressed(method, b"few bytes"), UNPACKED as usize);
            assert_eq!((&data[..], ended), (&b"few bytes"[..], Ok(())), "{method:?}");
            assert!(data.capacity() <= CHUNK, "{method:?}: {} bytes", data.capacity());
            // More data than the block states: no more than that is unpacked.
            let zeros = compressed(method, &vec![0; 10 << 20]);
            let (data, ended) = method.unpacked(&zeros, 100_000);
            assert!(data.capacity() <= 100_000, "{method:?}: {} bytes", data.capacity());
            ended.expect_err("told");
        }
        // A frame of zstd that asks for a window of 2 GiB, and one whose data have 2^60 bytes.
        let window = [&[0x28, 0xb5, 0x2f, 0xfd, 0x00, 0xa8][..], &[0; 16]].concat();
        let content = [&[0x28, 0xb5, 0x2f, 0xfd, 0xe0][..], &(1_u64 << 60).to_le_bytes(), &[0; 16]].concat();
        for frame in [window, content] {
            let (data, ended) = Method::Zstd.unpacked(&frame, UNPACKED as usize);
            assert!(data.is_empty());
            let why = ended.expect_err("refused");
            assert!(why.contains("too much memory"), "{why}");
        }
    }
}
