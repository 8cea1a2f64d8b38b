//! Decodes signals: the bits of a frame's data, and the physical value `raw * factor + offset`.
//!
//! Bits are numbered as in DBC files: bit `8 i + j` has the weight `2^j` in byte `i`. An Intel signal begins with its least
//! significant bit; its further bits have increasing numbers. A Motorola signal begins with its most significant bit; its further
//! bits have decreasing weights in the same byte, and then in the next byte from the highest weight down.

use std::ops::RangeInclusive;

/// A number of a DBC file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Number {
    pub(super) value: f64,
    /// The same, if it is a whole number.
    pub(super) whole: Option<i64>,
    /// True if it is written without decimal point and exponent.
    pub(super) written_whole: bool,
}

impl Number {
    /// The number in a text; `None` if it is not a finite number.
    pub(super) fn parse(text: &str) -> Option<Self> {
        if let Ok(whole) = text.parse::<i64>() {
            return Some(Self { value: whole as f64, whole: Some(whole), written_whole: true });
        }
        let starts_well =
            text.trim_start_matches(['+', '-']).starts_with(|c: char| c.is_ascii_digit() || c == '.');
        let value = text.parse::<f64>().ok().filter(|value| starts_well && value.is_finite())?;
        // Below 2^63 a whole `f64` fits exactly.
        let is_whole = value.fract() == 0.0 && value.abs() < 9.2e18;
        Some(Self { value, whole: is_whole.then_some(value as i64), written_whole: false })
    }
}

/// How the bits of a signal are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Unsigned,
    Signed,
    /// IEEE 754 of 16, 32 or 64 bits.
    Float,
}

/// When a frame holds a signal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Presence {
    Always,
    /// If the multiplexer, a signal of the same message, has one of these raw values.
    When {
        multiplexer: usize,
        values: Vec<RangeInclusive<i128>>,
    },
    /// The DBC file does not say which multiplexer selects it.
    Unknown,
}

/// A signal of a message.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Signal {
    pub(super) name: String,
    /// Line in the DBC file, from 1.
    pub(super) line: usize,
    /// The first bit.
    pub(super) start: u32,
    /// Number of bits.
    pub(super) length: u32,
    /// True for Motorola's order.
    pub(super) big_endian: bool,
    pub(super) kind: Kind,
    pub(super) factor: Number,
    pub(super) offset: Number,
    /// Least and greatest physical value; `None` if the file gives none.
    pub(super) range: Option<[f64; 2]>,
    pub(super) unit: String,
    pub(super) presence: Presence,
}

/// Result of reading a signal from a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Decoded {
    Value(f64),
    /// The multiplexer selects other signals.
    Absent,
    /// The frame ends before the signal does.
    Short,
}

impl Signal {
    /// Number of bytes that a frame needs to hold the signal.
    pub(super) fn end(&self) -> u64 {
        let (start, length) = (u64::from(self.start), u64::from(self.length));
        let first = if self.big_endian { start / 8 * 8 + 7 - start % 8 } else { start };
        (first + length).div_ceil(8)
    }

    /// True if the number of bits fits the kind.
    pub(super) fn has_good_length(&self) -> bool {
        match self.kind {
            Kind::Float => matches!(self.length, 16 | 32 | 64),
            Kind::Unsigned | Kind::Signed => (1..=64).contains(&self.length),
        }
    }

    /// The bits as an unsigned number. `None` if the frame is too short, or the number of bits does not fit.
    fn bits(&self, data: &[u8]) -> Option<u64> {
        let end = usize::try_from(self.end()).ok()?;
        if !self.has_good_length() || end > data.len() {
            return None;
        }
        // The bytes that hold the signal, most significant first, give at most 64 + 7 bits; the signal is at the bottom after
        // a shift.
        let (start, length) = (self.start as usize, self.length as usize);
        let bytes = &data[start / 8..end];
        let append = |sum: u128, byte: &u8| sum << 8 | u128::from(*byte);
        let (all, shift) = if self.big_endian {
            let first = 7 - start % 8;
            (bytes.iter().fold(0, append), bytes.len() * 8 - first - length)
        } else {
            (bytes.iter().rev().fold(0, append), start % 8)
        };
        Some((all >> shift) as u64 & u64::MAX >> (64 - length))
    }

    /// The raw value as a whole number, for multiplexers.
    fn whole(&self, data: &[u8]) -> Option<i128> {
        let bits = self.bits(data)?;
        Some(match self.kind {
            Kind::Signed => i128::from(self.signed(bits)),
            Kind::Unsigned | Kind::Float => i128::from(bits),
        })
    }

