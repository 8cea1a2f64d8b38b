//! The interface between the readers of CAN logs, one for each format, and the channels of a run.

use std::fmt;

/// Greatest number of data bytes of a CAN FD frame.
pub const MOST_BYTES: usize = 64;

/// Identifier of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CanId {
    /// The 11 or 29 bits.
    pub value: u32,
    /// True for 29 bits.
    pub extended: bool,
}

impl CanId {
    /// Greatest identifier of 11 bits.
    const STANDARD: u32 = 0x7ff;
    /// Greatest identifier of 29 bits.
    const EXTENDED: u32 = 0x1fff_ffff;

    /// The identifier in a number whose bit 31 marks 29 bits, as in DBC and BLF files; `None` if it is out of range.
    pub(super) fn of_marked(marked: u32) -> Option<Self> {
        Self::new(marked & !(1 << 31), marked >> 31 == 1)
    }

    /// The identifier; `None` if it is out of range.
    #[must_use]
    pub fn new(value: u32, extended: bool) -> Option<Self> {
        let most = if extended { Self::EXTENDED } else { Self::STANDARD };
        (value <= most).then_some(Self { value, extended })
    }
}

impl fmt::Display for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (width, kind) = if self.extended { (8, " extended") } else { (3, "") };
        write!(f, "0x{:0width$X}{kind}", self.value)
    }
}

/// Name of the bus that a frame was on, as the log has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Bus<'a> {
    /// An interface, such as `can0`.
    Name(&'a str),
    /// A channel, counted as in the log.
    Number(u32),
}

impl Bus<'_> {
    /// True if this is its name.
    pub(super) fn is(&self, name: &str) -> bool {
        match self {
            Self::Name(own) => *own == name,
            Self::Number(own) => name.parse() == Ok(*own),
        }
    }
}

impl fmt::Display for Bus<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => f.write_str(name),
            Self::Number(number) => write!(f, "{number}"),
        }
    }
}

/// A data frame. Remote and error frames carry no signal, so the readers leave them out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BusFrame<'a> {
    /// Time, ns.
    pub(super) nanos: i64,
    pub(super) bus: Bus<'a>,
    pub(super) id: CanId,
    /// At most [`MOST_BYTES`] bytes.
    pub(super) data: &'a [u8],
}

/// Receives the frames of a log, in the order of the log.
pub(super) trait FrameSink {
    fn frame(&mut self, frame: &BusFrame<'_>);

    /// Notes a data frame that cannot be used.
    fn unusable(&mut self, _what: Unusable) {}
}

/// What is wrong with a frame, or with a record of an MDF4 file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Unusable {
    /// Its time is not a number of nanoseconds of 64 bits.
    Time,
    /// Its identifier has more bits than its kind.
    Identifier,
}

impl Unusable {
    /// As the end of "frames with".
    pub(super) const fn in_words(self) -> &'static str {
        match self {
            Self::Time => "a time that is NaN, infinite or more than 292 years away",
            Self::Identifier => "an identifier above 0x7FF that is not marked as one of 29 bits",
        }
    }
}

/// Number of data bytes for the length code of a frame (ISO 11898-1:2015, table 5).
pub(super) const fn bytes_of_code(code: u8) -> usize {
    match code {
        0..=8 => code as usize,
        9 => 12,
        10 => 16,
        11 => 20,
        12 => 24,
        13 => 32,
        14 => 48,
        _ => MOST_BYTES,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bit_31_marks_an_identifier_of_29_bits() {
        let id = |marked| CanId::of_marked(marked).map(|id| id.to_string());
        assert_eq!(id(0x123).as_deref(), Some("0x123"));
        assert_eq!(id(0x8000_0123).as_deref(), Some("0x00000123 extended"));
        assert_eq!(id(0x9fff_ffff).as_deref(), Some("0x1FFFFFFF extended"));
        assert_eq!([id(0x800), id(0xa000_0000)], [None, None]);
    }
}
