//! The content of an MDF4 file: data groups, channel groups with one kind of record each, and channels.

use super::blocks::{Block, BlockFault, Blocks, Stop, damaged};
use super::value::{Conversion, Kind, Place};
use std::io::{Read, Seek};

/// Deepest nesting of structures of channels.
const DEEPEST: usize = 8;
/// Flag of a channel group whose records have variable length.
const VARIABLE: u16 = 1;
/// Flag of a channel group whose time is in another group.
const REMOTE_MASTER: u16 = 8;

/// A data group: records of one or several channel groups.
pub(super) struct DataGroup {
    /// Address of the data; 0 for none.
    pub(super) data: u64,
    /// Number of bytes of the record number before each record.
    pub(super) id_bytes: usize,
    pub(super) groups: Vec<ChannelGroup>,
}

/// A channel group: one kind of record.
pub(super) struct ChannelGroup {
    pub(super) at: u64,
    pub(super) record_id: u64,
    /// Number of records; in files that were not finished, it may be 0.
    pub(super) records: u64,
    /// Number of bytes of a record.
    pub(super) bytes: usize,
    /// Number of further bytes with the bits that mark values as not valid.
    pub(super) invalidation_bytes: usize,
    /// True if a record is a length and so many bytes.
    pub(super) is_variable: bool,
    pub(super) has_remote_master: bool,
    /// Name of the acquisition; may be empty.
    pub(super) acquisition: String,
    /// Where the records come from, if the file says it.
    pub(super) source: Option<Source>,
    pub(super) channels: Vec<Channel>,
}

/// A source of acquisition, such as a bus.
pub(super) struct Source {
    pub(super) name: String,
    pub(super) path: String,
    /// The kind of bus, by its number in the standard.
    pub(super) bus_type: u8,
}

/// Use of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Value,
    /// The time of the records.
    Time,
    /// The time of the records, computed from their number.
    VirtualTime,
    /// Bytes of variable length, elsewhere.
    Variable,
}

/// A channel.
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) role: Role,
    pub(super) place: Place,
    pub(super) conversion: Conversion,
    /// Number of bytes of an array of bytes.
    pub(super) array_bytes: usize,
    /// Address of data of variable length; 0 for none.
    pub(super) data: u64,
    /// True if no value is valid.
    pub(super) is_invalid: bool,
    /// The bit that marks a value as not valid.
    pub(super) invalidation_bit: Option<usize>,
}

impl ChannelGroup {
    /// The channel of the records' time.
    pub(super) fn time(&self) -> Option<&Channel> {
        self.channels.iter().find(|channel| matches!(channel.role, Role::Time | Role::VirtualTime))
    }

    /// True if the value of `channel` in this record is valid.
    pub(super) fn is_valid(&self, channel: &Channel, record: &[u8]) -> bool {
        if channel.is_invalid {
            return false;
        }
        let Some(bit) = channel.invalidation_bit else { return true };
        let byte = record.get(self.bytes + bit / 8).copied().unwrap_or(0);
        byte >> (bit % 8) & 1 == 0
    }
}

/// Reads what the file holds, and the first fault.
pub(super) fn read<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
) -> Result<(Vec<DataGroup>, Option<BlockFault>), Stop> {
    let header = blocks.block(64, &[b"##HD"])?;
    let mut fault = None;
    let (groups, last) = blocks.list(header.link(0), |at| {
        let block = blocks.block(at, &[b"##DG"])?;
        let group = data_group(blocks, &block, &mut fault)?;
        Ok((block.link(0), group))
    })?;
    Ok((groups, fault.or(last)))
}

fn data_group<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    block: &Block,
    fault: &mut Option<BlockFault>,
) -> Result<DataGroup, Stop> {
    let id_bytes = usize::from(block.u8(0)?);
    if !matches!(id_bytes, 0 | 1 | 2 | 4 | 8) {
        return Err(damaged(block.at, format!("record numbers of {id_bytes} bytes")));
    }
    let (groups, last) = blocks.list(block.link(1), |at| {
        let block = blocks.block(at, &[b"##CG"])?;
        let group = channel_group(blocks, &block, fault)?;
        Ok((block.link(0), group))
    })?;
    if fault.is_none() {
        *fault = last;
    }
    Ok(DataGroup { data: block.link(2), id_bytes, groups })
}

fn channel_group<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    block: &Block,
    fault: &mut Option<BlockFault>,
) -> Result<ChannelGroup, Stop> {
    let flags = block.u16(16)?;
    let mut group = ChannelGroup {
        at: block.at,
        record_id: block.u64(0)?,
        records: block.u64(8)?,
        bytes: block.u32(24)? as usize,
        invalidation_bytes: block.u32(28)? as usize,
        is_variable: flags & VARIABLE != 0,
        has_remote_master: flags & REMOTE_MASTER != 0,
        acquisition: unless_damaged(blocks.text(block.link(2)))?.unwrap_or_default(),
        source: unless_damaged(source(blocks, block.link(3)))?.flatten(),
        channels: Vec::new(),
    };
    add_channels(blocks, block.link(1), &mut group.channels, DEEPEST, fault)?;
    Ok(group)
}

