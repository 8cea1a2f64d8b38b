//! Python exceptions for the errors of the command line and the libraries.

use mr_damper_node::NodeError;
use mr_damper_runs::RunError;
use pyo3::prelude::*;
use serde_json::{Map, Value, json};
use std::path::Path;

/// The exception for `error`: `mr_damper.Error` with the message, a stable code, and the fields of the variant.
pub(crate) fn exception(py: Python<'_>, error: &NodeError) -> PyErr {
    let (code, fields) = code_and_fields(error);
    let raised = || -> PyResult<PyErr> {
        let of = py.import("mr_damper._errors")?.getattr("of_native")?;
        let message = error.to_string();
        Ok(PyErr::from_value(of.call1((message, code, Value::Object(fields).to_string()))?))
    };
    raised().unwrap_or_else(|other| other)
}

/// The exception for an error of the readers of runs.
pub(crate) fn of_run(py: Python<'_>, error: RunError) -> PyErr {
    exception(py, &NodeError::from(error))
}

/// The exception for an error of the models.
pub(crate) fn of_model(py: Python<'_>, error: mr_damper_model::Error) -> PyErr {
    exception(py, &NodeError::from(error))
}

/// The stable code of an error, and its fields by name.
fn code_and_fields(error: &NodeError) -> (String, Map<String, Value>) {
    if let NodeError::Run(error) = error {
        return of_run_error(error);
    }
    if let Some(Value::Object(mut fields)) = error.reason() {
        let code = match fields.remove("code") {
            Some(Value::String(code)) => code,
            _ => "model".to_owned(),
        };
        return (code, fields);
    }
    let (code, fields) = match error {
        NodeError::Parameter { name, value, expected } => {
            ("parameter", json!({ "name": name, "value": value, "expected": expected }))
        }
        NodeError::UnknownParameter { name, nearest } => {
            ("unknown_parameter", json!({ "name": name, "nearest": nearest }))
        }
        NodeError::File { path, message } => ("file", json!({ "file": shown(path), "why": message })),
        NodeError::Usage(_) => ("usage", json!({})),
        NodeError::Io { what, .. } => ("io", json!({ "what": what })),
        NodeError::Interrupted => ("interrupted", json!({})),
        _ => ("other", json!({})),
    };
    (code.to_owned(), object(fields))
}

/// The code and the fields of an error of the readers of runs. A field that holds a path is called `file`.
fn of_run_error(error: &RunError) -> (String, Map<String, Value>) {
    let (code, fields) = match error {
        RunError::Io { path, action, .. } => ("io", json!({ "file": shown(path), "action": action })),
        RunError::NotARun { path, why } => ("not_a_run", json!({ "file": shown(path), "why": why })),
        RunError::Database { path, action, why } => {
            ("database", json!({ "file": shown(path), "action": action, "why": why }))
        }
        RunError::Header { path, line, why } => {
            ("header", json!({ "file": shown(path), "line": line, "why": why }))
        }
        RunError::Table { path, why } => ("table", json!({ "file": shown(path), "why": why })),
        RunError::Row { path, row, column, value, why } => {
            ("row", json!({ "file": shown(path), "row": row, "column": column, "value": value, "why": why }))
        }
        RunError::Cell { path, line, column, value, why } => (
            "cell",
            json!({ "file": shown(path), "line": line, "column": column, "value": value, "why": why }),
        ),
        RunError::RowLength { path, line, found, expected, hint } => (
            "row_length",
            json!({ "file": shown(path), "line": line, "found": found, "expected": expected, "hint": hint }),
        ),
        RunError::TimeOrder { path, line, column, value, previous } => (
            "time_order",
            json!({ "file": shown(path), "line": line, "column": column, "value": value, "previous": previous }),
        ),
        RunError::MostlyBad { path, skipped, kept, first } => {
            ("mostly_bad", json!({ "file": shown(path), "skipped": skipped, "kept": kept, "first": first }))
        }
        RunError::NoDisplacement { path, hint } => {
            ("no_displacement", json!({ "file": shown(path), "hint": hint }))
        }
        RunError::BothDrives { path, current, command } => {
            ("both_drives", json!({ "file": shown(path), "current": current, "command": command }))
        }
        RunError::Namespaces { path, what, found } => {
            ("namespaces", json!({ "file": shown(path), "what": what, "found": found }))
        }
        RunError::TopicType { path, topic, found, accepted, instead } => (
            "topic_type",
            json!({
                "file": shown(path), "topic": topic, "found": found, "accepted": accepted, "instead": instead
            }),
        ),
        RunError::Map { path, map, why } => {
            ("map", json!({ "file": shown(path), "map": map, "why": why.to_string() }))
        }
        RunError::Metadata { path, why } => ("metadata", json!({ "file": shown(path), "why": why })),
        RunError::NotABag { path, format, why } => {
            ("not_a_bag", json!({ "file": shown(path), "format": format, "why": why }))
        }
        RunError::Compression { path, offset, name } => {
            ("compression", json!({ "file": shown(path), "offset": offset, "name": name }))
        }
        RunError::Exists { path } => ("exists", json!({ "file": shown(path) })),
        RunError::Target { path } => ("target", json!({ "file": shown(path) })),
        RunError::Unwritable { path, what, why } => {
            ("unwritable", json!({ "file": shown(path), "what": what, "why": why }))
        }
        RunError::Write { path, .. } => ("write", json!({ "file": shown(path) })),
        _ => ("other", json!({})),
    };
    (code.to_owned(), object(fields))
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}

fn object(fields: Value) -> Map<String, Value> {
    match fields {
        Value::Object(fields) => fields,
        _ => Map::new(),
    }
}
