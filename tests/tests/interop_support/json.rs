//! Figures out of JSON, with messages that show the whole of it when something is missing.

use serde_json::Value;

/// A figure by its path, `/force_estimate/lost`.
pub(crate) fn number(value: &Value, path: &str) -> f64 {
    found(value, path).as_f64().unwrap_or_else(|| panic!("{path} is no number in {value:#}"))
}

/// A whole number by its path.
pub(crate) fn count(value: &Value, path: &str) -> u64 {
    found(value, path).as_u64().unwrap_or_else(|| panic!("{path} is no count in {value:#}"))
}

/// A text by its path.
pub(crate) fn text<'a>(value: &'a Value, path: &str) -> &'a str {
    found(value, path).as_str().unwrap_or_else(|| panic!("{path} is no text in {value:#}"))
}

/// A truth value by its path.
pub(crate) fn truth(value: &Value, path: &str) -> bool {
    found(value, path).as_bool().unwrap_or_else(|| panic!("{path} is no truth value in {value:#}"))
}

/// The list at a path, as texts.
pub(crate) fn texts<'a>(value: &'a Value, path: &str) -> Vec<&'a str> {
    let list = found(value, path).as_array().unwrap_or_else(|| panic!("{path} is no list in {value:#}"));
    list.iter().filter_map(Value::as_str).collect()
}

/// Whatever is at a path.
pub(crate) fn found<'a>(value: &'a Value, path: &str) -> &'a Value {
    value.pointer(path).unwrap_or_else(|| panic!("there is no {path} in {value:#}"))
}
