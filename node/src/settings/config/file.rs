//! The configuration file: TOML, with a table for each dot in a parameter's name.
//!
//! ```toml
//! model = "damper.toml"
//! coast_s = 0.3
//! [zenoh]
//! listen = ["tcp/127.0.0.1:7447"]
//! ```

use super::value::{UnsuitableParameter, UnsuitableValue};
use super::{Assignment, Value};
use crate::settings::error::NodeError;
use std::path::Path;

/// The parameters in the file at `path`.
///
/// # Errors
/// When the file cannot be read, is not TOML, or contains a value that no parameter can have.
pub(super) fn read(path: &Path) -> Result<Vec<Assignment>, NodeError> {
    let in_file = |message: String| NodeError::in_file(path, message);
    let unreadable = |e: std::io::Error| NodeError::File { path: path.to_owned(), message: e.to_string() };
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    let table: toml::Table = toml::from_str(&text).map_err(|e| in_file(e.to_string()))?;
    let mut values = Vec::new();
    flatten("", table, &mut values).map_err(|error| in_file(error.to_string()))?;
    let origin = Some((path.to_owned(), None));
    Ok(values.into_iter().map(|(name, value)| Assignment { name, value, origin: origin.clone() }).collect())
}

fn flatten(
    prefix: &str,
    table: toml::Table,
    out: &mut Vec<(String, Value)>,
) -> Result<(), UnsuitableParameter> {
    for (key, value) in table {
        let name = if prefix.is_empty() { key } else { format!("{prefix}.{key}") };
        match value {
            toml::Value::Table(inner) => flatten(&name, inner, out)?,
            toml::Value::String(text) => out.push((name, Value::Text(text))),
            toml::Value::Integer(n) => out.push((name, Value::Integer(n))),
            toml::Value::Float(x) => out.push((name, Value::Double(x))),
            toml::Value::Boolean(b) => out.push((name, Value::Bool(b))),
            toml::Value::Array(items) => {
                let texts: Option<Vec<String>> =
                    items.iter().map(|item| item.as_str().map(str::to_owned)).collect();
                let number = |item: &toml::Value| {
                    item.as_float().or_else(|| item.as_integer().map(|number| number as f64))
                };
                let numbers: Option<Vec<f64>> = items.iter().map(number).collect();
                match (texts, numbers) {
                    (Some(texts), _) => out.push((name, Value::TextList(texts))),
                    (None, Some(numbers)) => out.push((name, Value::DoubleList(numbers))),
                    (None, None) => return Err(UnsuitableParameter { name, why: UnsuitableValue::Item }),
                }
            }
            toml::Value::Datetime(date) => {
                let date = date.to_string();
                return Err(UnsuitableParameter { name, why: UnsuitableValue::Date { date } });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::Config;
    use super::*;

    fn load_text(text: &str) -> Result<Config, NodeError> {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("node.toml");
        std::fs::write(&path, text).expect("writes");
        let mut config = Config::default();
        read(&path)?.iter().try_for_each(|assignment| assignment.apply(&mut config))?;
        Ok(config)
    }

    #[test]
    fn tables_become_dots() {
        let config = load_text("model = \"m.toml\"\ncoast_s = 1\n[zenoh]\nlisten = [\"tcp/127.0.0.1:1\"]\n")
            .expect("a good file");
        assert_eq!((config.model.as_str(), config.settings.coast_s), ("m.toml", 1.0));
        assert_eq!(config.zenoh.listen, ["tcp/127.0.0.1:1"]);
    }

    #[test]
    fn errors_name_file_and_key() {
        for (text, expected) in [
            ("coast = 1", "coast_s"),
            ("[zenoh]\nlistten = []", "zenoh.listten"),
            ("coast_s = \"x\"", "coast_s is \"x\""),
            ("coast_s = ", "line 1"),
        ] {
            let message = load_text(text).expect_err("a bad file").to_string();
            assert!(message.contains("node.toml") && message.contains(expected), "{text}: {message}");
        }
    }
}
