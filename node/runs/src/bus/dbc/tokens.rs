//! Words, numbers, texts and marks of a DBC file, with their lines.

use crate::bus::signal::Number;
use crate::error::DbcFault;

/// First words of statements, for finding the end of one that is not closed.
pub(super) const KEYWORDS: [&str; 27] = [
    "VERSION",
    "NS_",
    "BS_",
    "BU_",
    "VAL_TABLE_",
    "BO_",
    "SG_",
    "BO_TX_BU_",
    "EV_",
    "ENVVAR_DATA_",
    "EV_DATA_",
    "SGTYPE_",
    "CM_",
    "BA_DEF_",
    "BA_DEF_REL_",
    "BA_DEF_SGTYPE_",
    "BA_DEF_DEF_",
    "BA_DEF_DEF_REL_",
    "BA_",
    "BA_REL_",
    "BA_SGTYPE_",
    "VAL_",
    "CAT_DEF_",
    "SIG_GROUP_",
    "SIG_VALTYPE_",
    "SIGTYPE_VALTYPE_",
    "SG_MUL_VAL_",
];

/// A fault and its line.
pub(super) type Fault = (usize, DbcFault);

/// A part of a DBC file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Token<'a> {
    /// A name, a keyword or a number.
    Word(&'a str),
    /// The content of quotes.
    Text(&'a str),
    Mark(char),
    End,
}

impl Token<'_> {
    pub(super) fn shown(&self) -> String {
        match self {
            Self::Word(word) => shown(word),
            Self::Text(text) => shown(&format!("\"{text}\"")),
            Self::Mark(mark) => mark.to_string(),
            Self::End => "the end of the file".to_owned(),
        }
    }
}

/// A short form of a text of the file.
pub(super) fn shown(text: &str) -> String {
    text.chars().take(40).collect()
}

/// The rest of a file, and its line.
#[derive(Clone)]
pub(super) struct Tokens<'a> {
    rest: &'a str,
    /// The line, from 1.
    pub(super) line: usize,
}

impl<'a> Tokens<'a> {
    pub(super) const fn new(text: &'a str) -> Self {
        Self { rest: text, line: 1 }
    }

    const MARKS: [char; 10] = [':', ';', ',', '|', '@', '(', ')', '[', ']', '"'];

    /// Passes over `count` bytes.
    fn pass(&mut self, count: usize) -> &'a str {
        let (passed, rest) = self.rest.split_at(count);
        self.line += passed.bytes().filter(|byte| *byte == b'\n').count();
        self.rest = rest;
        passed
    }

    pub(super) fn skip_blanks(&mut self) {
        let blanks = self.rest.len() - self.rest.trim_start().len();
        self.pass(blanks);
    }

    /// The next word without passing over it.
    fn peek_word(&self) -> &'a str {
        let is_end = |c: char| c.is_whitespace() || Self::MARKS.contains(&c);
        &self.rest[..self.rest.find(is_end).unwrap_or(self.rest.len())]
    }

    pub(super) fn next(&mut self) -> Result<Token<'a>, Fault> {
        self.skip_blanks();
        match self.rest.chars().next() {
            None => Ok(Token::End),
            Some('"') => self.text().map(Token::Text),
            Some(mark) if Self::MARKS.contains(&mark) => {
                self.pass(mark.len_utf8());
                Ok(Token::Mark(mark))
            }
            Some(_) => Ok(Token::Word(self.pass(self.peek_word().len()))),
        }
    }

    /// A text in quotes; a backslash makes the next character a part of it.
    fn text(&mut self) -> Result<&'a str, Fault> {
        let (line, mut is_escaped) = (self.line, false);
        for (at, c) in self.rest.char_indices().skip(1) {
            match c {
                '"' if !is_escaped => {
                    let text = self.pass(at + 1);
                    return Ok(&text[1..at]);
                }
                _ => is_escaped = c == '\\' && !is_escaped,
            }
        }
        Err((line, DbcFault::OpenText))
    }

    /// The next character that is not a blank.
    pub(super) fn letter(&mut self) -> Option<char> {
        self.skip_blanks();
        let letter = self.rest.chars().next()?;
        self.pass(letter.len_utf8());
        Some(letter)
    }

    pub(super) fn unexpected(&self, found: &Token<'_>, expected: &str) -> Fault {
        (self.line, DbcFault::Unexpected { found: found.shown(), expected: expected.to_owned() })
    }

    pub(super) fn expect(&mut self, mark: char, place: &str) -> Result<(), Fault> {
        match self.next()? {
            Token::Mark(found) if found == mark => Ok(()),
            other => Err(self.unexpected(&other, &format!("`{mark}` {place}"))),
        }
    }

    pub(super) fn word(&mut self, what: &str) -> Result<&'a str, Fault> {
        match self.next()? {
            Token::Word(word) => Ok(word),
            other => Err(self.unexpected(&other, what)),
        }
    }

    fn parsed<T>(&mut self, what: &str, parse: impl FnOnce(&str) -> Option<T>) -> Result<T, Fault> {
        match self.next()? {
            Token::Word(word) => parse(word).ok_or_else(|| self.unexpected(&Token::Word(word), what)),
            other => Err(self.unexpected(&other, what)),
        }
    }

    pub(super) fn whole(&mut self, what: &str) -> Result<u64, Fault> {
        self.parsed(what, |word| word.parse().ok())
    }

    pub(super) fn small(&mut self, what: &str) -> Result<u32, Fault> {
        self.parsed(what, |word| word.parse::<u16>().ok().map(u32::from))
    }

    pub(super) fn number(&mut self, what: &str) -> Result<Number, Fault> {
        self.parsed(what, Number::parse)
    }

    pub(super) fn skip_line(&mut self) {
        self.pass(self.rest.find('\n').unwrap_or(self.rest.len()));
    }

    /// Passes over the rest of a statement: to its semicolon, or to a line that begins with a keyword.
    pub(super) fn skip_statement(&mut self) -> Result<(), Fault> {
        loop {
            let ends = |c: char| matches!(c, ';' | '"' | '\n');
            self.pass(self.rest.find(ends).unwrap_or(self.rest.len()));
            match self.rest.chars().next() {
                None => return Ok(()),
                Some('"') => {
                    self.text()?;
                }
                Some(c) => {
                    self.pass(1);
                    self.skip_blanks();
                    if c == ';' || KEYWORDS.contains(&self.peek_word()) {
                        return Ok(());
                    }
                }
            }
        }
    }

    /// Passes over the list of new symbols: lines with one word each, which are keywords.
    pub(super) fn skip_list(&mut self) {
        self.skip_line();
        loop {
            self.skip_blanks();
            let line = self.rest.split('\n').next().unwrap_or_default().trim_end();
            let is_symbol = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
            if line.is_empty() || !line.chars().all(is_symbol) {
                return;
            }
            self.skip_line();
        }
    }
}