    /// True if the DBC file allows this physical value.
    pub(super) fn is_in_range(&self, value: f64) -> bool {
        self.range.is_none_or(|[low, high]| (low..=high).contains(&value))
    }

    fn signed(&self, bits: u64) -> i64 {
        let unused = 64 - self.length;
        (bits << unused) as i64 >> unused
    }

    /// The physical value, without regard to multiplexers. Whole numbers are exact up to the one rounding at the end.
    fn value(&self, data: &[u8]) -> Option<f64> {
        let bits = self.bits(data)?;
        let raw = match self.kind {
            Kind::Unsigned => i128::from(bits),
            Kind::Signed => i128::from(self.signed(bits)),
            Kind::Float => {
                let raw = match self.length {
                    16 => of_half(bits as u16),
                    32 => f64::from(f32::from_bits(bits as u32)),
                    _ => f64::from_bits(bits),
                };
                let (factor, offset) = (self.factor.value, self.offset.value);
                let is_plain = factor == 1.0 && offset == 0.0;
                return Some(if is_plain { raw } else { raw * factor + offset });
            }
        };
        let (factor, offset) = (self.factor, self.offset);
        // Products of 64 bits fit into 128.
        Some(match (factor.whole, offset.whole) {
            (Some(factor), Some(offset)) => (raw * i128::from(factor) + i128::from(offset)) as f64,
            (Some(whole), None) if factor.written_whole => (raw * i128::from(whole)) as f64 + offset.value,
            _ => raw as f64 * factor.value + offset.value,
        })
    }
}

/// The value of the signal with index `signal` in a frame of the message that has these `signals`.
pub(super) fn decode(signals: &[Signal], signal: usize, data: &[u8]) -> Decoded {
    // A chain of multiplexers has no more members than the message has signals; a longer one is a circle.
    let mut at = signal;
    for _ in 0..signals.len() {
        let (multiplexer, values) = match &signals[at].presence {
            Presence::Always => {
                return signals[signal].value(data).map_or(Decoded::Short, Decoded::Value);
            }
            Presence::When { multiplexer, values } => (*multiplexer, values),
            Presence::Unknown => return Decoded::Absent,
        };
        match signals[multiplexer].whole(data) {
            None => return Decoded::Short,
            Some(raw) if !values.iter().any(|range| range.contains(&raw)) => return Decoded::Absent,
            Some(_) => at = multiplexer,
        }
    }
    Decoded::Absent
}

