//! Identifiers of SAE J1939.
//!
//! | bits | 28 to 26 | 25, 24 | 23 to 16 | 15 to 8 | 7 to 0 |
//! |---|---|---|---|---|---|
//! | | priority | data pages | PDU format | PDU specific | source address |
//!
//! With a PDU format below 240 (PDU1), the PDU specific field is the address of the destination. Otherwise (PDU2) it belongs to the parameter
//! group number (PGN). A message is known by its PGN, whatever its priority and its addresses are.

use super::dbc::Database;
use super::frame::CanId;
use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

/// Number of senders that a message to the user lists.
const LISTED: usize = 16;
/// Least PDU format of PDU2.
const PDU2: u32 = 240;
/// Bits of the PGN in an identifier, without the PDU specific field.
const FORMAT_BITS: u32 = 0x03ff_0000;
const SPECIFIC_BITS: u32 = 0xff00;
const SOURCE_BITS: u32 = 0xff;

const fn is_pdu2(id: u32) -> bool {
    id >> 16 & 0xff >= PDU2
}

/// The bits of an identifier that hold its PGN.
const fn pgn_bits(id: u32) -> u32 {
    if is_pdu2(id) { FORMAT_BITS | SPECIFIC_BITS } else { FORMAT_BITS }
}

/// The PGN of an identifier of 29 bits.
pub(super) const fn pgn(id: u32) -> u32 {
    (id & pgn_bits(id)) >> 8
}

/// The sender of a frame: its source address, and for PDU1 the address of the destination, as frames to several destinations carry different
/// values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Sender {
    source: u8,
    destination: Option<u8>,
}

impl Sender {
    pub(super) const fn of(id: CanId) -> Self {
        let [.., specific, source] = id.value.to_be_bytes();
        Self { source, destination: if is_pdu2(id.value) { None } else { Some(specific) } }
    }

    /// The sender that a map names for a message with the identifier `id`; `None` if it cannot be one.
    pub(super) fn named(text: &str, id: CanId) -> Option<Self> {
        let sender: Self = text.parse().ok()?;
        (sender.destination.is_none() || !is_pdu2(id.value)).then_some(sender)
    }

    /// True if frames with the identifier of `id` may come from several senders that a map means with `named`.
    pub(super) fn is_open(named: Option<Self>, id: CanId) -> bool {
        named.is_none_or(|named| named.destination.is_none() && !is_pdu2(id.value))
    }

    /// True if frames of `other` are meant by this sender of a map, which may leave out the destination.
    pub(super) fn includes(self, other: Self) -> bool {
        self.source == other.source && (self.destination.is_none() || self.destination == other.destination)
    }

    /// The identifier `id` with these addresses.
    pub(super) const fn applied(self, id: CanId) -> CanId {
        let value = id.value & !SOURCE_BITS | self.source as u32;
        let value = match self.destination {
            Some(destination) if !is_pdu2(value) => value & !SPECIFIC_BITS | (destination as u32) << 8,
            _ => value,
        };
        CanId { value, ..id }
    }
}

/// As in a map: `0x21`, or `0x21/0x05` with the destination.
impl fmt::Display for Sender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:02X}", self.source)?;
        self.destination.map_or(Ok(()), |destination| write!(f, "/0x{destination:02X}"))
    }
}

impl FromStr for Sender {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let address = |text: &str| {
            let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
            digits.map_or_else(|| text.parse(), |hex| u8::from_str_radix(hex, 16)).map_err(drop)
        };
        Ok(match text.split_once('/') {
            Some((source, destination)) => {
                Self { source: address(source)?, destination: Some(address(destination)?) }
            }
            None => Self { source: address(text)?, destination: None },
        })
    }
}

/// The addresses of senders in order, for messages to the user; at most [`LISTED`].
pub(super) fn listed(senders: &BTreeSet<Sender>) -> Vec<String> {
    let mut shown: Vec<String> = senders.iter().take(LISTED).map(Sender::to_string).collect();
    if senders.len() > LISTED {
        shown.push(format!("{} more", senders.len() - LISTED));
    }
    shown
}

impl Database {
    /// The message that a frame with this identifier carries. A message with this identifier has priority over a J1939 message with its PGN.
    /// If several J1939 messages have one PGN, their addresses count, too.
    pub(super) fn message_of(&self, id: CanId) -> Option<usize> {
        let exact = self.messages.iter().position(|message| message.id == id);
        if exact.is_some() || !id.extended {
            return exact;
        }
        let mut same_pgn = self
            .messages
            .iter()
            .enumerate()
            .filter(|(_, message)| message.is_j1939 && pgn(message.id.value) == pgn(id.value));
        let (only, _) = same_pgn.next()?;
        let Some(second) = same_pgn.next() else { return Some(only) };
        let first = (only, &self.messages[only]);
        let all = [first, second].into_iter().chain(same_pgn);
        let mut of_sender = all.filter(|(_, message)| Sender::of(message.id) == Sender::of(id));
        match (of_sender.next(), of_sender.next()) {
            (Some((message, _)), None) => Some(message),
            _ => None,
        }
    }
}

/// The frames that may carry a message, by their identifiers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameFilter {
    /// An identifier of such a frame.
    pub id: CanId,
    /// The bits of the identifier that count.
    pub mask: u32,
}

