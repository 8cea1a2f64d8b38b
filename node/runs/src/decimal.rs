//! Lossless text form of numbers: times as whole nanoseconds, values as the shortest decimals that round-trip.
//!
//! At 1.7e9 s an `f64` has steps of 238 ns, so times are never converted to `f64`: decimal text is parsed into an integer
//! number of nanoseconds, and written from it.

use std::fmt::Write as _;

/// Exponents beyond this are refused; such a number could only be zero or overflow.
const EXPONENT_LIMIT: i32 = 1000;

/// Parses decimal seconds (`12`, `-0.5`, `1.7e9`, `.25`) into nanoseconds, rounded half away from zero. A `shift` selects
/// another unit: -3 for milliseconds.
///
/// `None` if the text is not a finite decimal number or does not fit into 64 bits of nanoseconds (about ±292 years).
pub(super) fn parse_nanos(text: &str, shift: i32) -> Option<i64> {
    let (negative, rest) = match text.as_bytes().first()? {
        b'-' => (true, &text[1..]),
        b'+' => (false, &text[1..]),
        _ => (false, text),
    };
    let (mantissa, exponent) = match rest.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (rest, 0),
    };
    if exponent.abs() > EXPONENT_LIMIT {
        return None;
    }
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = || whole.bytes().chain(fraction.bytes());
    if digits().next().is_none() || !digits().all(|b| b.is_ascii_digit()) {
        return None;
    }
    // Number of digits that give whole nanoseconds; the next digit decides the rounding.
    let kept = i64::try_from(whole.len()).ok()? + i64::from(exponent + shift) + 9;
    let mut nanos: i64 = 0;
    let mut digits = digits().map(|b| i64::from(b - b'0'));
    for _ in 0..kept.max(0) {
        nanos = nanos.checked_mul(10)?.checked_add(digits.next().unwrap_or(0))?;
    }
    // If the number is negative, the first digit is below a tenth of a nanosecond.
    if kept >= 0 && digits.next().unwrap_or(0) >= 5 {
        nanos = nanos.checked_add(1)?;
    }
    Some(if negative { -nanos } else { nanos })
}

/// Appends nanoseconds to `text` as exact decimal seconds, without trailing zeros.
pub(super) fn push_nanos(text: &mut String, nanos: i64) {
    const PER_SECOND: u64 = 1_000_000_000;
    let magnitude = nanos.unsigned_abs();
    let (seconds, fraction) = (magnitude / PER_SECOND, magnitude % PER_SECOND);
    let sign = if nanos < 0 { "-" } else { "" };
    // Writing to a `String` cannot fail.
    let _ = write!(text, "{sign}{seconds}");
    if fraction != 0 {
        let _ = write!(text, ".{fraction:09}");
        text.truncate(text.trim_end_matches('0').len());
    }
}

/// Nanoseconds as exact decimal seconds, for messages.
pub(super) fn seconds_text(nanos: i64) -> String {
    let mut text = String::new();
    push_nanos(&mut text, nanos);
    text
}

/// Appends the shortest decimal that parses to exactly `value`, in at most 24 characters. Very large and very small values
/// get an exponent; without it a denormal would take 300 characters.
pub(super) fn push_value(text: &mut String, value: f64) {
    let magnitude = value.abs();
    let _ = if magnitude == 0.0 || (1e-5..1e16).contains(&magnitude) {
        write!(text, "{value}")
    } else {
        write!(text, "{value:e}")
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn times_are_parsed_exactly() {
        for (text, nanos) in [
            ("0", 0),
            ("-0", 0),
            ("1", 1_000_000_000),
            ("0.0003328009", 332_801),
            ("1700000000.123456789", 1_700_000_000_123_456_789),
            ("1.700000000123456789e9", 1_700_000_000_123_456_789),
            ("1700000000123456789e-9", 1_700_000_000_123_456_789),
            ("-1.5", -1_500_000_000),
            (".25", 250_000_000),
            ("5.", 5_000_000_000),
            ("+2E-3", 2_000_000),
            ("0.0000000005", 1),
            ("0.00000000049", 0),
            ("5e-11", 0),
            ("0e900", 0),
            ("9223372036.854775807", i64::MAX),
        ] {
            assert_eq!(parse_nanos(text, 0), Some(nanos), "{text}");
        }
        for text in
            ["", "-", ".", "e5", "1e", "nan", "inf", "1,5", "0x1", "1 2", "9223372037", "1e1001", "--1"]
        {
            assert_eq!(parse_nanos(text, 0), None, "{text}");
        }
    }

    #[test]
    fn values_are_short_at_the_limits_of_the_exponent_form() {
        // Values with 17 digits on both sides of the two limits between the forms with and without an exponent.
        for value in [-1.000_608_361_763_985_1e-5, -9.999_608_361_763_986e-6, -1.0006083617639851e15, -1e16] {
            let mut text = String::new();
            push_value(&mut text, value);
            assert!(text.len() <= 24, "{text}");
            assert_eq!(text.parse(), Ok(value), "{text}");
        }
    }

    proptest! {
        #[test]
        fn times_round_trip(nanos in -i64::MAX..=i64::MAX) {
            prop_assert_eq!(parse_nanos(&seconds_text(nanos), 0), Some(nanos));
        }

        #[test]
        fn values_round_trip(bits: u64) {
            let value = f64::from_bits(bits);
            prop_assume!(value.is_finite());
            let mut text = String::new();
            push_value(&mut text, value);
            let back: f64 = text.parse().expect("what we write is a number");
            prop_assert_eq!(back.to_bits(), bits);
            prop_assert!(text.len() <= 24, "{}", text);
        }

        #[test]
        fn hostile_times_do_not_panic(text in "[-+0-9.eE]{0,40}") {
            let _ = parse_nanos(&text, 0);
        }
    }
}
