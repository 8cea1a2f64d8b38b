//! The RTPS submessages that the node writes itself (DDSI-RTPS 2.5, sections 9.4.4 and 9.4.5), little endian.
//!
//! ```text
//! datagram = "RTPS" version vendor prefix, then submessages = kind flags length body
//! ```

use rustdds::GUID;

/// Protocol version 2.4 and the vendor id of RustDDS, because the submessages are sent on its behalf.
const VERSION_AND_VENDOR: [u8; 4] = [2, 4, 1, 0x12];

const ACKNACK: u8 = 0x06;
const GAP: u8 = 0x08;
const INFO_SRC: u8 = 0x0c;
const INFO_DST: u8 = 0x0e;

/// Flag: the numbers of the submessage are little endian.
const LITTLE_ENDIAN: u8 = 0x01;
/// ACKNACK flag: the reader needs no answer.
const FINAL: u8 = 0x02;

/// A datagram under construction.
#[derive(Debug, Clone)]
pub(crate) struct Datagram(Vec<u8>);

impl Datagram {
    /// An empty datagram from the participant of `sender`.
    pub(crate) fn from_participant_of(sender: GUID) -> Self {
        let mut bytes = b"RTPS".to_vec();
        bytes.extend(VERSION_AND_VENDOR);
        bytes.extend(sender.prefix.as_ref());
        Self(bytes)
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// Says in the name of `reader` that it has all samples of `writer` below `base` (8.3.8.1).
    pub(crate) fn acknowledge(&mut self, reader: GUID, writer: GUID, base: u64, count: i32) {
        let source = [&[0; 4], &VERSION_AND_VENDOR, reader.prefix.as_ref()].concat();
        self.push(INFO_SRC, LITTLE_ENDIAN, &source);
        let entities = [reader.entity_id.to_slice(), writer.entity_id.to_slice()].concat();
        let body = [&entities[..], &empty_set(base), &count.to_le_bytes()].concat();
        self.push(ACKNACK, LITTLE_ENDIAN | FINAL, &body);
    }

    /// Says to `reader` that the samples of `writer` from `first` to below `base` will not be sent any more (8.3.8.4).
    pub(crate) fn declare_gone(&mut self, reader: GUID, writer: GUID, first: u64, base: u64) {
        self.push(INFO_DST, LITTLE_ENDIAN, reader.prefix.as_ref());
        let entities = [reader.entity_id.to_slice(), writer.entity_id.to_slice()].concat();
        let body = [&entities[..], &sequence_number(first), &empty_set(base)].concat();
        self.push(GAP, LITTLE_ENDIAN, &body);
    }

    /// Says to `writer` in the name of `reader` that the first sample is missing (8.3.8.1).
    pub(crate) fn ask_for_first(&mut self, reader: GUID, writer: GUID, count: i32) {
        self.push(INFO_DST, LITTLE_ENDIAN, writer.prefix.as_ref());
        let entities = [reader.entity_id.to_slice(), writer.entity_id.to_slice()].concat();
        // A set with one number has one word of bits; the highest bit is the base.
        let (bits, set) = (1_u32.to_le_bytes(), 0x8000_0000_u32.to_le_bytes());
        let body = [&entities[..], &sequence_number(1), &bits, &set, &count.to_le_bytes()].concat();
        self.push(ACKNACK, LITTLE_ENDIAN | FINAL, &body);
    }

    fn push(&mut self, kind: u8, flags: u8, body: &[u8]) {
        // All bodies are at most 32 bytes long.
        self.0.extend([kind, flags, body.len() as u8, 0]);
        self.0.extend(body);
    }
}

/// A sequence number: the upper half, then the lower half.
fn sequence_number(number: u64) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&((number >> 32) as u32).to_le_bytes());
    bytes[4..].copy_from_slice(&(number as u32).to_le_bytes());
    bytes
}

/// A set of sequence numbers with a base and without members.
fn empty_set(base: u64) -> Vec<u8> {
    [&sequence_number(base)[..], &0_u32.to_le_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hex(bytes: &[u8]) -> String {
        bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Expected bytes written by hand from the tables of 9.4.5.2 (ACKNACK), 9.4.5.5 (GAP), 9.4.5.9 (INFO_DST) and
    /// 9.4.5.11 (INFO_SRC).
    #[test]
    fn submessages_have_the_layout_of_the_standard() {
        let guid = |prefix: u8, entity: [u8; 4]| {
            let mut bytes = [prefix; 16];
            bytes[12..].copy_from_slice(&entity);
            GUID::from_bytes(bytes)
        };
        let (writer, reader) = (guid(0xaa, [0, 0, 1, 3]), guid(0xbb, [0, 0, 2, 4]));
        let mut datagram = Datagram::from_participant_of(writer);
        datagram.acknowledge(reader, writer, 0x1_0000_0005, -2);
        datagram.declare_gone(reader, writer, 3, 0x1_0000_0005);
        let (a, b) = ("aa".repeat(12), "bb".repeat(12));
        let entities = "0000020400000103";
        let acknack =
            format!("0c011400{:08}02040112{b} 06031800{entities}0100000005000000 00000000feffffff", 0);
        let gap = format!("0e010c00{b} 08011c00{entities}0000000003000000 0100000005000000 00000000");
        assert_eq!(hex(datagram.bytes()), format!("5254505302040112{a}{acknack}{gap}").replace(' ', ""));

        let mut datagram = Datagram::from_participant_of(reader);
        datagram.ask_for_first(reader, writer, 1);
        let body = format!("0e010c00{a} 06031c00{entities}0000000001000000 01000000 00000080 01000000");
        assert_eq!(hex(datagram.bytes()), format!("5254505302040112{b}{body}").replace(' ', ""));
    }
}
