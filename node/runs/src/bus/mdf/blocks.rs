//! The blocks of an MDF4 file (ASAM MDF 4.2): an identifier, a length, links to other blocks, and data.

use crate::RunError;
use std::cell::RefCell;
use std::collections::HashSet;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Length of a block's head, bytes.
pub(super) const HEAD: u64 = 24;
/// Largest block that describes the file, bytes. Data blocks are not limited.
const LARGEST: u64 = 16 << 20;

/// Why a block cannot be used, with the byte at which it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct BlockFault {
    pub(super) at: u64,
    pub(super) why: String,
}

/// Why reading stopped.
#[derive(Debug)]
pub(super) enum Stop {
    Damaged(BlockFault),
    Failed(RunError),
}

/// A fault at a byte of the file.
pub(super) fn damaged(at: u64, why: impl Into<String>) -> Stop {
    Stop::Damaged(BlockFault { at, why: why.into() })
}

/// The head of a block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    pub(super) id: [u8; 4],
    /// Length of the block, bytes.
    pub(super) length: u64,
    /// Number of links.
    pub(super) links: u64,
}

impl Head {
    pub(super) fn id(&self) -> String {
        self.id.escape_ascii().to_string()
    }
}

/// A block that describes the file.
pub(super) struct Block {
    pub(super) at: u64,
    pub(super) id: [u8; 4],
    links: Vec<u64>,
    data: Vec<u8>,
}

impl Block {
    /// The address that a link holds; 0 for none.
    pub(super) fn link(&self, index: usize) -> u64 {
        self.links.get(index).copied().unwrap_or(0)
    }

    pub(super) fn links(&self) -> &[u64] {
        &self.links
    }

    fn short(&self) -> Stop {
        damaged(self.at, format!("block {} is too short", self.id.escape_ascii()))
    }

    pub(super) fn u8(&self, at: usize) -> Result<u8, Stop> {
        self.data.get(at).copied().ok_or_else(|| self.short())
    }

    pub(super) fn u16(&self, at: usize) -> Result<u16, Stop> {
        self.array(at).map(u16::from_le_bytes)
    }

    pub(super) fn u32(&self, at: usize) -> Result<u32, Stop> {
        self.array(at).map(u32::from_le_bytes)
    }

    pub(super) fn u64(&self, at: usize) -> Result<u64, Stop> {
        self.array(at).map(u64::from_le_bytes)
    }

    pub(super) fn f64(&self, at: usize) -> Result<f64, Stop> {
        self.array(at).map(f64::from_le_bytes)
    }

    fn array<const N: usize>(&self, at: usize) -> Result<[u8; N], Stop> {
        let bytes = self.data.get(at..).and_then(|rest| rest.first_chunk());
        bytes.copied().ok_or_else(|| self.short())
    }
}

/// The blocks of a file.
pub(super) struct Blocks<'a, R> {
    path: &'a Path,
    source: RefCell<R>,
    /// Addresses of the blocks in lists that were read. A block belongs to one list.
    listed: RefCell<HashSet<u64>>,
    /// Size of the file, bytes.
    pub(super) size: u64,
}

impl<'a, R: Read + Seek> Blocks<'a, R> {
    pub(super) fn new(path: &'a Path, mut source: R) -> Result<Self, RunError> {
        let size = source.seek(SeekFrom::End(0)).map_err(RunError::io(path, "read"))?;
        Ok(Self { path, source: RefCell::new(source), listed: RefCell::default(), size })
    }

    /// The bytes from `at`, at most `count`, fewer at the end of the file.
    pub(super) fn bytes(&self, at: u64, count: u64) -> Result<Vec<u8>, Stop> {
        let mut bytes = Vec::new();
        let mut source = self.source.borrow_mut();
        let read = source
            .seek(SeekFrom::Start(at))
            .and_then(|_| source.by_ref().take(count).read_to_end(&mut bytes));
        read.map_err(|error: io::Error| Stop::Failed(RunError::io(self.path, "read")(error)))?;
        Ok(bytes)
    }

    /// The head of the block at `at`.
    pub(super) fn head(&self, at: u64) -> Result<Head, Stop> {
        let bytes = self.bytes(at, HEAD)?;
        let (Some(id), Some(length), Some(links)) = (
            bytes.first_chunk(),
            bytes.get(8..).and_then(|rest| rest.first_chunk()),
            bytes.get(16..).and_then(|rest| rest.first_chunk()),
        ) else {
            return Err(damaged(
                at,
                format!("a block should be there, but the file has {} bytes", self.size),
            ));
        };
        let head = Head { id: *id, length: u64::from_le_bytes(*length), links: u64::from_le_bytes(*links) };
        if !head.id.starts_with(b"##") {
            return Err(damaged(at, format!("a block should be there, but it begins with `{}`", head.id())));
        }
        Ok(head)
    }

    /// The block at `at`, which has one of these identifiers.
    pub(super) fn block(&self, at: u64, ids: &[&[u8; 4]]) -> Result<Block, Stop> {
        let head = self.head(at)?;
        if !ids.contains(&&head.id) {
            let wanted = ids.iter().map(|id| id.escape_ascii().to_string()).collect::<Vec<_>>().join(" or ");
            return Err(damaged(at, format!("block {wanted} should be there, not {}", head.id())));
        }
        let content = head.length.saturating_sub(HEAD);
        if head.links > content / 8 || content > LARGEST {
            return Err(damaged(
                at,
                format!("block {} has {} bytes and {} links", head.id(), head.length, head.links),
            ));
        }
        let bytes = self.bytes(at + HEAD, content)?;
        if (bytes.len() as u64) < content {
            return Err(damaged(at, format!("the file ends in this block {}", head.id())));
        }
        let (links, data) = bytes.split_at(8 * head.links as usize);
        let (links, _) = links.as_chunks::<8>();
        Ok(Block {
            at,
            id: head.id,
            links: links.iter().map(|link| u64::from_le_bytes(*link)).collect(),
            data: data.to_vec(),
        })
    }

    /// The text of the block at `at`: of a text block, or between the tags `TX` of a block in XML; empty if there is none.
    pub(super) fn text(&self, at: u64) -> Result<String, Stop> {
        if at == 0 {
            return Ok(String::new());
        }
        let block = self.block(at, &[b"##TX", b"##MD"])?;
        let end = block.data.iter().position(|byte| *byte == 0).unwrap_or(block.data.len());
        let text = String::from_utf8_lossy(&block.data[..end]);
        let text = match &block.id {
            b"##MD" => {
                let inner = text.split_once("<TX>").and_then(|(_, rest)| rest.split_once("</TX>"));
                inner.map_or("", |(inner, _)| inner)
            }
            _ => &text,
        };
        Ok(text.trim().to_owned())
    }

    /// The addresses of a list of blocks, whose first link is the next one; stops where the list is damaged or bites its tail.
    pub(super) fn list<T>(
        &self,
        first: u64,
        mut take: impl FnMut(u64) -> Result<(u64, T), Stop>,
    ) -> Result<(Vec<T>, Option<BlockFault>), Stop> {
        let (mut items, mut at) = (Vec::new(), first);
        while at != 0 {
            if !self.listed.borrow_mut().insert(at) {
                return Ok((
                    items,
                    Some(BlockFault { at, why: "two lists of blocks lead to this one".to_owned() }),
                ));
            }
            match take(at) {
                Ok((next, item)) => {
                    items.push(item);
                    at = next;
                }
                Err(Stop::Damaged(fault)) => return Ok((items, Some(fault))),
                Err(failed) => return Err(failed),
            }
        }
        Ok((items, None))
    }
}
