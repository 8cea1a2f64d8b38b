//! Makes text safe for a terminal.
//!
//! File names, CSV headers, topic names and frame ids come from others and may contain control characters. With these,
//! a terminal can be made to hide text, to show other text, or to change its title. They are shown by their code
//! instead, for example `\u{1b}`.

use std::borrow::Cow;
use std::fmt::{self, Write};

/// Longest foreign name in the log, characters.
const SHOWN: usize = 200;

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
    fn a_line_of_an_error_cannot_look_like_another_error() {
        assert_eq!(error(&"a.csv\nerror: \u{1b}]0;b"), "error: a.csv\n  error: \\u{1b}]0;b");
    }

    #[test]
    fn foreign_names_are_safe_for_a_terminal() {
        assert_eq!(name("70/\u{1b}[2J\n"), "70/\\u{1b}[2J\\n");
        assert_eq!(name(&"a".repeat(70_000)).len(), SHOWN);
    }
}
