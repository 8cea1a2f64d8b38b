//! The data of a data group: one block, or a list of blocks, packed or not, as one stream of bytes.

use super::blocks::{BlockFault, Blocks, HEAD, Stop, damaged};
use super::packed::packed;
use std::collections::HashSet;
use std::io::{Read, Seek};

/// Bytes that are read at once.
const CHUNK: u64 = 64 << 10;

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
