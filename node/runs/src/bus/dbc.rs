//! Reads DBC files: the messages and signals of a CAN bus.
//!
//! ```text
//! BO_ 288 SUSP_FL: 8 ECU
//!  SG_ Position : 0|16@1- (0.01,0) [-300|300] "mm" LOGGER
//!  SG_ Oil m1 : 16|8@1+ (1,-40) [0|0] "degC" LOGGER
//! SIG_VALTYPE_ 288 Position : 1;
//! SG_MUL_VAL_ 288 Oil Selector 1-1, 5-7;
//! ```
//!
//! Only these statements and a few attributes (`attributes.rs`) matter for decoding. All others (comments, other attributes, tables of
//! values) are passed over, so their faults cannot make a file unusable. Faults in how a message is defined, such as two signals of one name, are reported when a map uses
//! the message.

mod attributes;
mod marks;
mod tokens;

use super::frame::CanId;
use super::signal::{Kind, Presence, Signal};
use crate::RunError;
use crate::error::DbcFault;
use attributes::{LongName, Protocols};
use marks::{Mark, keep_named_multiplexers, mark_of, select_by_marks};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use tokens::{Fault, KEYWORDS, Token, Tokens, shown};

/// Largest DBC file, bytes. The largest public ones have 2 MB.
const LARGEST: u64 = 64 << 20;
/// The message in which tools keep signals that belong to no message.
const NO_MESSAGE: &str = "VECTOR__INDEPENDENT_SIG_MSG";
/// A message.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Message {
    pub(super) id: CanId,
    pub(super) name: String,
    /// The DBC file, as an index.
    file: usize,
    /// Line of its definition, from 1.
    pub(super) line: usize,
    /// Length in bytes.
    pub(super) bytes: u64,
    /// True for a message of J1939, which is known by its PGN.
    pub(super) is_j1939: bool,
    pub(super) signals: Vec<Signal>,
}

/// The messages of one or several DBC files.
#[derive(Debug, Clone, Default)]
pub(super) struct Database {
    pub(super) messages: Vec<Message>,
    files: Vec<PathBuf>,
}

impl Database {
    /// Reads DBC files.
    ///
    /// # Errors
    /// When a file cannot be read, or is not a DBC file.
    pub(super) fn read(paths: &[PathBuf]) -> Result<Self, RunError> {
        let mut database = Self::default();
        for path in paths {
            let size = std::fs::metadata(path).map_err(RunError::io(path, "open"))?.len();
            if size > LARGEST {
                let fault = DbcFault::TooLarge { bytes: size, most: LARGEST };
                return Err(RunError::Dbc { path: path.clone(), line: 1, fault });
            }
            let bytes = std::fs::read(path).map_err(RunError::io(path, "read"))?;
            database.add(path, &text_of(&bytes))?;
        }
        Ok(database)
    }

    fn add(&mut self, path: &Path, text: &str) -> Result<(), RunError> {
        let file = self.files.len();
        self.files.push(path.to_owned());
        let messages = Parser::new(text, file).messages();
        self.messages.extend(messages.map_err(|(line, fault)| RunError::Dbc {
            path: path.to_owned(),
            line,
            fault,
        })?);
        Ok(())
    }

    /// The file of a message, for messages to the user.
    pub(super) fn file(&self, message: &Message) -> String {
        self.files.get(message.file).map(|path| path.display().to_string()).unwrap_or_default()
    }
}

/// The text of a file in UTF-8, or else in Latin-1: old tools write the latter, and only names of units are affected.
fn text_of(bytes: &[u8]) -> String {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().copied().map(char::from).collect(),
    }
}

/// A statement about a signal that may stand before or after its message.
struct Addition {
    line: usize,
    id: u64,
    signal: String,
    what: Added,
}

