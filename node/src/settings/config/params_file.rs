//! ROS 2 parameter files: YAML with sections, each for one node or for all nodes that match a pattern.
//!
//! ```yaml
//! /**:                        # all nodes
//!   ros__parameters:
//!     coast_s: 0.3
//! /front_left/mr_damper:      # one node
//!   ros__parameters:
//!     current: {max_a: 1.5}
//! ```
//!
//! In a pattern, `*` matches one part of a name and `**` any number of parts. A section that names the node overrides a
//! section that matches it by a pattern, in any order in the file. A section whose pattern ends in `*` or `**` is
//! shared with other nodes: unknown parameters in it are ignored, with a line in the log. In other sections they are an
//! error.

use super::qos::Overrides;
use super::value::UnsuitableParameter;
use super::{Assignment, Value, is_known};
use crate::settings::error::NodeError;
use std::collections::BTreeMap;
use std::path::Path;

/// The parameters for the node called `full_name` in the file at `path`.
///
/// # Errors
/// When the file cannot be read, is not a parameter file, or contains a value that no parameter can have.
pub(super) fn read(path: &Path, full_name: &str) -> Result<Vec<Assignment>, NodeError> {
    let in_file = |message: String| NodeError::in_file(path, message);
    let unreadable = |e: std::io::Error| NodeError::File { path: path.to_owned(), message: e.to_string() };
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    let sections: BTreeMap<String, serde_json::Value> =
        serde_saphyr::from_str(&text).map_err(|e| in_file(e.to_string()))?;
    let mut matching: Vec<_> = sections.iter().filter(|(section, _)| matches(section, full_name)).collect();
    if matching.is_empty() {
        let names: Vec<_> = sections.keys().map(String::as_str).collect();
        tracing::warn!(file = %path.display(), "no section matches {full_name}; the sections are {}", names.join(", "));
    }
    matching.sort_by_key(|(section, _)| !section.contains('*'));
    let mut all = Vec::new();
    for (section, body) in matching {
        let parameters = body
            .get("ros__parameters")
            .and_then(serde_json::Value::as_object)
            .ok_or_else(|| in_file(format!("{section} has no ros__parameters")))?;
        let mut values = Vec::new();
        let flat = Flat { is_shared: is_shared(section) };
        flat.flatten("", parameters, &mut values).map_err(|error| in_file(format!("{section}: {error}")))?;
        let origin = Some((path.to_owned(), Some(section.clone())));
        all.extend(values.into_iter().map(|(name, value)| Assignment {
            name,
            value,
            origin: origin.clone(),
        }));
    }
    Ok(all)
}

/// True when the pattern `section` matches the node called `full_name`. A missing leading slash makes no difference.
fn matches(section: &str, full_name: &str) -> bool {
    fn parts_match(pattern: &[&str], name: &[&str]) -> bool {
        match (pattern, name) {
            ([], []) => true,
            (["**", rest @ ..], _) => (0..=name.len()).any(|skip| parts_match(rest, &name[skip..])),
            (["*", rest @ ..], [_, others @ ..]) => parts_match(rest, others),
            ([part, rest @ ..], [own, others @ ..]) => part == own && parts_match(rest, others),
            _ => false,
        }
    }
    let parts = |text| str::split(str::trim_matches(text, '/'), '/').collect::<Vec<_>>();
    parts_match(&parts(section), &parts(full_name))
}

/// True for a section that can match several node names.
pub(super) fn is_shared(section: &str) -> bool {
    section.trim_end_matches('/').rsplit('/').next().is_some_and(|node| node.contains('*'))
}

/// Flattens the parameters of a section into a list.
struct Flat {
    /// True if the section is for several nodes.
    is_shared: bool,
}

impl Flat {
    fn flatten(
        &self,
        prefix: &str,
        map: &serde_json::Map<String, serde_json::Value>,
        out: &mut Vec<(String, Value)>,
    ) -> Result<(), UnsuitableParameter> {
        for (key, value) in map {
            let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            match value {
                serde_json::Value::Object(inner) => self.flatten(&name, inner, out)?,
                _ => match Value::try_from(value.clone()) {
                    Ok(value) => out.push((name, value)),
                    // Parameters of other nodes can have types that no parameter of this node has. Their values are not
                    // parsed.
                    Err(_) if self.is_shared && is_foreign(&name) => {
                        out.push((name, Value::Text(value.to_string())));
                    }
                    Err(why) => return Err(UnsuitableParameter { name, why }),
                },
            }
        }
        Ok(())
    }
}

/// True if `name` is unknown, with or without a damper's name as prefix.
fn is_foreign(name: &str) -> bool {
    !is_known(name)
        && !Overrides::are_meant(name)
        && !name.split_once('.').is_some_and(|(_, rest)| is_known(rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_whole_names() {
        let name = "/front/left/mr_damper";
        for section in [
            "/**",
            "**",
            "/**/mr_damper",
            "/front/**",
            "/front/*/mr_damper",
            "/front/left/mr_damper",
            "front/left/mr_damper",
            "/front/**/left/*",
            "/**/left/**",
        ] {
            assert!(matches(section, name), "{section}");
        }
        for section in [
            "/*",
            "/mr_damper",
            "mr_damper",
            "/front/*",
            "/front/right/mr_damper",
            "/**/left",
            "/front/left/mr",
        ] {
            assert!(!matches(section, name), "{section}");
        }
        assert!(matches("mr_damper", "/mr_damper") && matches("/*", "/mr_damper"));
    }

    #[test]
    fn a_section_that_names_the_node_overrides_a_pattern() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("params.yaml");
        let text = "/front_left/mr_damper:\n  ros__parameters:\n    coast_s: 2.0\n\
                    /**:\n  ros__parameters:\n    coast_s: 1.0\n    zenoh:\n      web_rate_hz: 20\n\
                    /rear/mr_damper:\n  ros__parameters:\n    coast_s: 9.0\n";
        std::fs::write(&path, text).expect("writes");
        let read: Vec<_> = read(&path, "/front_left/mr_damper")
            .expect("a good file")
            .into_iter()
            .map(|assignment| (assignment.name, assignment.value))
            .collect();
        let named = |name: &str, value| (name.to_owned(), value);
        assert_eq!(
            read,
            [
                named("coast_s", Value::Double(1.0)),
                named("zenoh.web_rate_hz", Value::Integer(20)),
                named("coast_s", Value::Double(2.0))
            ]
        );
    }

    #[test]
    fn sections_without_a_node_name_are_shared() {
        for section in ["/**", "**", "/*", "/front/**", "/front/*"] {
            assert!(is_shared(section), "{section}");
        }
        for section in ["/**/mr_damper", "/*/mr_damper", "mr_damper", "/front/mr_damper"] {
            assert!(!is_shared(section), "{section}");
        }
    }

    #[test]
    fn errors_name_section_and_parameter() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("params.yaml");
        for (text, says) in [
            ("/**:\n  coast_s: 1\n", "/** has no ros__parameters"),
            ("/**:\n  ros__parameters:\n    coast_s:\n", "/**: coast_s has no value"),
            (
                "/**:\n  ros__parameters:\n    dampers: [1, a]\n",
                "dampers must be a list of texts or of numbers",
            ),
            (": {", "params.yaml"),
        ] {
            std::fs::write(&path, text).expect("writes");
            let message = read(&path, "/mr_damper").expect_err(text).to_string();
            assert!(message.contains(says), "{text}: {message}");
        }
    }
}
