//! Encodes signals: the inverse of `signal.rs`.
//!
//! The raw value is `(value - offset) / factor`, rounded to the nearest whole number and to the even one of two, as cantools does. A
//! value that the signal cannot carry is never clipped to one that it can. Such a value is not finite, outside of the range in the DBC
//! file or beyond the signal's bits, or its raw value is the pattern *not available*:
//!
//! | signal | pattern |
//! |---|---|
//! | unsigned | all bits one, as in SAE J1939 |
//! | signed | the least number: only the sign bit is one |
//! | float | NaN |

use super::signal::{Kind, Signal};

/// Bits of a quiet NaN of 32 and of 64 bits.
const NAN: [u64; 2] = [0x7fc0_0000, 0x7ff8_0000_0000_0000];

impl Signal {
    /// The greatest number that the signal's bits hold, as an unsigned number.
    pub(super) fn all_ones(&self) -> u64 {
        u64::MAX >> (64 - self.length.clamp(1, 64))
    }

    /// The bits that mean *not available*.
    pub(super) fn not_available(&self) -> u64 {
        match self.kind {
            Kind::Unsigned => self.all_ones(),
            Kind::Signed => 1 << (self.length.clamp(1, 64) - 1),
            Kind::Float => NAN[usize::from(self.length == 64)],
        }
    }

    /// The bits for a physical value; `None` if the signal cannot carry it.
    pub(super) fn encoded(&self, value: f64) -> Option<u64> {
        if !value.is_finite() || !self.is_in_range(value) {
            return None;
        }
        let bits = self.raw_bits(value)?;
        (bits != self.not_available()).then_some(bits)
    }

    fn raw_bits(&self, value: f64) -> Option<u64> {
        let (factor, offset) = (self.factor.value, self.offset.value);
        let raw = (value - offset) / factor;
        // Two to the power of the number of bits, which `f64` holds exactly.
        let beyond = 2.0_f64.powi(self.length as i32);
        let whole = raw.round_ties_even();
        match self.kind {
            Kind::Unsigned => (0.0..beyond).contains(&whole).then_some(whole as u64),
            Kind::Signed => {
                let fits = (-beyond / 2.0..beyond / 2.0).contains(&whole);
                fits.then_some(whole as i64 as u64 & self.all_ones())
            }
            Kind::Float => {
                // A plain value keeps the sign of zero.
                let raw = if factor == 1.0 && offset == 0.0 { value } else { raw };
                match self.length {
                    32 => Some(raw as f32).filter(|it| it.is_finite()).map(|it| u64::from(it.to_bits())),
                    64 => raw.is_finite().then_some(raw.to_bits()),
                    _ => None,
                }
            }
        }
    }

    /// Writes the signal's bits into `data`, which holds the whole signal; other bits stay.
    pub(super) fn put(&self, bits: u64, data: &mut [u8]) {
        let mut place = self.start as usize;
        for index in 0..self.length {
            let bit = if self.big_endian { self.length - 1 - index } else { index };
            let (byte, mask) = (place / 8, 1_u8 << (place % 8));
            if let Some(byte) = data.get_mut(byte) {
                *byte = if bits >> bit & 1 == 1 { *byte | mask } else { *byte & !mask };
            }
            place = match (self.big_endian, place % 8) {
                (false, _) => place + 1,
                (true, 0) => place + 15,
                (true, _) => place - 1,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::signal::tests as signals;
    use super::super::signal::{Decoded, Kind, Signal, decode};
    use proptest::prelude::*;

    fn signal(start: u32, length: u32, big_endian: bool, kind: Kind, factor: &str, offset: &str) -> Signal {
        signals::scaled(signals::signal(start, length, big_endian, kind), factor, offset)
    }

    #[test]
    fn a_value_beyond_bits_or_range_is_not_clipped() {
        let unsigned = signal(0, 8, false, Kind::Unsigned, "0.5", "-10");
        assert_eq!(unsigned.encoded(-10.0), Some(0));
        assert_eq!(unsigned.encoded(116.74), Some(253));
        assert_eq!(unsigned.encoded(117.0), Some(254));
        for value in [117.5, -10.3, 1e300, f64::NAN, f64::INFINITY] {
            assert_eq!(unsigned.encoded(value), None, "{value}");
        }
        let signed = signal(0, 8, false, Kind::Signed, "1", "0");
        assert_eq!(
            [-128.0, -127.0, -1.0, 127.0, 128.0].map(|value| signed.encoded(value)),
            [None, Some(0x81), Some(0xff), Some(0x7f), None]
        );
        let ranged = Signal { range: Some([-5.0, 5.0]), ..signed };
        assert_eq!([5.0, 5.1].map(|value| ranged.encoded(value)), [Some(5), None]);
        let whole = signal(0, 64, false, Kind::Unsigned, "1", "0");
        assert_eq!(whole.encoded(2.0_f64.powi(64)), None);
        assert_eq!(whole.encoded(2.0_f64.powi(63)), Some(1 << 63));
        let float = signal(0, 32, false, Kind::Float, "1", "0");
        assert_eq!(float.encoded(1e39), None);
        assert_eq!(float.encoded(-0.0), Some(1 << 31));
        assert!(f32::from_bits(float.not_available() as u32).is_nan());
    }

    fn place() -> impl Strategy<Value = (u32, u32, bool)> {
        (0_u32..64, any::<bool>()).prop_flat_map(|(start, big_endian)| {
            let room = if big_endian { 64 - (start / 8 * 8 + 7 - start % 8) } else { 64 - start };
            (Just(start), 1..=room, Just(big_endian))
        })
    }

    proptest! {
        #[test]
        fn decoding_gives_the_encoded_value_within_half_a_step_and_leaves_other_bits(
            (start, length, big_endian) in place(),
            is_signed in any::<bool>(),
            factor in prop::sample::select(vec!["1", "-1", "0.01", "0.1", "3", "-0.25", "1e-3"]),
            offset in prop::sample::select(vec!["0", "-40", "0.5", "1000"]),
            share in 0.0..1.0_f64,
            before in any::<[u8; 8]>(),
        ) {
            let kind = if is_signed { Kind::Signed } else { Kind::Unsigned };
            let signal = signal(start, length, big_endian, kind, factor, offset);
            let low = if is_signed { -2.0_f64.powi(length as i32 - 1) } else { 0.0 };
            let raw = (low + share * 2.0_f64.powi(length as i32)).floor();
            let value = raw * signal.factor.value + signal.offset.value;
            let mut data = before;
            let Some(bits) = signal.encoded(value) else {
                // Only the reserved pattern is left out, and for wide signals what rounds beyond the bits.
                prop_assert!(length > 52 || signal.raw_bits(value) == Some(signal.not_available()));
                return Ok(());
            };
            signal.put(bits, &mut data);
            let Decoded::Value(found) = decode(std::slice::from_ref(&signal), 0, &data) else {
                return Err(TestCaseError::fail("no value"));
            };
            let step = signal.factor.value.abs();
            prop_assert!((found - value).abs() <= 0.5 * step + value.abs() * 1e-15, "{found} {value}");
            // Without the signal's own bits, nothing has changed.
            let (mut left, mut right) = (before, data);
            signal.put(0, &mut left);
            signal.put(0, &mut right);
            prop_assert_eq!(left, right);
        }
    }
}
