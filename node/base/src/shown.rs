//! Makes text safe for a terminal.
//!
//! File names, CSV headers, topic names and frame ids come from others and may contain control characters. With these,
//! a terminal can be made to hide text, to show other text, or to change its title. They are shown by their code
//! instead, for example `\u{1b}`.

use std::borrow::Cow;
use std::fmt::{self, Write};

/// Longest foreign name in the log, characters.
const SHOWN: usize = 200;
/// Jaro-Winkler similarity from which a name may be a misspelling of another, of 1.
pub const ALIKE: f64 = 0.85;

/// `text` with control characters escaped; the result stays on one line.
#[must_use]
pub fn line(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c != '\t' && c.is_control())
}

/// `text` with control characters escaped except line ends, for text of several lines.
#[must_use]
pub fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| !matches!(c, '\t' | '\n') && c.is_control())
}

/// An error in the form of the command line. Further lines are indented, so that they cannot be mistaken for another
/// message.
#[must_use]
pub fn error(error: &impl fmt::Display) -> String {
    format!("error: {}", lines(&error.to_string()).trim_end().replace('\n', "\n  "))
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.chars().any(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_escaped(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    Cow::Owned(out)
}

/// Passes text to another writer in the form of [`line()`].
#[derive(Debug)]
pub struct OneLine<W>(pub W);

impl<W: Write> Write for OneLine<W> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write_str(&line(text))
    }
}

/// A number with its noun: `count(1, "run")` is `1 run`, `count(3, "run")` is `3 runs`. For nouns whose plural ends in s.
#[must_use]
pub fn count(number: impl TryInto<u128>, noun: &str) -> String {
    // Every unsigned number converts.
    match number.try_into().unwrap_or(0) {
        1 => format!("1 {noun}"),
        number => format!("{number} {noun}s"),
    }
}

/// The one of `known` that `name` is most likely a misspelling of; `None` if it resembles none.
///
/// The measure is the Jaro-Winkler similarity; names below [`ALIKE`] are not suggested, since a suggestion of something else
/// misleads. Only the first 200 characters are compared.
#[must_use]
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name: String = name.chars().take(SHOWN).collect();
    let rated = known.into_iter().map(|known| (strsim::jaro_winkler(known, &name), known));
    let (likeness, nearest) = rated.max_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (likeness >= ALIKE).then_some(nearest)
}

/// A foreign name in a form that is safe for a log: of limited length and without control characters.
#[must_use]
pub fn name(name: &str) -> String {
    name.chars().take(SHOWN).flat_map(char::escape_debug).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_by_their_code() {
        let text = "a\u{1b}[31mb\r\n\tc\u{9b}\u{7}é";
        assert_eq!(line(text), "a\\u{1b}[31mb\\r\\n\tc\\u{9b}\\u{7}é");
        assert_eq!(lines(text), "a\\u{1b}[31mb\\r\n\tc\\u{9b}\\u{7}é");
        assert!(matches!(line("plain é"), Cow::Borrowed(_)));
    }

    #[test]
    fn one_thing_has_no_plural() {
        assert_eq!([0_u64, 1, 2].map(|n| count(n, "run")), ["0 runs", "1 run", "2 runs"]);
        assert_eq!(count(1_usize, "test run"), "1 test run");
    }

    #[test]
    fn only_similar_names_are_suggested() {
        let known = ["coast_s", "force_timeout_s", "zenoh.config"];
        assert_eq!(nearest("coast", known), Some("coast_s"));
        assert_eq!(nearest("force_timeouts", known), Some("force_timeout_s"));
        assert_eq!(nearest("zenoh.conf", known), Some("zenoh.config"));
        for other in ["foo", "", "robot_description", "x"] {
            assert_eq!(nearest(other, known), None, "{other}");
        }
        assert_eq!(nearest("coast", []), None);
    }

    #[test]
    fn a_line_of_an_error_cannot_look_like_another_error() {
        assert_eq!(error(&"a.csv\nerror: \u{1b}]0;b"), "error: a.csv\n  error: \\u{1b}]0;b");
    }

    #[test]
    fn foreign_names_are_safe_for_a_terminal() {
        assert_eq!(name("70/\u{1b}[2J\n"), "70/\\u{1b}[2J\\n");
        assert_eq!(name(&"a".repeat(70_000)).len(), SHOWN);
    }
}
