//! The `_time` parameter of a query: `[now(-10s)..]`, `[2026-01-02T03:04:05Z..now()[`, and so on.
//!
//! A bracket that opens towards the times includes the bound; a bracket that opens away from them excludes it. Either
//! bound may be left out. Zenoh has a parser too, but only as an unstable feature.

use chrono::DateTime;

/// A range of times in nanoseconds since 1970, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeRange {
    /// First time of the range.
    pub from_ns: i64,
    /// Last time of the range; earlier than the first when the range is empty.
    pub to_ns: i64,
}

/// A `_time` parameter that is not a range of times.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("_time={text}: {problem}; write for example _time=[now(-10s)..]")]
pub struct TimeRangeError {
    /// The parameter.
    pub text: String,
    /// What is wrong with it.
    pub problem: TimeProblem,
}

/// What is wrong with a range of times.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TimeProblem {
    /// A bracket is missing.
    #[error("brackets are missing (a parameter cannot contain `;`)")]
    NoBrackets,
    /// The two dots are missing.
    #[error("`..` between the two times is missing")]
    NoDots,
    /// A bound is not a time.
    #[error("`{text}` is neither now(..) nor a time such as 2026-01-02T03:04:05Z")]
    NotATime {
        /// The bound.
        text: String,
    },
    /// A bound is beyond the times that nanoseconds since 1970 can express.
    #[error("`{text}` is too far away")]
    TooFar {
        /// The bound.
        text: String,
    },
    /// A duration has no unit.
    #[error("`{text}` needs a unit: u, ms, s, m, h, d or w")]
    NoUnit {
        /// The duration.
        text: String,
    },
    /// A duration has no number.
    #[error("`{text}` is not a number with a unit")]
    NotANumber {
        /// The duration.
        text: String,
    },
}

impl TimeRange {
    /// All times.
    pub const ALL: Self = Self { from_ns: i64::MIN, to_ns: i64::MAX };

    /// Parses the parameter. `now_ns` is the value of `now()`.
    ///
    /// # Errors
    /// [`TimeRangeError`] with the text and what is wrong with it.
    pub fn parse(text: &str, now_ns: i64) -> Result<Self, TimeRangeError> {
        let wrong = |problem| TimeRangeError { text: text.to_owned(), problem };
        let opening = text.chars().next().filter(|c| matches!(c, '[' | ']'));
        let closing = text.chars().next_back().filter(|c| matches!(c, '[' | ']'));
        let (Some(opening), Some(closing), true) = (opening, closing, text.len() >= 2) else {
            return Err(wrong(TimeProblem::NoBrackets));
        };
        let Some((from, to)) = text[1..text.len() - 1].split_once("..") else {
            return Err(wrong(TimeProblem::NoDots));
        };
        let instant = |text: &str| instant(text, now_ns).map_err(wrong);
        let mut range = Self::ALL;
        if !from.is_empty() {
            range.from_ns = instant(from)?.saturating_add(i64::from(opening == ']'));
        }
        if !to.is_empty() {
            range.to_ns = instant(to)?.saturating_sub(i64::from(closing == '['));
        }
        Ok(range)
    }

    /// True when `at_ns` is in the range.
    #[must_use]
    pub fn contains(self, at_ns: i64) -> bool {
        (self.from_ns..=self.to_ns).contains(&at_ns)
    }
}

/// Parses `now()`, `now(-1.5s)` or a time in RFC 3339 format; returns nanoseconds since 1970.
fn instant(text: &str, now_ns: i64) -> Result<i64, TimeProblem> {
    if let Some(offset) = text.strip_prefix("now(").and_then(|rest| rest.strip_suffix(')')) {
        let offset_ns = if offset.is_empty() { 0 } else { duration_ns(offset)? };
        return Ok(now_ns.saturating_add(offset_ns));
    }
    // Zenoh's own type for times panics on times after 2106.
    let time =
        DateTime::parse_from_rfc3339(text).map_err(|_| TimeProblem::NotATime { text: text.to_owned() })?;
    time.timestamp_nanos_opt().ok_or_else(|| TimeProblem::TooFar { text: text.to_owned() })
}

/// Parses a signed number with a unit; returns nanoseconds.
fn duration_ns(text: &str) -> Result<i64, TimeProblem> {
    let split = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let unit_s = match unit {
        "u" => 1e-6,
        "ms" => 1e-3,
        "s" => 1.0,
        "m" => 60.0,
        "h" => 3_600.0,
        "d" => 86_400.0,
        "w" => 604_800.0,
        _ => return Err(TimeProblem::NoUnit { text: text.to_owned() }),
    };
    let number: f64 = number.parse().map_err(|_| TimeProblem::NotANumber { text: text.to_owned() })?;
    // The cast saturates.
    Ok((number * unit_s * 1e9).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: i64 = 1_700_000_000_000_000_000;

    fn range(text: &str) -> (i64, i64) {
        let range = TimeRange::parse(text, NOW).expect("this is a range");
        (range.from_ns, range.to_ns)
    }

    #[test]
    fn ranges_are_read() {
        assert_eq!(range("[..]"), (i64::MIN, i64::MAX));
        assert_eq!(range("[now(-10s)..]"), (NOW - 10_000_000_000, i64::MAX));
        assert_eq!(range("[now(-1.5s)..now()]"), (NOW - 1_500_000_000, NOW));
        assert_eq!(range("]now(-2ms)..now(1m)["), (NOW - 1_999_999, NOW + 59_999_999_999));
        assert_eq!(range("[2023-11-14T22:13:20Z..2023-11-14T23:13:21.5+01:00]"), (NOW, NOW + 1_500_000_000));
        assert_eq!(
            range("[1969-12-31T23:59:59Z..2261-12-31T00:00:00Z]"),
            (-1_000_000_000, 9_214_560_000_000_000_000)
        );
    }

    #[test]
    fn an_invalid_range_is_explained() {
        for (text, word) in [
            ("", "brackets"),
            ("[", "brackets"),
            ("now(-10s)..", "brackets"),
            ("[now(-10s)", "brackets"),
            ("[now(-10s)]", "`..`"),
            ("[now(-10)..]", "unit"),
            ("[now(1.2.3s)..]", "number"),
            ("[yesterday..]", "neither"),
            // Beyond the range of Zenoh's times, and beyond the range of nanoseconds in an i64.
            ("[2823-11-14T22:13:20Z..]", "too far away"),
            ("[..9999-12-31T23:59:59Z]", "too far away"),
            ("é..é", "brackets"),
        ] {
            let message = TimeRange::parse(text, NOW).expect_err("this is not a range").to_string();
            assert!(message.contains(word), "{text}: {message}");
        }
    }
}