/// The number in the 16 bits of a half-precision float (IEEE 754 binary16), which `f64` holds exactly.
pub(super) fn of_half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * 2.0_f64.powi(-24),
        0x1f if fraction == 0.0 => f64::INFINITY,
        0x1f => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2.0_f64.powi(exponent - 15),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A signal whose value is the number in its bits.
    pub(in crate::bus) fn signal(start: u32, length: u32, big_endian: bool, kind: Kind) -> Signal {
        let number = |text| Number::parse(text).expect("a number");
        Signal {
            name: "x".into(),
            line: 1,
            start,
            length,
            big_endian,
            kind,
            factor: number("1"),
            offset: number("0"),
            range: None,
            unit: String::new(),
            presence: Presence::Always,
        }
    }

    pub(in crate::bus) fn scaled(signal: Signal, factor: &str, offset: &str) -> Signal {
        let number = |text| Number::parse(text).expect("a number");
        Signal { factor: number(factor), offset: number(offset), ..signal }
    }

    // The values are those of cantools 45.1.0: `cantools.database.load_string(DBC).decode_message(ID, DATA, decode_choices=False)`.
    #[test]
    fn bits_are_read_in_both_orders() {
        let data = [0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc, 0xde, 0xf0];
        for (start, length, big_endian, kind, value) in [
            (0, 8, false, Kind::Unsigned, 18.0),
            (4, 8, false, Kind::Unsigned, 65.0),
            (4, 12, false, Kind::Unsigned, 833.0),
            (0, 64, false, Kind::Unsigned, 17_356_517_385_562_371_090.0),
            (39, 16, false, Kind::Signed, -17_031.0),
            (7, 8, true, Kind::Unsigned, 18.0),
            (3, 8, true, Kind::Unsigned, 35.0),
            (3, 12, true, Kind::Unsigned, 564.0),
            (7, 64, true, Kind::Unsigned, 1_311_768_467_463_790_320.0),
            (39, 16, true, Kind::Signed, -25_924.0),
            (63, 1, false, Kind::Signed, -1.0),
        ] {
            let found = signal(start, length, big_endian, kind).value(&data);
            assert_eq!(found, Some(value), "{start}|{length}@{big_endian} {kind:?}");
        }
    }

    #[test]
    fn whole_numbers_of_64_bits_are_rounded_once() {
        let wide = signal(0, 64, false, Kind::Unsigned);
        // 2^64 - 1 times 3 minus 1 is 55340232221128654844; the nearest double of the exact number.
        let found = scaled(wide.clone(), "3", "-1").value(&[0xff; 8]);
        assert_eq!(found, Some(55_340_232_221_128_654_844_i128 as f64));
        assert_eq!(scaled(wide, "0.1", "0.5").value(&[0xff; 8]), Some(u64::MAX as f64 * 0.1 + 0.5));
    }

    #[test]
    fn floats_keep_their_bits() {
        let data = 1.1_f64.to_le_bytes();
        assert_eq!(signal(0, 64, false, Kind::Float).value(&data), Some(1.1));
        let data = 1.1_f32.to_be_bytes();
        assert_eq!(signal(7, 32, true, Kind::Float).value(&data), Some(f64::from(1.1_f32)));
        for (bits, value) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x0001, 2.0_f64.powi(-24)),
            (0x7bff, 65_504.0),
            (0xfc00, f64::NEG_INFINITY),
        ] {
            assert_eq!(of_half(bits), value, "{bits:04x}");
        }
        assert!(of_half(0x7e00).is_nan());
        assert_eq!(signal(0, 24, false, Kind::Float).value(&[0; 8]), None);
    }

    #[test]
    fn a_signal_beyond_the_end_of_the_frame_is_not_read() {
        assert_eq!(signal(7, 16, true, Kind::Unsigned).end(), 2);
        assert_eq!(signal(0, 16, true, Kind::Unsigned).end(), 3);
        assert_eq!(signal(60, 8, false, Kind::Unsigned).end(), 9);
        let short = signal(8, 9, false, Kind::Unsigned);
        assert_eq!(decode(&[short], 0, &[1, 2]), Decoded::Short);
    }

    #[test]
    fn multiplexers_select_signals_also_in_chains_and_never_in_circles() {
        let when = |multiplexer, values| Presence::When { multiplexer, values };
        let mut all: Vec<Signal> = [0, 8, 16].map(|start| signal(start, 8, false, Kind::Unsigned)).into();
        all[1].presence = when(0, vec![1..=1, 5..=7]);
        all[2].presence = when(1, vec![9..=9]);
        assert_eq!(decode(&all, 2, &[6, 9, 42]), Decoded::Value(42.0));
        assert_eq!(decode(&all, 2, &[4, 9, 42]), Decoded::Absent);
        assert_eq!(decode(&all, 2, &[6, 8, 42]), Decoded::Absent);
        assert_eq!(decode(&all, 1, &[1]), Decoded::Short);
        all[0].presence = when(2, vec![0..=255]);
        assert_eq!(decode(&all, 0, &[1, 9, 1]), Decoded::Absent);
    }

    #[test]
    fn numbers_are_finite_and_begin_with_a_digit() {
        assert_eq!(Number::parse("1.0").map(|it| (it.whole, it.written_whole)), Some((Some(1), false)));
        assert_eq!(Number::parse("-1e-3").map(|it| it.value), Some(-1e-3));
        assert_eq!(Number::parse("9223372036854775807").and_then(|it| it.whole), Some(i64::MAX));
        for text in ["", "nan", "inf", "-inf", "1e999", "x", "1,5"] {
            assert_eq!(Number::parse(text), None, "{text}");
        }
    }

    proptest! {
        // Reads bit by bit, by the definition of the numbering.
        #[test]
        fn bits_equal_their_definition(
            data in prop::collection::vec(any::<u8>(), 0..=64), start in 0_u32..520, length in 0_u32..=65, big_endian: bool
        ) {
            let mut at = Some(start);
            let (mut bits, mut missing) = (0_u64, false);
            for index in 0..length.min(64) {
                let Some(place) = at else { break };
                let byte = data.get(place as usize / 8).copied();
                missing |= byte.is_none();
                let bit = u64::from(byte.unwrap_or(0) >> (place % 8) & 1);
                if big_endian {
                    bits = bits << 1 | bit;
                    at = Some(if place % 8 == 0 { place + 15 } else { place - 1 });
                } else {
                    bits |= bit << index;
                    at = Some(place + 1);
                }
            }
            let expected = ((1..=64).contains(&length) && !missing).then_some(bits);
            prop_assert_eq!(signal(start, length, big_endian, Kind::Unsigned).bits(&data), expected);
        }
    }
}
