//! Reads values from JSON; error messages show the whole JSON if a value is missing.

use serde_json::Value;

/// A number by its path, such as `/force_estimate/lost`.
pub(crate) fn number(value: &Value, path: &str) -> f64 {
    found(value, path).as_f64().unwrap_or_else(|| panic!("{path} is not a number in {value:#}"))
}

/// An integer by its path.
pub(crate) fn count(value: &Value, path: &str) -> u64 {
    found(value, path).as_u64().unwrap_or_else(|| panic!("{path} is not a count in {value:#}"))
}

/// A string by its path.
pub(crate) fn text<'a>(value: &'a Value, path: &str) -> &'a str {
    found(value, path).as_str().unwrap_or_else(|| panic!("{path} is not a string in {value:#}"))
}

/// A Boolean by its path.
pub(crate) fn truth(value: &Value, path: &str) -> bool {
    found(value, path).as_bool().unwrap_or_else(|| panic!("{path} is not a Boolean in {value:#}"))
}

/// The list at a path, as strings.
pub(crate) fn texts<'a>(value: &'a Value, path: &str) -> Vec<&'a str> {
    let list = found(value, path).as_array().unwrap_or_else(|| panic!("{path} is not a list in {value:#}"));
    list.iter().filter_map(Value::as_str).collect()
}

/// The value at a path.
pub(crate) fn found<'a>(value: &'a Value, path: &str) -> &'a Value {
    value.pointer(path).unwrap_or_else(|| panic!("{path} is missing in {value:#}"))
}
