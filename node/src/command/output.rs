//! Results: a page, JSON to stdout or to a file, text.

use crate::error::NodeError;
use crate::run::write_text;
use crate::shown;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Where results go besides the terminal, of the commands that draw a page.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct OutputArgs {
    /// Write a report with pictures, as one HTML file.
    #[arg(long, value_name = "R.html")]
    pub report: Option<PathBuf>,
    /// Write the figures as JSON to a file, or with - to stdout, alone.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
}

impl OutputArgs {
    /// Writes the page, where one is wanted.
    ///
    /// # Errors
    /// Those of `page`; when the file cannot be written.
    pub fn page(&self, page: impl FnOnce() -> Result<String, NodeError>) -> Result<(), NodeError> {
        if let Some(path) = &self.report {
            write_text(path, &page()?)?;
            tracing::info!(report = %path.display(), "written");
        }
        Ok(())
    }

    /// Writes `value` as JSON, where that is wanted, and prints `text`, unless stdout belongs to the JSON.
    ///
    /// # Errors
    /// When the file or stdout cannot be written.
    pub fn figures(&self, value: &impl Serialize, text: impl FnOnce() -> String) -> Result<(), NodeError> {
        if let Some(path) = &self.json {
            json(path, value)?;
        }
        if self.json.as_deref() != Some(Path::new("-")) {
            print!("{}", shown::lines(&text()));
        }
        Ok(())
    }

    /// The files that are to be written, the JSON first.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let paths = [self.json.as_deref(), self.report.as_deref()];
        paths.into_iter().flatten().filter(|path| *path != Path::new("-"))
    }
}

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
        Ok(write_text(path, &text)?)
    }
}
