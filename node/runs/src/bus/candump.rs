//! Reads the logs of `candump` (can-utils).
//!
//! ```text
//! (1700000000.250000) can0 120#D20403E8014100000     candump -L and -l; `##` and a digit of flags before the data of CAN FD
//! (1700000000.250000)  can0  120   [8]  D2 04 03 E8 01 41 00 00     candump -t a, and -t z from zero
//! ```
//!
//! An identifier of more than three digits has 29 bits. Error frames have bit 29 in it.

use super::frame::{Bus, BusFrame, CanId, MOST_BYTES};
use super::shown;
use super::text::{LineReader, push_hex};
use crate::decimal::parse_nanos;
use crate::error::LineFault;

/// Bit of an identifier that marks an error frame (`CAN_ERR_FLAG` of linux/can.h).
const ERROR_FRAME: u32 = 1 << 29;

/// The format.
pub(super) struct Candump;

impl LineReader for Candump {
    fn frame<'a>(&mut self, line: &'a str, data: &'a mut Vec<u8>) -> Result<Option<BusFrame<'a>>, LineFault> {
        data.clear();
        if line.is_empty() || line.starts_with('#') || ERROR_WORDS.iter().any(|word| line.starts_with(word)) {
            return Ok(None);
        }
        let no_time = || LineFault::CandumpTime { line: shown(line) };
        let (time, rest) =
            line.strip_prefix('(').and_then(|rest| rest.split_once(')')).ok_or_else(no_time)?;
        let nanos = parse_nanos(time.trim(), 0).ok_or_else(no_time)?;
        let form = || LineFault::Candump { line: shown(line) };
        let mut words = rest.split_ascii_whitespace();
        let (bus, frame) = words.next().zip(words.next()).ok_or_else(form)?;
        let id = match frame.split_once('#') {
            Some((id, content)) => {
                let Some(digits) = bytes_of(content) else { return id_of(id).map(|_| None) };
                push_hex(digits, data)?;
                id
            }
            None => {
                if line.ends_with("remote request") {
                    return Ok(None);
                }
                // With -x come the direction and the flags B and E or `-`; identifiers have at least three digits.
                let is_marked = matches!(frame, "RX" | "TX");
                let id = if is_marked { words.by_ref().find(|word| word.len() > 2) } else { Some(frame) };
                let (id, length) = id.zip(words.next()).ok_or_else(form)?;
                let length = length.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
                let length = length.and_then(|length| length.parse::<usize>().ok()).ok_or_else(form)?;
                for word in words.take_while(|word| word.len() == 2).take(length) {
                    push_hex(word, data)?;
                }
                if data.len() != length {
                    return Err(form());
                }
                id
            }
        };
        if data.len() > MOST_BYTES {
            return Err(form());
        }
        let id = id_of(id)?;
        Ok(id.map(|id| BusFrame { nanos, bus: Bus::Name(bus), id, data }))
    }
}

/// Words that begin a line of `candump -e`, which explains the error frame before it.
const ERROR_WORDS: [&str; 10] = [
    "tx-timeout",
    "lost-arbitration",
    "controller-problem",
    "protocol-violation",
    "transceiver-status",
    "no-acknowledgement-on-tx",
    "bus-off",
    "bus-error",
    "restarted-after-bus-off",
    "error-counter-tx-rx",
];

/// The digits of the data; `None` for a remote frame.
fn bytes_of(content: &str) -> Option<&str> {
    let content = match content.strip_prefix('#') {
        // The digit after the second `#` holds the flags of CAN FD.
        Some(rest) => rest.get(1..).unwrap_or_default(),
        None if content.starts_with(['R', 'r']) => return None,
        None => content,
    };
    // A raw length code may follow 8 bytes.
    Some(content.split_once('_').map_or(content, |(digits, _)| digits))
}

/// The identifier; `None` for an error frame.
fn id_of(text: &str) -> Result<Option<CanId>, LineFault> {
    let fault = || LineFault::Id { found: shown(text) };
    let value = u32::from_str_radix(text, 16).map_err(|_| fault())?;
    let extended = text.len() > 3;
    if extended && value & ERROR_FRAME != 0 {
        return Ok(None);
    }
    CanId::new(value, extended).map(Some).ok_or_else(fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    type Read = (i64, String, String, Vec<u8>);

    fn read(line: &str) -> Result<Option<Read>, String> {
        let mut data = Vec::new();
        let frame = Candump.frame(line, &mut data).map_err(|fault| fault.to_string())?;
        Ok(frame.map(|frame| (frame.nanos, frame.bus.to_string(), frame.id.to_string(), frame.data.to_vec())))
    }

    #[test]
    fn each_form_of_a_frame_is_read() {
        let (t, can0) = (1_700_000_000_250_001_000, "can0".to_owned());
        for (line, id, data) in [
            ("(1700000000.250001) can0 120#D20403", "0x120", vec![0xd2, 4, 3]),
            ("(1700000000.250001) can0 120#d204 R", "0x120", vec![0xd2, 4]),
            ("(1700000000.250001) can0 00000120#", "0x00000120 extended", vec![]),
            ("(1700000000.250001) can0 18FF0001##1AABBCC", "0x18FF0001 extended", vec![0xaa, 0xbb, 0xcc]),
            ("(1700000000.250001) can0 120#0102030405060708_A", "0x120", vec![1, 2, 3, 4, 5, 6, 7, 8]),
            (" (1700000000.250001)  can0  120   [2]  D2 04".trim(), "0x120", vec![0xd2, 4]),
            ("(1700000000.250001)  can0  120   [2]  D2 04   '..'", "0x120", vec![0xd2, 4]),
            (
                "(1700000000.250001)  can0  TX B -  18FF0001  [02]  D2 04",
                "0x18FF0001 extended",
                vec![0xd2, 4],
            ),
        ] {
            assert_eq!(read(line), Ok(Some((t, can0.clone(), id.to_owned(), data))), "{line}");
        }
        for line in [
            "",
            "# a comment",
            "(1.0) can0 120#R",
            "(1.0) can0 120#R8",
            "(1.0) can0 20000080#0000000000000000",
            "(1.0)  can0  120   [0]  remote request",
            "(1.0)  can0  20000088   [8]  00 00 80 19 00 00 00 00   ERRORFRAME",
            "protocol-violation{{}{acknowledge-slot}}",
        ] {
            assert_eq!(read(line), Ok(None), "{line}");
        }
    }

    #[test]
    fn a_bad_line_says_what_is_wrong() {
        for (line, why) in [
            ("can0  120   [2]  D2 04", "has no time"),
            ("(2026-11-26 19:00:00.123456)  can0  120   [2]  D2 04", "has no time"),
            ("(1.0) can0", "is not a frame"),
            ("(1.0) can0 120#D20", "`D20` is not a row of bytes"),
            ("(1.0) can0 120#é0", "is not a row of bytes"),
            ("(1.0) can0 XYZ#D2", "`XYZ` is not an identifier"),
            ("(1.0) can0 800#D2", "`800` is not an identifier"),
            ("(1.0) can0 120 [3] D2 04", "is not a frame"),
        ] {
            let message = read(line).expect_err(line);
            assert!(message.contains(why), "{line}: {message}");
        }
    }
}