enum Added {
    /// The kind of number: 0 for whole numbers, 1 and 2 for floats of 32 and 64 bits.
    NumberKind(u64),
    /// The multiplexer that selects it, and its values.
    Selection { multiplexer: String, values: Vec<RangeInclusive<i128>> },
}

/// A file while it is read.
struct Parser<'a> {
    tokens: Tokens<'a>,
    file: usize,
    messages: Vec<Message>,
    /// The identifiers as written, with bit 31.
    ids: Vec<u64>,
    /// The marks of each message's signals.
    marks: Vec<Vec<Mark>>,
    additions: Vec<Addition>,
    long_names: Vec<LongName>,
    protocols: Protocols,
}

impl<'a> Parser<'a> {
    fn new(text: &'a str, file: usize) -> Self {
        let tokens = Tokens::new(text);
        Self {
            tokens,
            file,
            messages: vec![],
            ids: vec![],
            marks: vec![],
            additions: vec![],
            long_names: vec![],
            protocols: Protocols::default(),
        }
    }

    /// The messages of the file.
    fn messages(mut self) -> Result<Vec<Message>, Fault> {
        let mut statements = 0_usize;
        loop {
            self.tokens.skip_blanks();
            let (line, token) = (self.tokens.line, self.tokens.next()?);
            match token {
                Token::End => break,
                Token::Word("BO_") => self.message(line)?,
                Token::Word("SG_") => self.signal(line)?,
                Token::Word("SIG_VALTYPE_") => self.number_kind(line)?,
                Token::Word("SG_MUL_VAL_") => self.selection(line)?,
                Token::Word("BA_") => self.attribute()?,
                Token::Word("BA_DEF_") => self.attribute_definition()?,
                Token::Word("BA_DEF_DEF_") => self.attribute_default()?,
                Token::Word("NS_") => self.tokens.skip_list(),
                Token::Word(word) if word.starts_with("//") => {
                    self.tokens.skip_line();
                    continue;
                }
                Token::Word(word) if statements == 0 && !KEYWORDS.contains(&word) => {
                    return Err((line, DbcFault::NotDbc { begins: shown(word) }));
                }
                Token::Word(_) => self.tokens.skip_statement()?,
                // The second of two semicolons.
                Token::Mark(';') if statements > 0 => {}
                other => return Err((line, DbcFault::NotDbc { begins: other.shown() })),
            }
            statements += 1;
        }
        if self.messages.is_empty() {
            return Err((self.tokens.line, DbcFault::NoMessages));
        }
        for (message, marks) in self.messages.iter_mut().zip(&self.marks) {
            select_by_marks(message, marks);
        }
        for addition in std::mem::take(&mut self.additions) {
            self.add(addition)?;
        }
        for (message, marks) in self.messages.iter_mut().zip(&self.marks) {
            keep_named_multiplexers(message, marks);
        }
        for long in std::mem::take(&mut self.long_names) {
            self.rename(long);
        }
        for (message, marked) in self.messages.iter_mut().zip(&self.ids) {
            message.is_j1939 = message.id.extended && self.protocols.is_j1939(*marked);
        }
        self.messages.retain(|message| message.name != NO_MESSAGE);
        Ok(self.messages)
    }

    /// `BO_ 288 SUSP_FL: 8 ECU`
    fn message(&mut self, line: usize) -> Result<(), Fault> {
        let marked = self.tokens.whole("the identifier of a message")?;
        let name = self.tokens.word("the name of a message")?.to_owned();
        self.tokens.expect(':', "after the name of a message")?;
        let bytes = self.tokens.whole("the length of a message, in bytes")?;
        // The sender follows; some tools leave it out.
        self.tokens.skip_line();
        let id = u32::try_from(marked).ok().and_then(CanId::of_marked);
        let id = match id {
            Some(id) => id,
            // Its identifier is a placeholder.
            None if name == NO_MESSAGE => CanId { value: 0, extended: true },
            None => return Err((line, DbcFault::Id { message: name, id: marked })),
        };
        let (file, is_j1939, signals) = (self.file, false, Vec::new());
        self.messages.push(Message { id, name, file, line, bytes, is_j1939, signals });
        self.ids.push(marked);
        self.marks.push(Vec::new());
        Ok(())
    }