/// The source at an address; `None` for none.
fn source<R: Read + Seek>(blocks: &Blocks<'_, R>, at: u64) -> Result<Option<Source>, Stop> {
    if at == 0 {
        return Ok(None);
    }
    let block = blocks.block(at, &[b"##SI"])?;
    let (name, path) = (blocks.text(block.link(0))?, blocks.text(block.link(1))?);
    Ok(Some(Source { name, path, bus_type: block.u8(1)? }))
}

/// The value that was read; `None` if it is damaged. A damaged name of a source must not cost the records.
fn unless_damaged<T>(read: Result<T, Stop>) -> Result<Option<T>, Stop> {
    match read {
        Ok(read) => Ok(Some(read)),
        Err(Stop::Damaged(_)) => Ok(None),
        Err(failed) => Err(failed),
    }
}

/// Adds the channels of a list, and those in structures.
fn add_channels<R: Read + Seek>(
    blocks: &Blocks<'_, R>,
    first: u64,
    channels: &mut Vec<Channel>,
    depth: usize,
    fault: &mut Option<BlockFault>,
) -> Result<(), Stop> {
    let (_, last) = blocks.list(first, |at| {
        let block = blocks.block(at, &[b"##CN"])?;
        let mut channel = channel(blocks, &block)?;
        let component = block.link(1);
        if component != 0 {
            match &blocks.head(component)?.id {
                b"##CN" if depth > 0 => {
                    channels.push(channel);
                    add_channels(blocks, component, channels, depth - 1, fault)?;
                    return Ok((block.link(0), ()));
                }
                b"##CA" => {
                    channel.array_bytes =
                        array_bytes(&blocks.block(component, &[b"##CA"])?, &mut channel.place)?
                }
                _ => {}
            }
        }
        channels.push(channel);
        Ok((block.link(0), ()))
    })?;
    if fault.is_none() {
        *fault = last;
    }
    Ok(())
}

/// Number of bytes of an array of bytes; other arrays do not hold a single number, so they are not read.
fn array_bytes(block: &Block, place: &mut Place) -> Result<usize, Stop> {
    let dimensions = block.u16(2)?;
    let mut count = 1_usize;
    for index in 0..usize::from(dimensions) {
        let size = usize::try_from(block.u64(16 + 8 * index)?).unwrap_or(usize::MAX);
        count = count.saturating_mul(size);
    }
    let bytes = if place.bits == 8 { count } else { 0 };
    place.kind = Kind::Other;
    Ok(bytes)
}

fn channel<R: Read + Seek>(blocks: &Blocks<'_, R>, block: &Block) -> Result<Channel, Stop> {
    let (kind, sync, data_type, bit) = (block.u8(0)?, block.u8(1)?, block.u8(2)?, block.u8(3)?);
    let (byte, bits, flags, invalidation_bit) =
        (block.u32(4)?, block.u32(8)?, block.u32(12)?, block.u32(16)?);
    const TIME: u8 = 1;
    let role = match (kind, sync) {
        (1, _) => Role::Variable,
        (2, TIME) => Role::Time,
        (3, TIME) => Role::VirtualTime,
        _ => Role::Value,
    };
    let number = match data_type {
        0 | 1 => Kind::Unsigned,
        2 | 3 => Kind::Signed,
        4 | 5 => Kind::Float,
        _ => Kind::Other,
    };
    // A virtual channel has no place in the record; only a virtual time is computed.
    let number = if matches!(kind, 0 | 2 | 5) || role == Role::VirtualTime || role == Role::Variable {
        number
    } else {
        Kind::Other
    };
    let (conversion, converted_unit) = conversion(blocks, block.link(4))?;
    let unit = blocks.text(block.link(6))?;
    Ok(Channel {
        name: blocks.text(block.link(2))?,
        unit: if unit.is_empty() { converted_unit } else { unit },
        role,
        place: Place {
            kind: number,
            big_endian: matches!(data_type, 1 | 3 | 5),
            byte: byte as usize,
            bit: u32::from(bit),
            bits,
        },
        conversion,
        array_bytes: (bits / 8) as usize,
        data: block.link(5),
        is_invalid: flags & 1 != 0,
        invalidation_bit: (flags & 2 != 0).then_some(invalidation_bit as usize),
    })
}

/// The conversion at an address, and its unit.
fn conversion<R: Read + Seek>(blocks: &Blocks<'_, R>, at: u64) -> Result<(Conversion, String), Stop> {
    if at == 0 {
        return Ok((Conversion::Identity, String::new()));
    }
    let block = blocks.block(at, &[b"##CC"])?;
    let value = |index: usize| block.f64(24 + 8 * index);
    let conversion = match block.u8(0)? {
        0 => Conversion::Identity,
        1 => match (value(1)?, value(0)?) {
            (1.0, 0.0) => Conversion::Identity,
            (factor, offset) => Conversion::Linear { factor, offset },
        },
        2 => Conversion::Rational([value(0)?, value(1)?, value(2)?, value(3)?, value(4)?, value(5)?]),
        other => Conversion::Other(other),
    };
    Ok((conversion, blocks.text(block.link(1))?))
}