impl FrameFilter {
    /// The frames of a message that is of J1939 or not, from a sender if one is given.
    pub(super) fn new(id: CanId, is_j1939: bool, sender: Option<Sender>) -> Self {
        if !is_j1939 {
            return Self { id, mask: u32::MAX };
        }
        let id = sender.map_or(id, |sender| sender.applied(id));
        let addresses = match sender {
            None => 0,
            Some(Sender { destination: None, .. }) => SOURCE_BITS,
            Some(Sender { destination: Some(_), .. }) => SOURCE_BITS | SPECIFIC_BITS,
        };
        Self { id, mask: pgn_bits(id.value) | addresses }
    }

    /// True if a frame with this identifier passes.
    #[must_use]
    pub const fn passes(&self, id: CanId) -> bool {
        self.id.extended == id.extended && (self.id.value ^ id.value) & self.mask == 0
    }
}

/// The senders of a J1939 message on a running bus, if the map names none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Senders {
    /// No frame yet.
    Unknown,
    /// One sender, which the DBC file does not name.
    One(Sender),
    /// The sender that the DBC file names.
    Own,
    /// Several senders, none of which the DBC file names.
    Several,
}

/// What to do with a frame of a J1939 message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Use {
    Take,
    /// The frame is of another sender than the one that is used.
    Pass,
    /// Nothing says which sender is meant.
    Refuse,
}

impl Senders {
    /// Notes a frame of `sender`. `own` is the sender in the identifier of the DBC file.
    pub(super) fn take(&mut self, sender: Sender, own: Sender) -> Use {
        *self = match *self {
            _ if sender == own => Self::Own,
            Self::Unknown => Self::One(sender),
            Self::One(known) if known != sender => Self::Several,
            known => known,
        };
        match self {
            Self::Own if sender != own => Use::Pass,
            Self::Several => Use::Refuse,
            _ => Use::Take,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn id(value: u32) -> CanId {
        CanId { value, extended: true }
    }

    // cantools 45.1.0: `f = cantools.j1939.frame_id_unpack(id)`, then `pgn_pack(f.reserved, f.data_page, f.pdu_format, f.pdu_specific)` with a
    // PDU specific field of 0 for PDU1.
    #[test]
    fn the_pgn_leaves_out_priority_source_and_the_destination_of_pdu1() {
        for (value, group, sender) in [
            (0x0cf0_0400, 0xf004, "0x00"),
            (0x18f0_0421, 0xf004, "0x21"),
            (0x0c00_000b, 0, "0x0B/0x00"),
            (0x0c00_0f0b, 0, "0x0B/0x0F"),
            (0x18ef_fffe, 0xef00, "0xFE/0xFF"),
            (0x19f1_0203, 0x1f102, "0x03"),
            (0x1fff_ffff, 0x3_ffff, "0xFF"),
        ] {
            assert_eq!(
                (pgn(value), Sender::of(id(value)).to_string()),
                (group, sender.to_owned()),
                "{value:08x}"
            );
            assert_eq!(sender.parse(), Ok(Sender::of(id(value))));
        }
        for (text, good) in [("33", "0x21"), ("11/15", "0x0B/0x0F"), ("0Xff", "0xFF")] {
            assert_eq!(text.parse::<Sender>().map(|it| it.to_string()), Ok(good.to_owned()));
        }
        for text in ["", "256", "0x100", "-1", "x", "1/", "1/2/3", "21h"] {
            assert_eq!(text.parse::<Sender>(), Err(()), "{text}");
        }
    }

    #[test]
    fn a_filter_passes_the_frames_of_its_message() {
        let sender = |text: &str| text.parse::<Sender>().ok();
        let passed = |filter: FrameFilter| {
            let all = [0x0cf0_0400, 0x18f0_0421, 0x18f0_0521, 0x0c00_000b, 0x0400_0f0b, 0x0c00_0f21];
            all.into_iter().filter(|value| filter.passes(id(*value))).collect::<Vec<_>>()
        };
        assert_eq!(passed(FrameFilter::new(id(0x0cf0_0400), false, None)), [0x0cf0_0400]);
        assert_eq!(passed(FrameFilter::new(id(0x0cf0_04fe), true, None)), [0x0cf0_0400, 0x18f0_0421]);
        assert_eq!(passed(FrameFilter::new(id(0x0cf0_04fe), true, sender("33"))), [0x18f0_0421]);
        assert_eq!(
            passed(FrameFilter::new(id(0x0c00_00fe), true, None)),
            [0x0c00_000b, 0x0400_0f0b, 0x0c00_0f21]
        );
        assert_eq!(passed(FrameFilter::new(id(0x0c00_00fe), true, sender("11"))), [0x0c00_000b, 0x0400_0f0b]);
        assert_eq!(passed(FrameFilter::new(id(0x0c00_00fe), true, sender("11/15"))), [0x0400_0f0b]);
        assert!(!FrameFilter::new(CanId { value: 0x123, extended: false }, false, None).passes(id(0x123)));
    }

    #[test]
    fn a_second_sender_is_refused_unless_the_dbc_file_names_one() {
        let [own, a, b] = ["0x00", "0x21", "0x22"].map(|text| text.parse::<Sender>().expect("an address"));
        let run = |senders: &[Sender]| {
            let mut state = Senders::Unknown;
            senders.iter().map(|sender| state.take(*sender, own)).collect::<Vec<_>>()
        };
        assert_eq!(run(&[a, a, b, a]), [Use::Take, Use::Take, Use::Refuse, Use::Refuse]);
        assert_eq!(run(&[own, a, own, b]), [Use::Take, Use::Pass, Use::Take, Use::Pass]);
        assert_eq!(run(&[a, b, own, a]), [Use::Take, Use::Refuse, Use::Take, Use::Pass]);
    }
}
