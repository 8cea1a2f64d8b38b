//! The data of a data group: one block, or a list of blocks, packed or not, as one stream of bytes.

use super::blocks::{BlockFault, Blocks, HEAD, Stop, damaged};
use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;
use std::collections::HashSet;
use std::io::{Read, Seek};

/// Bytes that are read at once.
const CHUNK: u64 = 64 << 10;
/// Largest unpacked block, bytes. The standard allows 4 MiB.
const UNPACKED: u64 = 32 << 20;
/// Length of the fields of a packed block before its data, bytes.
const PACKED_HEAD: u64 = 24;

/// Passes the bytes of the data at `first` to `take`, in parts. Returns the fault at which they end, if they end early.
/// With `is_open`, a data block without length ends with the file.
pub(super) fn stream<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    first: u64,
    is_open: bool,
    mut take: impl FnMut(&[u8]) -> Result<(), Stop>,
) -> Result<Option<BlockFault>, Stop> {
    let ended = parts(blocks, first, is_open, &mut HashSet::new(), &mut take);
    match ended {
        Ok(()) => Ok(None),
        Err(Stop::Damaged(fault)) => Ok(Some(fault)),
        Err(failed) => Err(failed),
    }
}

fn parts<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    first: u64,
    is_open: bool,
    visited: &mut HashSet<u64>,
    take: &mut impl FnMut(&[u8]) -> Result<(), Stop>,
) -> Result<(), Stop> {
    let mut at = first;
    while at != 0 {
        if !visited.insert(at) {
            return Err(damaged(at, "a list of data blocks leads back to this one"));
        }
        let head = blocks.head(at)?;
        match &head.id {
            b"##DT" | b"##SD" | b"##DV" | b"##RD" => return plain(blocks, at, head.length, is_open, take),
            b"##DZ" => return packed(blocks, at, take),
            b"##HL" => at = blocks.block(at, &[b"##HL"])?.link(0),
            b"##DL" | b"##LD" => {
                let list = blocks.block(at, &[b"##DL", b"##LD"])?;
                for &part in list.links().iter().skip(1).filter(|part| **part != 0) {
                    if !visited.insert(part) {
                        return Err(damaged(part, "a list of data blocks leads back to this one"));
                    }
                    let head = blocks.head(part)?;
                    match &head.id {
                        b"##DZ" => packed(blocks, part, take)?,
                        b"##DT" | b"##SD" | b"##DV" | b"##RD" => {
                            plain(blocks, part, head.length, is_open, take)?
                        }
                        _ => {
                            return Err(damaged(
                                part,
                                format!("data should be there, not a block {}", head.id()),
                            ));
                        }
                    }
                }
                at = list.link(0);
            }
            _ => return Err(damaged(at, format!("data should be there, not a block {}", head.id()))),
        }
    }
    Ok(())
}

fn plain<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    at: u64,
    length: u64,
    is_open: bool,
    take: &mut impl FnMut(&[u8]) -> Result<(), Stop>,
) -> Result<(), Stop> {
    let begin = at + HEAD;
    let end = if is_open && length <= HEAD { blocks.size } else { at.saturating_add(length) };
    let mut from = begin;
    while from < end {
        let bytes = blocks.bytes(from, CHUNK.min(end - from))?;
        if bytes.is_empty() {
            return Err(damaged(from, "the file ends in the data"));
        }
        take(&bytes)?;
        from += bytes.len() as u64;
    }
    Ok(())
}

fn packed<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    at: u64,
    take: &mut impl FnMut(&[u8]) -> Result<(), Stop>,
) -> Result<(), Stop> {
    let fields = blocks.bytes(at + HEAD, PACKED_HEAD)?;
    let word = |from: usize| {
        fields.get(from..).and_then(|rest| rest.first_chunk()).map(|four| u32::from_le_bytes(*four))
    };
    let long = |from: usize| {
        fields.get(from..).and_then(|rest| rest.first_chunk()).map(|eight| u64::from_le_bytes(*eight))
    };
    let (Some(&kind), Some(columns), Some(unpacked), Some(size)) =
        (fields.get(2), word(4), long(8), long(16))
    else {
        return Err(damaged(at, "the file ends in this block ##DZ"));
    };
    if unpacked > UNPACKED || size > UNPACKED {
        return Err(damaged(at, format!("a packed block of {size} bytes for {unpacked} bytes")));
    }
    if kind > 1 {
        let name = match kind {
            2 | 3 => "zstd".to_owned(),
            4 | 5 => "LZ4".to_owned(),
            other => other.to_string(),
        };
        let why = format!(
            "packed with {name}, which is not read (deflate is); save it without, for example with asammdf"
        );
        return Err(damaged(at, why));
    }
    let bytes = blocks.bytes(at + HEAD + PACKED_HEAD, size)?;
    let is_cut = (bytes.len() as u64) < size;
    match decompress_to_vec_zlib_with_limit(&bytes, unpacked as usize) {
        Ok(data) if data.len() as u64 == unpacked => {
            take(&if kind == 1 { rows(&data, columns as usize) } else { data })
        }
        Ok(data) => {
            Err(damaged(at, format!("a packed block holds {} bytes in place of {unpacked}", data.len())))
        }
        Err(error) => {
            // Transposed data cannot be used in part.
            if kind == 0 {
                take(&error.output)?;
            }
            Err(damaged(
                at,
                if is_cut {
                    "the file ends in packed data".to_owned()
                } else {
                    "packed data are damaged".to_owned()
                },
            ))
        }
    }
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
    use super::*;

    #[test]
    fn a_transposition_is_undone() {
        // Rows of three bytes: abc, def; and g.
        assert_eq!(rows(b"adbecfg", 3), b"abcdefg");
        assert_eq!(rows(b"ab", 3), b"ab");
        assert_eq!(rows(b"ab", 0), b"ab");
    }
}
