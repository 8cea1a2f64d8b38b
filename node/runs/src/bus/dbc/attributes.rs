//! Attributes of a DBC file that matter for decoding: long names, and which messages are of J1939.
//!
//! ```text
//! BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
//! BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
//! BA_ "ProtocolType" "J1939";
//! BA_ "VFrameFormat" BO_ 2364540158 3;
//! BA_ "SystemSignalLongSymbol" SG_ 288 Position "PositionOfTheRod";
//! ```

use super::Parser;
use super::tokens::{Fault, Token, Tokens};

/// The attribute of a message that tells the kind of its frames.
const FORMAT: &str = "VFrameFormat";
/// The attribute of a file that tells the protocol of the bus.
const PROTOCOL: &str = "ProtocolType";
/// The kind of frames, and its number if the file does not list the kinds.
const J1939: (&str, &str) = ("J1939PG", "3");

/// The whole name of a message or signal. Statements have at most 32 characters of it.
pub(super) struct LongName {
    id: u64,
    /// The signal; `None` for the message.
    signal: Option<String>,
    name: String,
}

/// An attribute as the file defines it.
#[derive(Default)]
struct Definition {
    /// The values of an enumeration; empty for another type.
    choices: Vec<String>,
    /// The value of objects without one.
    default: Option<String>,
}

impl Definition {
    /// The name of a value, which may be written as its number.
    fn named<'a>(&'a self, value: &'a str) -> &'a str {
        let choice = value.parse::<usize>().ok().and_then(|index| self.choices.get(index));
        choice.map_or(value, String::as_str)
    }
}

/// The attributes of a file that tell the protocol of its messages.
#[derive(Default)]
pub(super) struct Protocols {
    format: Definition,
    protocol: Definition,
    /// The identifier of a message, with bit 31, and the kind of its frames.
    formats: Vec<(u64, String)>,
    /// The protocol of the bus.
    of_file: Option<String>,
}

impl Protocols {
    fn definition(&mut self, name: &str) -> Option<&mut Definition> {
        match name {
            FORMAT => Some(&mut self.format),
            PROTOCOL => Some(&mut self.protocol),
            _ => None,
        }
    }

    /// True if the message with this identifier, of 29 bits, is one of J1939. The attribute of the message has priority over the file's.
    pub(super) fn is_j1939(&self, id: u64) -> bool {
        let own = self.formats.iter().rev().find(|(known, _)| *known == id).map(|(_, value)| value);
        let format = own.or(self.format.default.as_ref()).map(|value| self.format.named(value));
        match format {
            Some(name) if name == J1939.0 || (name == J1939.1 && self.format.choices.is_empty()) => true,
            // Kinds of 11 bits say nothing about a message of 29 bits.
            Some(name) if name.starts_with("ExtendedCAN") => false,
            _ => {
                let protocol = self.of_file.as_ref().or(self.protocol.default.as_ref());
                protocol.is_some_and(|value| self.protocol.named(value).trim().eq_ignore_ascii_case("J1939"))
            }
        }
    }
}

/// A value: a text or a number.
fn value(tokens: &mut Tokens<'_>) -> Result<Option<String>, Fault> {
    Ok(match tokens.next()? {
        Token::Text(text) | Token::Word(text) => Some(text.to_owned()),
        _ => None,
    })
}

