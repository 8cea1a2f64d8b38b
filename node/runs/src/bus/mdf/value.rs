//! Values of a channel in the records of an MDF4 file.

use crate::bus::signal::of_half;

/// How the bits of a value are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Unsigned,
    Signed,
    Float,
    /// Texts and bytes.
    Other,
}

/// Place and form of a value in a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) kind: Kind,
    pub(super) big_endian: bool,
    pub(super) byte: usize,
    /// First bit in the first byte.
    pub(super) bit: u32,
    /// Number of bits.
    pub(super) bits: u32,
}

/// The rule from a raw to a physical value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Conversion {
    Identity,
    /// `raw * factor + offset`.
    Linear {
        factor: f64,
        offset: f64,
    },
    /// `(p0 x^2 + p1 x + p2) / (p3 x^2 + p4 x + p5)`.
    Rational([f64; 6]),
    /// A kind that is not read, by its number.
    Other(u8),
}

impl Place {
    /// True if [`Self::raw`] can read it.
    pub(super) fn is_number(&self) -> bool {
        match self.kind {
            Kind::Unsigned | Kind::Signed => (1..=64).contains(&self.bits),
            Kind::Float => matches!(self.bits, 16 | 32 | 64),
            Kind::Other => false,
        }
    }

    /// The bits; `None` beyond the record.
    pub(super) fn bits(&self, record: &[u8]) -> Option<u64> {
        if self.bits == 0 || self.bits > 64 {
            return None;
        }
        let count = (self.bit % 8 + self.bits).div_ceil(8) as usize;
        let bytes = record.get(self.byte..)?.get(..count)?;
        let append = |sum: u128, byte: &u8| sum << 8 | u128::from(*byte);
        let all =
            if self.big_endian { bytes.iter().fold(0, append) } else { bytes.iter().rev().fold(0, append) };
        Some((all >> (self.bit % 8)) as u64 & u64::MAX >> (64 - self.bits))
    }

    /// The raw value.
    fn raw(&self, record: &[u8]) -> Option<f64> {
        let bits = self.bits(record)?;
        match self.kind {
            Kind::Unsigned => Some(bits as f64),
            Kind::Signed => {
                let unused = 64 - self.bits;
                Some(((bits << unused) as i64 >> unused) as f64)
            }
            Kind::Float => match self.bits {
                16 => Some(of_half(bits as u16)),
                32 => Some(f64::from(f32::from_bits(bits as u32))),
                64 => Some(f64::from_bits(bits)),
                _ => None,
            },
            Kind::Other => None,
        }
    }

    /// The physical value; `None` beyond the record, or if it is not a number.
    pub(super) fn value(&self, conversion: &Conversion, record: &[u8]) -> Option<f64> {
        let raw = self.raw(record)?;
        match conversion {
            Conversion::Identity => Some(raw),
            Conversion::Linear { factor, offset } => {
                let scaled = raw * factor;
                Some(if *offset == 0.0 { scaled } else { scaled + offset })
            }
            Conversion::Rational([a, b, c, d, e, f]) => {
                Some((a * raw * raw + b * raw + c) / (d * raw * raw + e * raw + f))
            }
            Conversion::Other(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_in_both_orders() {
        let place = |kind, big_endian, byte, bit, bits| Place { kind, big_endian, byte, bit, bits };
        let record = [0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc, 0xde, 0xf0, 1, 2];
        for (place, value) in [
            (place(Kind::Unsigned, false, 0, 0, 16), 0x3412 as f64),
            (place(Kind::Unsigned, true, 0, 0, 16), 0x1234 as f64),
            (place(Kind::Unsigned, false, 0, 4, 8), 0x41 as f64),
            (place(Kind::Signed, false, 4, 0, 8), -102.0),
            (place(Kind::Unsigned, false, 1, 4, 64), 0x201f_0deb_c9a7_8563_u64 as f64),
        ] {
            assert_eq!(place.value(&Conversion::Identity, &record), Some(value), "{place:?}");
        }
        assert_eq!(place(Kind::Unsigned, false, 9, 0, 16).bits(&record), None);
        let half = place(Kind::Float, false, 0, 0, 16);
        let linear = Conversion::Linear { factor: 2.0, offset: 0.5 };
        assert_eq!(half.value(&linear, &[0, 0x3c]), Some(2.5));
        // asammdf 8.8.28: ChannelConversion(conversion_type=2, P1=1, P2=2, P3=3, P4=0, P5=0, P6=4).convert([2.0]) is 2.75.
        let rational = Conversion::Rational([1.0, 2.0, 3.0, 0.0, 0.0, 4.0]);
        assert_eq!(place(Kind::Unsigned, false, 0, 0, 8).value(&rational, &[2]), Some(2.75));
        assert_eq!(place(Kind::Other, false, 0, 0, 8).value(&rational, &[2]), None);
    }
}
