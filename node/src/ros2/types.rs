//! `~/get_type_description`: describes the message types of this node, for peers that do not know them (REP-2016).

use mr_damper_msgs::type_description::{
    GetTypeDescriptionRequest, GetTypeDescriptionResponse, TypeDescription, TypeSource,
};
use mr_damper_msgs::{Descriptor, MESSAGES, rihs01};

/// The answer to a request.
#[must_use]
pub fn describe(request: &GetTypeDescriptionRequest) -> GetTypeDescriptionResponse {
    match found(request) {
        Ok((descriptor, type_description)) => GetTypeDescriptionResponse {
            successful: true,
            type_description,
            type_sources: if request.include_type_sources { sources(descriptor) } else { Vec::new() },
            ..GetTypeDescriptionResponse::default()
        },
        Err(error) => GetTypeDescriptionResponse { failure_reason: error.to_string(), ..Default::default() },
    }
}

/// Reasons why a type is not described.
#[derive(Debug, thiserror::Error)]
enum DescribeError {
    #[error("this node uses no message type {name}")]
    UnknownType { name: String },
    #[error("{name} is {own} here, not {requested}; build both with the same interface package")]
    OtherHash { name: String, own: &'static str, requested: String },
    #[error(transparent)]
    Definition(#[from] mr_damper_msgs::msgdef::DefinitionError),
}

fn found(
    request: &GetTypeDescriptionRequest,
) -> Result<(&'static Descriptor, TypeDescription), DescribeError> {
    let GetTypeDescriptionRequest { type_name, type_hash, .. } = request;
    let descriptor = MESSAGES
        .iter()
        .find(|descriptor| descriptor.type_name == type_name)
        .ok_or_else(|| DescribeError::UnknownType { name: type_name.clone() })?;
    if !type_hash.is_empty() && type_hash != descriptor.type_hash {
        let (name, requested) = (type_name.clone(), type_hash.clone());
        return Err(DescribeError::OtherHash { name, own: descriptor.type_hash, requested });
    }
    let described = rihs01::describe(type_name, descriptor.definition)?;
    Ok((descriptor, described))
}

/// The texts of a type and of all types inside it.
fn sources(descriptor: &Descriptor) -> Vec<TypeSource> {
    let separator = "=".repeat(80) + "\n";
    let mut parts = descriptor.definition.split(&*separator);
    let source = |type_name: String, text: &str| TypeSource {
        type_name,
        encoding: "msg".to_owned(),
        raw_file_contents: text.to_owned(),
    };
    let own = source(descriptor.type_name.to_owned(), parts.next().unwrap_or_default());
    let inside = parts.filter_map(|part| {
        // `MSG: package/Name`, then the text.
        let (name, text) = part.strip_prefix("MSG: ")?.split_once('\n')?;
        Some(source(name.replacen('/', "/msg/", 1), text))
    });
    std::iter::once(own).chain(inside).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_type_is_described_with_its_nested_types_and_their_texts() {
        for descriptor in MESSAGES {
            let request = GetTypeDescriptionRequest {
                type_name: descriptor.type_name.to_owned(),
                type_hash: descriptor.type_hash.to_owned(),
                include_type_sources: true,
            };
            let answer = describe(&request);
            assert!(answer.successful, "{}: {}", descriptor.type_name, answer.failure_reason);
            let inside = &answer.type_description.referenced_type_descriptions;
            let mut names: Vec<_> = inside.iter().map(|described| described.type_name.as_str()).collect();
            names.push(descriptor.type_name);
            names.sort_unstable();
            let mut texts: Vec<_> = answer.type_sources.iter().map(|text| text.type_name.as_str()).collect();
            texts.sort_unstable();
            assert_eq!(names, texts);
        }
    }

    #[test]
    fn an_unknown_type_or_hash_is_reported() {
        let ask = |name: &str, hash: &str| {
            describe(&GetTypeDescriptionRequest {
                type_name: name.to_owned(),
                type_hash: hash.to_owned(),
                include_type_sources: false,
            })
        };
        assert!(ask("a/msg/B", "").failure_reason.contains("no message type a/msg/B"));
        assert!(ask("mr_damper_msgs/msg/Force", "RIHS01_00").failure_reason.contains("not RIHS01_00"));
        assert!(ask("mr_damper_msgs/msg/Force", "").type_sources.is_empty());
    }
}