impl Parser<'_> {
    /// `BA_ "SystemSignalLongSymbol" SG_ 288 Position "PositionOfTheRod";`
    pub(super) fn attribute(&mut self) -> Result<(), Fault> {
        let attribute = self.tokens.next()?;
        let id = "the identifier of a message";
        let (id, signal) = match attribute {
            Token::Text("SystemMessageLongSymbol") => {
                self.tokens.word("BO_")?;
                (self.tokens.whole(id)?, None)
            }
            Token::Text("SystemSignalLongSymbol") => {
                self.tokens.word("SG_")?;
                (self.tokens.whole(id)?, Some(self.tokens.word("the name of a signal")?.to_owned()))
            }
            Token::Text(name) => {
                let of = self.tokens.clone();
                self.protocol_attribute(name, of);
                return self.tokens.skip_statement();
            }
            _ => return self.tokens.skip_statement(),
        };
        if let Token::Text(name) = self.tokens.next()? {
            self.long_names.push(LongName { id, signal, name: name.to_owned() });
        }
        self.tokens.skip_statement()
    }

    /// Takes the value of an attribute that tells the protocol. A value that is not written correctly tells nothing, as for all attributes that
    /// do not matter for decoding.
    fn protocol_attribute(&mut self, name: &str, mut of: Tokens<'_>) {
        if name == PROTOCOL
            && let Ok(Some(protocol)) = value(&mut of)
        {
            self.protocols.of_file = Some(protocol);
        }
        if name == FORMAT
            && let (Ok("BO_"), Ok(id), Ok(Some(format))) = (of.word(""), of.whole(""), value(&mut of))
        {
            self.protocols.formats.push((id, format));
        }
    }

    /// `BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";`
    pub(super) fn attribute_definition(&mut self) -> Result<(), Fault> {
        let mut of = self.tokens.clone();
        let mut name = of.next();
        if matches!(name, Ok(Token::Word(_))) {
            name = of.next();
        }
        if let Ok(Token::Text(name)) = name
            && let Some(definition) = self.protocols.definition(name)
            && matches!(of.next(), Ok(Token::Word("ENUM")))
        {
            while let Ok(Token::Text(choice)) = of.next() {
                definition.choices.push(choice.to_owned());
                if !matches!(of.next(), Ok(Token::Mark(','))) {
                    break;
                }
            }
        }
        self.tokens.skip_statement()
    }

    /// `BA_DEF_DEF_ "VFrameFormat" "StandardCAN";`
    pub(super) fn attribute_default(&mut self) -> Result<(), Fault> {
        let mut of = self.tokens.clone();
        if let Ok(Token::Text(name)) = of.next()
            && let Some(definition) = self.protocols.definition(name)
            && let Ok(Some(default)) = value(&mut of)
        {
            definition.default = Some(default);
        }
        self.tokens.skip_statement()
    }

    pub(super) fn rename(&mut self, long: LongName) {
        let all = self.messages.iter_mut().zip(&self.ids);
        for (message, _) in all.filter(|(_, marked)| **marked == long.id) {
            let Some(short) = &long.signal else {
                message.name.clone_from(&long.name);
                continue;
            };
            message
                .signals
                .iter_mut()
                .filter(|it| it.name == *short)
                .for_each(|it| it.name.clone_from(&long.name));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Parser;

    /// For each of the messages A to D, whether it is of J1939. D has 11 bits.
    fn of_j1939(attributes: &str) -> [bool; 4] {
        let ids = [2_364_540_158_u64, 2_566_848_513, 2_147_483_649, 291];
        let messages: String = ids
            .iter()
            .zip(["A", "B", "C", "D"])
            .map(|(id, name)| format!("BO_ {id} {name}: 8 X\n"))
            .collect();
        let messages = Parser::new(&format!("{messages}{attributes}"), 0).messages().expect("a good file");
        std::array::from_fn(|at| messages[at].is_j1939)
    }

    const FORMATS: &str =
        "BA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\",\"reserved\",\"J1939PG\";\n";

    // Without ProtocolType, cantools 45.1.0 has the same in `message.protocol == "j1939"`, but for the message of 11 bits.
    #[test]
    fn the_attributes_tell_which_messages_are_of_j1939() {
        let all = [true, true, true, false];
        let (first, none) = ([true, false, false, false], [false; 4]);
        let int = "BA_DEF_ BO_ \"VFrameFormat\" INT 0 15;\nBA_DEF_DEF_ \"VFrameFormat\" 0;\n";
        let (j1939, extended) =
            ("BA_ \"VFrameFormat\" BO_ 2364540158 3;\n", "BA_ \"VFrameFormat\" BO_ 2566848513 1;\n");
        let default = |name: &str| format!("{FORMATS}BA_DEF_DEF_ \"VFrameFormat\" \"{name}\";\n");
        let protocol = "BA_DEF_ \"ProtocolType\" STRING ;\nBA_DEF_DEF_ \"ProtocolType\" \"\";\n";
        for (attributes, expected) in [
            (String::new(), none),
            (default("StandardCAN") + j1939, first),
            (default("J1939PG"), all),
            (default("J1939PG") + extended, [true, false, true, false]),
            (int.to_owned() + j1939, first),
            // The order of the statements does not count.
            (format!("{j1939}{FORMATS}"), first),
            (j1939.to_owned(), first),
            ("BA_ \"VFrameFormat\" BO_ 2364540158 \"J1939PG\";\n".to_owned(), first),
            // Another list of kinds.
            ("BA_DEF_ BO_ \"VFrameFormat\" ENUM \"J1939PG\",\"a\",\"b\",\"c\";\n".to_owned() + j1939, none),
            // The protocol of the file.
            (format!("{protocol}BA_ \"ProtocolType\" \"J1939\";\n"), all),
            ("BA_DEF_ \"ProtocolType\" STRING ;\nBA_DEF_DEF_ \"ProtocolType\" \"J1939\";\n".to_owned(), all),
            (format!("{protocol}BA_ \"ProtocolType\" \"NMEA\";\n{j1939}"), first),
            (
                default("StandardCAN") + "BA_ \"ProtocolType\" \"J1939\";\n" + extended,
                [true, false, true, false],
            ),
            (default("ExtendedCAN") + "BA_ \"ProtocolType\" \"J1939\";\n" + j1939, first),
        ] {
            assert_eq!(of_j1939(&attributes), expected, "{attributes}");
        }
    }

    #[test]
    fn attributes_that_are_not_written_correctly_tell_nothing() {
        for attributes in [
            "BA_ \"VFrameFormat\";\n",
            "BA_ \"VFrameFormat\" SG_ 2364540158 P 3;\n",
            "BA_ \"VFrameFormat\" BO_ x 3;\n",
            "BA_ \"VFrameFormat\" BO_ 2364540158 ;\n",
            "BA_ \"VFrameFormat\" BO_ 2364540158 99;\n",
            "BA_ \"ProtocolType\" ;\n",
            "BA_DEF_ BO_ ;\nBA_DEF_ ;\nBA_DEF_DEF_ ;\nBA_DEF_DEF_ \"VFrameFormat\" ;\n",
        ] {
            // The statement after it is read.
            let attributes = format!("{attributes}BA_ \"VFrameFormat\" BO_ 2566848513 3;\n");
            assert_eq!(of_j1939(&attributes), [false, true, false, false], "{attributes}");
        }
    }
}