    /// `SG_ Position m1 : 0|16@1- (0.01,0) [-300|300] "mm" LOGGER`
    fn signal(&mut self, line: usize) -> Result<(), Fault> {
        let tokens = &mut self.tokens;
        let name = tokens.word("the name of a signal")?.to_owned();
        let (Some(message), Some(marks)) = (self.messages.last_mut(), self.marks.last_mut()) else {
            return Err((line, DbcFault::NoMessage { signal: name }));
        };
        let mark = match tokens.next()? {
            Token::Mark(':') => Mark::default(),
            Token::Word(word) => {
                let mark = mark_of(word)
                    .ok_or_else(|| (line, DbcFault::Mark { signal: name.clone(), mark: shown(word) }))?;
                tokens.expect(':', "after the name of a signal")?;
                mark
            }
            other => return Err(tokens.unexpected(&other, "`:` after the name of a signal")),
        };
        let start = tokens.small("the first bit of a signal")?;
        tokens.expect('|', "after the first bit of a signal")?;
        let length = tokens.small("the number of bits of a signal")?;
        tokens.expect('@', "after the number of bits of a signal")?;
        let big_endian = match tokens.letter() {
            Some('0') => true,
            Some('1') => false,
            other => {
                return Err((
                    line,
                    DbcFault::Order { signal: name, found: other.map(String::from).unwrap_or_default() },
                ));
            }
        };
        let kind = match tokens.letter() {
            Some('+') => Kind::Unsigned,
            Some('-') => Kind::Signed,
            other => {
                return Err((
                    line,
                    DbcFault::SignMark { signal: name, found: other.map(String::from).unwrap_or_default() },
                ));
            }
        };
        tokens.expect('(', "before the factor of a signal")?;
        let factor = tokens.number("the factor of a signal")?;
        tokens.expect(',', "after the factor of a signal")?;
        let offset = tokens.number("the offset of a signal")?;
        tokens.expect(')', "after the offset of a signal")?;
        tokens.expect('[', "before the range of a signal")?;
        let low = tokens.number("the least value of a signal")?;
        tokens.expect('|', "after the least value of a signal")?;
        let high = tokens.number("the greatest value of a signal")?;
        tokens.expect(']', "after the greatest value of a signal")?;
        let unit = match tokens.next()? {
            Token::Text(text) => text.trim().to_owned(),
            other => return Err(tokens.unexpected(&other, "the unit of a signal in quotes")),
        };
        // The receivers follow.
        tokens.skip_line();
        let presence = if mark.is_selected { Presence::Unknown } else { Presence::Always };
        // Tools write [0|0] if no range is known.
        let range = (low.value < high.value).then_some([low.value, high.value]);
        message.signals.push(Signal {
            name,
            line,
            start,
            length,
            big_endian,
            kind,
            factor,
            offset,
            range,
            unit,
            presence,
        });
        marks.push(mark);
        Ok(())
    }

    /// `SIG_VALTYPE_ 288 Position : 1;`
    fn number_kind(&mut self, line: usize) -> Result<(), Fault> {
        let id = self.tokens.whole("the identifier of a message")?;
        let signal = self.tokens.word("the name of a signal")?.to_owned();
        let kind = match self.tokens.next()? {
            Token::Mark(':') => self.tokens.whole("the kind of number of a signal")?,
            Token::Word(word) if word.parse::<u64>().is_ok() => word.parse().unwrap_or_default(),
            other => return Err(self.tokens.unexpected(&other, "`:` after the name of a signal")),
        };
        if kind > 2 {
            return Err((line, DbcFault::NumberKind { signal, kind }));
        }
        self.additions.push(Addition { line, id, signal, what: Added::NumberKind(kind) });
        self.tokens.skip_statement()
    }

