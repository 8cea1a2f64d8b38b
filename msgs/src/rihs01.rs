//! RIHS01 type hashes (REP-2016).
//!
//! A type is described as JSON: its fields, then the nested types sorted by name, with the spacing of Python's
//! `json.dumps` and without default values, constants and comments. The hash is the SHA-256 of this JSON. ROS 2 peers
//! on rmw_zenoh match types by it; peers on DDS warn if it differs.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use sha2::{Digest, Sha256};

use crate::msgdef::{Base, Count, Definition, DefinitionError, Field, parse_all};
use crate::type_description::{self, FieldType, IndividualTypeDescription, TypeDescription};
use crate::{Message, Service};

/// rosidl gives an empty structure one byte, as C has no empty structures.
const EMPTY: &str = "structure_needs_at_least_one_member";

/// The type hash of a definition: `RIHS01_` and 64 hexadecimal digits.
///
/// `type_name` is the full name (`pkg/msg/Name`). `text` also holds the nested types, as [`Message::DEFINITION`] does.
///
/// # Errors
/// If the text cannot be read, or a type that it uses is not defined.
pub fn hash(type_name: &str, text: &str) -> Result<String, DefinitionError> {
    let mut hash = String::from("RIHS01_");
    for byte in Sha256::digest(type_description(type_name, text)?) {
        // Writing to a string cannot fail.
        let _ = write!(hash, "{byte:02x}");
    }
    Ok(hash)
}

/// The type hash of a service, over its request, its response and the event that service introspection publishes.
///
/// # Errors
/// If a definition cannot be read.
pub fn service_hash<S: Service>() -> Result<String, DefinitionError> {
    let (service, request, response) = (S::TYPE, S::Request::TYPE, S::Response::TYPE);
    let separator = "=".repeat(80);
    let text = format!(
        "{request} request_message\n{response} response_message\n{service}_Event event_message\n\
         {separator}\nMSG: {service}_Event\n\
         service_msgs/ServiceEventInfo info\n{request}[<=1] request\n{response}[<=1] response\n\
         {separator}\nMSG: service_msgs/ServiceEventInfo\n\
         uint8 event_type\nbuiltin_interfaces/Time stamp\nchar[16] client_gid\nint64 sequence_number\n\
         {separator}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n\
         {separator}\nMSG: {request}\n{}\
         {separator}\nMSG: {response}\n{}",
        S::Request::DEFINITION,
        S::Response::DEFINITION,
    );
    hash(service, &text)
}

/// The description of a type and its nested types.
///
/// # Errors
/// If the text cannot be read, or a type that it uses is not defined.
pub fn describe(type_name: &str, text: &str) -> Result<TypeDescription, DefinitionError> {
    let all = parse_all(type_name, text)?;
    let type_description = individual(type_name, find(&all, type_name)?);
    let inside = referenced(&all, type_name)?.into_iter().map(|name| Ok(individual(name, find(&all, name)?)));
    let referenced_type_descriptions = inside.collect::<Result<_, DefinitionError>>()?;
    Ok(TypeDescription { type_description, referenced_type_descriptions })
}

/// The type description as JSON, the input of the hash.
///
/// # Errors
/// If the text cannot be read, or a type that it uses is not defined.
pub fn type_description(type_name: &str, text: &str) -> Result<String, DefinitionError> {
    let described = describe(type_name, text)?;
    let inside: Vec<_> = described.referenced_type_descriptions.iter().map(json).collect();
    Ok(format!(
        "{{\"type_description\": {}, \"referenced_type_descriptions\": [{}]}}",
        json(&described.type_description),
        inside.join(", ")
    ))
}

fn find<'a>(all: &'a BTreeMap<String, Definition>, name: &str) -> Result<&'a Definition, DefinitionError> {
    all.get(name).ok_or_else(|| DefinitionError::Missing { missing: name.to_owned() })
}

