//! A small parser of `.msg` definitions, for what the type hash and the tests need.
//!
//! It reads the primitive types, `string` and `string<=N`, nested types, `[]`, `[N]` and `[<=N]`, constants and
//! comments. Default values are skipped. `wstring` is refused.

use std::collections::BTreeMap;

/// A line of a definition that cannot be read, or a type without a definition.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DefinitionError {
    /// A line is neither a field nor a constant.
    #[error("{type_name}: `{line}` is neither a field nor a constant")]
    Line {
        /// The type being defined.
        type_name: String,
        /// The line.
        line: String,
    },
    /// A field's type is malformed or outside the supported subset.
    #[error("{type_name}: `{found}` is not a type that can be read")]
    Type {
        /// The type being defined.
        type_name: String,
        /// The type of the field.
        found: String,
    },
    /// A field's type has no definition.
    #[error("no definition of {missing}")]
    Missing {
        /// The type without a definition.
        missing: String,
    },
}

/// The type of one element of a field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Base {
    /// A number or a Boolean, with its id in REP-2016 type descriptions.
    Primitive(u8),
    /// A string, with its maximum length in bytes; 0 means unbounded.
    String(u32),
    /// Another message, by its full name: `std_msgs/msg/Header`.
    Nested(String),
}

/// How many elements a field has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// One.
    One,
    /// Exactly this many.
    Array(u32),
    /// At most this many.
    AtMost(u32),
    /// Any number.
    Sequence,
}

/// One field of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name.
    pub name: String,
    /// Type of one element.
    pub base: Base,
    /// Number of elements.
    pub count: Count,
}

/// One constant of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Constant {
    /// Type, as written.
    pub type_name: String,
    /// Name.
    pub name: String,
    /// Value, as written.
    pub value: String,
}

/// The fields and constants of one message, in the order of the definition.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Definition {
    /// Fields.
    pub fields: Vec<Field>,
    /// Constants.
    pub constants: Vec<Constant>,
}

/// Parses a definition and the definitions of nested types, which follow it after lines of 80 equal signs (see
/// [`crate::Message::DEFINITION`]). The result is indexed by full type name.
///
/// # Errors
/// If a line cannot be read.
pub fn parse_all(type_name: &str, text: &str) -> Result<BTreeMap<String, Definition>, DefinitionError> {
    let separator = "=".repeat(80);
    let mut all = BTreeMap::new();
    for (index, part) in text.split(&separator).enumerate() {
        if index == 0 {
            all.insert(type_name.to_owned(), parse(type_name, part)?);
            continue;
        }
        let (first, body) = part.trim_start().split_once('\n').unwrap_or((part, ""));
        let Some(name) = first.trim().strip_prefix("MSG: ") else {
            return Err(DefinitionError::Line { type_name: type_name.to_owned(), line: first.to_owned() });
        };
        let name = full_name(type_name, name);
        let definition = parse(&name, body)?;
        all.insert(name, definition);
    }
    Ok(all)
}

/// Parses one definition. `type_name` is its full name: `mr_damper_msgs/msg/Force`.
///
/// # Errors
/// If a line cannot be read.
pub fn parse(type_name: &str, text: &str) -> Result<Definition, DefinitionError> {
    let mut definition = Definition::default();
    for line in text.lines() {
        // A `#` inside a string constant or default would be cut here; the supported subset has neither.
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let bad_line = || DefinitionError::Line { type_name: type_name.to_owned(), line: line.to_owned() };
        let (written_type, rest) = line.split_once(char::is_whitespace).ok_or_else(bad_line)?;
        if let Some((name, value)) = rest.split_once('=') {
            definition.constants.push(Constant {
                type_name: written_type.to_owned(),
                name: name.trim().to_owned(),
                value: value.trim().to_owned(),
            });
            continue;
        }
        let name = rest.split_whitespace().next().ok_or_else(bad_line)?;
        if !is_identifier(name) {
            return Err(bad_line());
        }
        let (base, count) = parse_type(type_name, written_type).ok_or_else(|| DefinitionError::Type {
            type_name: type_name.to_owned(),
            found: written_type.to_owned(),
        })?;
        definition.fields.push(Field { name: name.to_owned(), base, count });
    }
    Ok(definition)
}

fn parse_type(owner: &str, written: &str) -> Option<(Base, Count)> {
    let (element, count) = match written.strip_suffix(']') {
        None => (written, Count::One),
        Some(inner) => {
            let (element, size) = inner.rsplit_once('[')?;
            let count = match (size, size.strip_prefix("<=")) {
                ("", _) => Count::Sequence,
                (_, Some(most)) => Count::AtMost(most.parse().ok()?),
                (exactly, None) => Count::Array(exactly.parse().ok()?),
            };
            (element, count)
        }
    };
    let base = match primitive(element) {
        Some(id) => Base::Primitive(id),
        None if element == "string" => Base::String(0),
        None => match element.strip_prefix("string<=") {
            Some(longest) => Base::String(longest.parse().ok()?),
            None if element != "wstring" && element.split('/').all(is_identifier) => {
                Base::Nested(full_name(owner, element))
            }
            None => return None,
        },
    };
    Some((base, count))
}

/// Ids of `type_description_interfaces/msg/FieldType`. `char` in a `.msg` file is an unsigned byte.
fn primitive(name: &str) -> Option<u8> {
    Some(match name {
        "int8" => 2,
        "uint8" | "char" => 3,
        "int16" => 4,
        "uint16" => 5,
        "int32" => 6,
        "uint32" => 7,
        "int64" => 8,
        "uint64" => 9,
        "float32" => 10,
        "float64" => 11,
        "bool" => 15,
        "byte" => 16,
        _ => return None,
    })
}

/// The full form `pkg/folder/Name` of `Name`, `pkg/Name` or `pkg/folder/Name`; a bare name is in the owner's
/// package.
fn full_name(owner: &str, name: &str) -> String {
    match name.split('/').collect::<Vec<_>>()[..] {
        [bare] => format!("{}/msg/{bare}", owner.split('/').next().unwrap_or(owner)),
        [package, bare] => format!("{package}/msg/{bare}"),
        _ => name.to_owned(),
    }
}

fn is_identifier(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str, base: Base, count: Count) -> Field {
        Field { name: name.to_owned(), base, count }
    }

    #[test]
    fn fields_constants_and_comments() {
        let text = "# about\nuint8 A=1 # one\nfloat64[] x # [m]\nOther[<=3] o\nstd_msgs/Header h\n\
                    string<=7 s\nchar[16] c\nint32 n 5\n";
        let definition = parse("pkg/msg/Thing", text).expect("readable");
        assert_eq!(
            definition.fields,
            [
                field("x", Base::Primitive(11), Count::Sequence),
                field("o", Base::Nested("pkg/msg/Other".into()), Count::AtMost(3)),
                field("h", Base::Nested("std_msgs/msg/Header".into()), Count::One),
                field("s", Base::String(7), Count::One),
                field("c", Base::Primitive(3), Count::Array(16)),
                field("n", Base::Primitive(6), Count::One),
            ]
        );
        let constant = Constant { type_name: "uint8".into(), name: "A".into(), value: "1".into() };
        assert_eq!(definition.constants, [constant]);
    }

    #[test]
    fn error_names_the_type_and_the_line() {
        for text in ["float64", "float64 1x", "wstring s", "float64[x] a", "a//b c", "string<=x s", "int8] x"]
        {
            let error = parse("pkg/msg/Thing", text).expect_err(text).to_string();
            assert!(error.starts_with("pkg/msg/Thing: `"), "{text}: {error}");
        }
    }
}
