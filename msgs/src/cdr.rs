//! CDR, the encoding that DDS and rosbag2 use for messages.
//!
//! A payload starts with four bytes that name the encoding. The message follows; every number is aligned to
//! its size, counted from the end of the four bytes. We write little endian (`00 01 00 00`) and read both byte
//! orders.
//!
//! Reading is safe on hostile bytes: before memory is allocated for a string, its length is checked against
//! the available bytes, and a sequence grows only by elements that were actually read.

use byteorder::{BigEndian, ByteOrder, LittleEndian};
use cdr_encoding::CdrDeserializer;

use crate::Message;

/// Number of bytes before the message that name its encoding.
const HEADER_LEN: usize = 4;

/// Why a payload cannot be read, or a message cannot be written.
///
/// Offsets are in bytes from the start of the payload, header included.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrError {
    /// The payload is shorter than the four bytes that name the encoding.
    #[error("{type_name}: payload of {len} bytes has no 4-byte CDR header")]
    NoHeader {
        /// The expected type.
        type_name: &'static str,
        /// Bytes in the payload.
        len: usize,
    },
    /// The encoding is not plain CDR, but for example XCDR2 or a parameter list.
    #[error(
        "{type_name}: encoding {:02x} {:02x} is not plain CDR (00 00 or 00 01); \
         set the sender to XCDR1, final types",
        found[0],
        found[1]
    )]
    Encoding {
        /// The expected type.
        type_name: &'static str,
        /// The first two bytes of the header.
        found: [u8; 2],
    },
    /// The message is truncated or holds an impossible value.
    #[error("{type_name}: at byte {offset} of {len}: {reason}")]
    Body {
        /// The expected type.
        type_name: &'static str,
        /// Where reading stopped.
        offset: usize,
        /// Bytes in the payload.
        len: usize,
        /// The cause.
        reason: String,
    },
    /// The message cannot be written.
    #[error("{type_name}: {reason}")]
    Write {
        /// The type.
        type_name: &'static str,
        /// The cause.
        reason: String,
    },
}

/// Writes a message into a new vector.
///
/// # Errors
/// Never for the messages of this crate; see [`write_into`].
pub fn to_vec<M: Message>(message: &M) -> Result<Vec<u8>, CdrError> {
    let mut buffer = Vec::with_capacity(HEADER_LEN + 2 * size_of::<M>());
    write_into(message, &mut buffer)?;
    Ok(buffer)
}

/// Writes a message into a buffer and replaces its content. Allocates only if the buffer is too small.
///
/// # Errors
/// If the type contains something that CDR cannot encode, which no message of this crate does; the buffer is
/// then empty.
pub fn write_into<M: Message>(message: &M, buffer: &mut Vec<u8>) -> Result<(), CdrError> {
    buffer.clear();
    buffer.extend_from_slice(&[0, 1, 0, 0]);
    cdr_encoding::to_writer::<M, LittleEndian, _>(&mut *buffer, message).map_err(|error| {
        buffer.clear();
        CdrError::Write { type_name: M::TYPE, reason: error.to_string() }
    })
}

/// Reads a message.
///
/// A Boolean other than 0 or 1 and text that is not UTF-8 are refused. Numbers are accepted as they are,
/// including NaN. Bytes after the message are ignored, as in every ROS 2 middleware: senders pad to four
/// bytes, and rclpy's `serialize_message` writes eight bytes too many for a `JointState` with an empty list.
///
/// # Errors
/// If the bytes do not begin with a message of this type in plain CDR.
pub fn from_slice<M: Message>(bytes: &[u8]) -> Result<M, CdrError> {
    let no_header = CdrError::NoHeader { type_name: M::TYPE, len: bytes.len() };
    let Some((header, body)) = bytes.split_first_chunk::<HEADER_LEN>() else { return Err(no_header) };
    // The last two header bytes are options that have no meaning in plain CDR.
    match [header[0], header[1]] {
        [0, 0] => read_body::<M, BigEndian>(body),
        [0, 1] => read_body::<M, LittleEndian>(body),
        found => Err(CdrError::Encoding { type_name: M::TYPE, found }),
    }
}

fn read_body<M: Message, B: ByteOrder>(body: &[u8]) -> Result<M, CdrError> {
    let type_name = M::TYPE;
    let len = HEADER_LEN + body.len();
    let mut deserializer = CdrDeserializer::<B>::new(body);
    let result = M::deserialize(&mut deserializer);
    let offset = HEADER_LEN + deserializer.bytes_consumed();
    let message =
        result.map_err(|error| CdrError::Body { type_name, offset, len, reason: error.to_string() })?;
    Ok(message)
}