/// The names of all nested types of a type, at any depth, sorted.
fn referenced<'a>(
    all: &'a BTreeMap<String, Definition>,
    type_name: &str,
) -> Result<BTreeSet<&'a str>, DefinitionError> {
    let mut seen = BTreeSet::new();
    let mut open = vec![find(all, type_name)?];
    while let Some(definition) = open.pop() {
        for field in &definition.fields {
            if let Base::Nested(name) = &field.base
                && name != type_name
                && seen.insert(name.as_str())
            {
                open.push(find(all, name)?);
            }
        }
    }
    Ok(seen)
}

/// The description of one type, without its nested types.
fn individual(type_name: &str, definition: &Definition) -> IndividualTypeDescription {
    let mut fields: Vec<_> = definition.fields.iter().map(described).collect();
    if fields.is_empty() {
        let filler = Field { name: EMPTY.to_owned(), base: Base::Primitive(3), count: Count::One };
        fields.push(described(&filler));
    }
    IndividualTypeDescription { type_name: type_name.to_owned(), fields }
}

fn described(field: &Field) -> type_description::Field {
    let (id, string_capacity, nested) = match &field.base {
        Base::Primitive(id) => (*id, 0, ""),
        Base::String(0) => (17, 0, ""),
        Base::String(longest) => (21, *longest, ""),
        Base::Nested(name) => (1, 0, name.as_str()),
    };
    let (offset, capacity) = match field.count {
        Count::One => (0, 0),
        Count::Array(size) => (48, size),
        Count::AtMost(size) => (96, size),
        Count::Sequence => (144, 0),
    };
    let r#type = FieldType {
        type_id: id + offset,
        capacity: capacity.into(),
        string_capacity: string_capacity.into(),
        nested_type_name: nested.to_owned(),
    };
    type_description::Field { name: field.name.clone(), r#type, default_value: String::new() }
}

/// JSON as Python's `json.dumps` writes it, without default values. Names are ASCII identifiers, so nothing needs
/// escaping.
fn json(described: &IndividualTypeDescription) -> String {
    let field = |field: &type_description::Field| {
        let FieldType { type_id, capacity, string_capacity, nested_type_name } = &field.r#type;
        format!(
            "{{\"name\": \"{}\", \"type\": {{\"type_id\": {type_id}, \"capacity\": {capacity}, \
             \"string_capacity\": {string_capacity}, \"nested_type_name\": \"{nested_type_name}\"}}}}",
            field.name,
        )
    };
    let fields: Vec<_> = described.fields.iter().map(field).collect();
    format!("{{\"type_name\": \"{}\", \"fields\": [{}]}}", described.type_name, fields.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_description_is_spelled_as_python_does() {
        assert_eq!(
            type_description("a/msg/B", "c/D[2] d\n").map_err(|e| e.to_string()),
            Err("no definition of c/msg/D".to_owned())
        );
        let text = format!("c/D[2] d\n{}\nMSG: c/D\nstring<=4[] s\n", "=".repeat(80));
        assert_eq!(
            type_description("a/msg/B", &text).expect("complete"),
            "{\"type_description\": {\"type_name\": \"a/msg/B\", \"fields\": [{\"name\": \"d\", \"type\": \
             {\"type_id\": 49, \"capacity\": 2, \"string_capacity\": 0, \"nested_type_name\": \"c/msg/D\"}}]}, \
             \"referenced_type_descriptions\": [{\"type_name\": \"c/msg/D\", \"fields\": [{\"name\": \"s\", \
             \"type\": {\"type_id\": 165, \"capacity\": 0, \"string_capacity\": 4, \
             \"nested_type_name\": \"\"}}]}]}"
        );
    }

    #[test]
    fn a_type_inside_itself_ends() {
        let text = format!("a/C c\n{}\nMSG: a/C\nB b\nC[] c\n", "=".repeat(80));
        let hash = hash("a/msg/B", &text).expect("complete");
        assert_eq!(hash.len(), "RIHS01_".len() + 64);
    }

    #[test]
    fn comments_and_constants_do_not_change_the_hash() {
        assert_eq!(hash("a/msg/B", "bool x"), hash("a/msg/B", "# why\nuint8 N=3\n\nbool x # yes\n"));
        assert_ne!(hash("a/msg/B", "bool x"), hash("a/msg/B", "bool y"));
    }
}