    /// `SG_MUL_VAL_ 288 Oil Selector 1-1, 5-7;`
    fn selection(&mut self, line: usize) -> Result<(), Fault> {
        let id = self.tokens.whole("the identifier of a message")?;
        let signal = self.tokens.word("the name of a signal")?.to_owned();
        let multiplexer = self.tokens.word("the name of a multiplexer")?.to_owned();
        let mut values = Vec::new();
        loop {
            match self.tokens.next()? {
                Token::Mark(',') => {}
                Token::Mark(';') => break,
                Token::Word(word) => {
                    let ends =
                        word.split_once('-').map(|(low, high)| (low.parse::<u64>(), high.parse::<u64>()));
                    let Some((Ok(low), Ok(high))) = ends else {
                        let found = Token::Word(word);
                        return Err(self
                            .tokens
                            .unexpected(&found, "a range of multiplexer values, such as 1-3"));
                    };
                    values.push(i128::from(low)..=i128::from(high));
                }
                other => {
                    return Err(self.tokens.unexpected(&other, "a range of multiplexer values, such as 1-3"));
                }
            }
        }
        self.additions.push(Addition { line, id, signal, what: Added::Selection { multiplexer, values } });
        Ok(())
    }

    fn add(&mut self, addition: Addition) -> Result<(), Fault> {
        let Addition { line, id, signal, what } = addition;
        for (message, _) in self.messages.iter_mut().zip(&self.ids).filter(|(_, marked)| **marked == id) {
            let place = |name: &str| message.signals.iter().position(|signal| signal.name == name);
            let Some(at) = place(&signal) else { continue };
            match &what {
                Added::NumberKind(0) => {}
                Added::NumberKind(_) => message.signals[at].kind = Kind::Float,
                Added::Selection { multiplexer, values } => {
                    let Some(by) = place(multiplexer) else {
                        let (message, multiplexer) = (message.name.clone(), multiplexer.clone());
                        return Err((line, DbcFault::NoMultiplexer { message, signal, multiplexer }));
                    };
                    match &mut message.signals[at].presence {
                        Presence::When { multiplexer, values: all } if *multiplexer == by => {
                            all.extend(values.iter().cloned())
                        }
                        presence => *presence = Presence::When { multiplexer: by, values: values.clone() },
                    }
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::signal::{Decoded, decode};
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<Vec<Message>, String> {
        Parser::new(text, 0).messages().map_err(|(line, fault)| format!("line {line}: {fault}"))
    }

    const CAR: &str = r#"// car
VERSION "1.0"

NS_ :
	NS_DESC_
	CM_
	BA_DEF_
	SG_MUL_VAL_

BS_:

BU_: ECU LOGGER
VAL_TABLE_ Gear 1 "one; two" 0 "none" ;

BO_ 288 SUSP_FL: 8 ECU
 SG_ Position : 0|16@1- (0.01,0) [-300|300] "mm" LOGGER
 SG_ Load : 23|16@0- (0.001, -2) [0|0] "kN" LOGGER,ECU
 SG_ Page M : 32|8@1+ (1,0) [0|0] "" LOGGER
 SG_ Oil m1 : 40|8@1+ (1,-40) [0|0] "°C" LOGGER
 SG_ Coil m2 : 40|16@1+ (1.0E-3,0) [0|0] "A" Vector__XXX

BO_ 2566848513 WIDE : 64 Vector__XXX
 SG_ Ratio : 0|32@1- (1,0) [0|0] "" LOGGER

BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX
 SG_ Stray : 0|8@1+ (1,0) [0|0] "" LOGGER

CM_ "a comment; with
BO_ 5 no message: 8
 a \"quote\"";
CM_ SG_ 288 Position "the stroke";
BA_ "Cycle" BO_ 288 10;
BA_ "SystemMessageLongSymbol" BO_ 2566848513 "WIDE_with_a_long_name";
BA_ "SystemSignalLongSymbol" SG_ 2566848513 Ratio "Ratio_with_a_long_name";
SIG_VALTYPE_ 2566848513 Ratio : 1;
SG_MUL_VAL_ 288 Coil Page 2-2, 5-7;
"#;

    #[test]
    fn messages_and_signals_are_read() {
        let messages = parse(CAR).expect("a good file");
        let names: Vec<&str> = messages.iter().map(|message| &*message.name).collect();
        assert_eq!(names, ["SUSP_FL", "WIDE_with_a_long_name"]);
        let [susp, wide] = [&messages[0], &messages[1]];
        assert_eq!((susp.id.to_string(), susp.line, susp.bytes), ("0x120".to_owned(), 15, 8));
        assert_eq!((wide.id.to_string(), wide.bytes), ("0x18FF0001 extended".to_owned(), 64));
        let [position, load, _, oil, coil] = &susp.signals[..] else { panic!("five signals") };
        assert_eq!((position.line, &*position.unit, position.big_endian), (16, "mm", false));
        assert_eq!((load.big_endian, load.kind, load.offset.value), (true, Kind::Signed, -2.0));
        assert_eq!(oil.unit, "°C");
        assert_eq!(coil.presence, Presence::When { multiplexer: 2, values: vec![2..=2, 2..=2, 5..=7] });
        assert_eq!((wide.signals[0].kind, &*wide.signals[0].name), (Kind::Float, "Ratio_with_a_long_name"));
        // 0x04d2 is 1234; 0x03e8 is 1000.
        let data = [0xd2, 0x04, 0x03, 0xe8, 1, 65, 0, 0];
        assert_eq!(decode(&susp.signals, 0, &data), Decoded::Value(1234.0 * 0.01));
        assert_eq!(decode(&susp.signals, 1, &data), Decoded::Value(1000.0 * 0.001 - 2.0));
        assert_eq!(decode(&susp.signals, 3, &data), Decoded::Value(25.0));
        assert_eq!(decode(&susp.signals, 4, &data), Decoded::Absent);
    }

    #[test]
    fn several_multiplexers_need_the_extended_statement() {
        let text = "BO_ 1 A: 8 X\n SG_ P M : 0|4@1+ (1,0) [0|0] \"\" X\n SG_ Q m1M : 4|4@1+ (1,0) [0|0] \"\" X\n SG_ R m2 : \
                    8|8@1+ (1,0) [0|0] \"\" X\n SG_ S m3 : 8|8@1+ (1,0) [0|0] \"\" X\nSG_MUL_VAL_ 1 Q P 1-1;\nSG_MUL_VAL_ 1 R Q 2-2;\n";
        let signals = parse(text).expect("good").remove(0).signals;
        assert_eq!(signals[0].presence, Presence::Always);
        assert_eq!(decode(&signals, 2, &[0x21, 7]), Decoded::Value(7.0));
        assert_eq!(decode(&signals, 2, &[0x22, 7]), Decoded::Absent);
        assert_eq!(signals[3].presence, Presence::Unknown);
        let text = "BO_ 1 A: 8 X\n SG_ P m : 0|4@1+ (1,0) [0|0] \"\" X\n SG_ Q m1 : 8|8@1+ (1,0) [0|0] \"\" X\n SG_ R m : 8|8@1+ (1,0) \
                    [0|0] \"\" X\nSG_MUL_VAL_ 1 Q P 1-1;\n";
        let signals = parse(text).expect("good").remove(0).signals;
        assert_eq!(decode(&signals, 0, &[2, 7]), Decoded::Value(2.0));
        assert_eq!(decode(&signals, 1, &[2, 7]), Decoded::Absent);
        assert_eq!(signals[2].presence, Presence::Unknown);
    }

    #[test]
    fn faults_name_line_and_remedy() {
        let signal = |text: &str| format!("BO_ 1 A: 8 X\n SG_ {text}\n");
        for (text, why) in [
            (String::new(), "line 1: no message"),
            (
                "time_s,displacement_m\n0,1\n".into(),
                "line 1: begins with `time_s`, which is not a statement of a DBC file",
            ),
            ("\u{7f}ELF".into(), "which is not a statement"),
            ("VERSION \"\"\n\nBU_: X\n".into(), "line 4: no message (BO_) in it"),
            ("VERSION \"".into(), "line 1: quotes that are not closed"),
            (" SG_ P : 0|4@1+ (1,0) [0|0] \"\" X\n".into(), "line 1: signal `P` stands before any message"),
            ("BO_ x A: 8 X\n".into(), "line 1: `x` where the identifier of a message should be"),
            ("BO_ 4096 A: 8 X\n".into(), "message `A` has the identifier 4096"),
            ("BO_ 1 A 8 X\n".into(), "line 1: `8` where `:` after the name of a message should be"),
            (
                signal("P : a|4@1+ (1,0) [0|0] \"\" X"),
                "line 2: `a` where the first bit of a signal should be",
            ),
            (signal("P : 0|4@2+ (1,0) [0|0] \"\" X"), "line 2: signal `P` has the byte order `2`"),
            (signal("P : 0|4@1* (1,0) [0|0] \"\" X"), "line 2: signal `P` has the sign `*`"),
            (
                signal("P : 0|4@1+ (1;0) [0|0] \"\" X"),
                "line 2: `;` where `,` after the factor of a signal should be",
            ),
            (
                signal("P : 0|4@1+ (nan,0) [0|0] \"\" X"),
                "line 2: `nan` where the factor of a signal should be",
            ),
            (
                signal("P : 0|4@1+ (1,0) [0|0] X"),
                "line 2: `X` where the unit of a signal in quotes should be",
            ),
            (signal("P q : 0|4@1+ (1,0) [0|0] \"\" X"), "line 2: signal `P` has the mark `q`"),
            (
                signal("P : 0|4@1+ (1,0) [0|0] \"\" X\nSIG_VALTYPE_ 1 P : 3;"),
                "line 3: signal `P` has the kind of number 3",
            ),
            (
                signal("P : 0|4@1+ (1,0) [0|0] \"\" X\nSG_MUL_VAL_ 1 P Q 1-1;"),
                "line 3: message `A` has no signal `Q`, which",
            ),
            (
                signal("P : 0|4@1+ (1,0) [0|0] \"\" X\nSG_MUL_VAL_ 1 P P 1;"),
                "line 3: `1` where a range of multiplexer values",
            ),
            (signal("P"), "line 3: `the end of the file` where"),
        ] {
            let message = parse(&text).expect_err(&text);
            assert!(message.contains(why), "{text}: {message}");
        }
    }

    #[test]
    fn old_files_are_in_latin_1() {
        assert_eq!(text_of(b"\xb0C"), "°C");
        assert_eq!(text_of("\u{feff}°C".as_bytes()), "°C");
    }

    proptest! {
        #[test]
        fn no_text_panics(
            parts in prop::collection::vec(
                prop::sample::select(vec![
                    "BO_ ", "SG_ ", "1 ", "A", ": ", "8 ", "X\n", "P ", "m1M ", "|", "@1+ ", "(1,0) ", "[0|0] ", "\"", "\"u\" ", ";\n",
                    "SG_MUL_VAL_ ", "SIG_VALTYPE_ ", "1-2", "NS_ :\n", "é", "-", "CM_ ",
                ]),
                0..40,
            )
        ) {
            if let Ok(messages) = parse(&parts.concat()) {
                for message in &messages {
                    for signal in 0..message.signals.len() {
                        decode(&message.signals, signal, &[1; 64]);
                    }
                }
            }
        }
    }
}
