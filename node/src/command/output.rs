//! Results as JSON, to stdout or to a file.

use crate::error::NodeError;
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// Writes `value` to `path`, or to stdout when that is `-`.
///
/// # Errors
/// When the file or stdout cannot be written.
pub fn json(path: &Path, value: &impl Serialize) -> Result<(), NodeError> {
    let mut text = serde_json::to_string_pretty(value)
        .map_err(|e| NodeError::Failed(format!("the report does not go into JSON: {e}")))?;
    text.push('\n');
    if path == Path::new("-") {
        std::io::stdout().write_all(text.as_bytes()).map_err(NodeError::io("writing to stdout"))
    } else {
        std::fs::write(path, text).map_err(NodeError::io(format!("writing {}", path.display())))
    }
}
