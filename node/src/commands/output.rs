//! Output of results: an HTML report, JSON to stdout or to a file, and text.

use crate::settings::error::{NodeError, PartError};
use mr_damper_base::shown;
use mr_damper_runs::write_text;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Output options of the commands that can write an HTML report.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct OutputArgs {
    /// Write a report with plots to one HTML file.
    #[arg(long, value_name = "R.html")]
    pub report: Option<PathBuf>,
    /// Write the figures as JSON to a file; without a file name, or with -, print only the JSON to stdout.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
    /// Receives all output in place of files and stdout, for a caller of this library.
    #[arg(skip)]
    pub kept: Option<Kept>,
}

/// Output that is kept in memory. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct Kept(Arc<Mutex<KeptOutput>>);

/// The output of a command.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct KeptOutput {
    /// The HTML report.
    pub html: Option<String>,
    /// The JSON.
    pub json: Option<String>,
    /// The text for the terminal.
    pub text: Option<String>,
}

impl Kept {
    fn with(&self, change: impl FnOnce(&mut KeptOutput)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Takes the output out.
    #[must_use]
    pub fn take(&self) -> KeptOutput {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl OutputArgs {
    /// Writes the HTML report if `--report` was given.
    ///
    /// # Errors
    /// The errors of `page`; when the file cannot be written.
    pub fn page(&self, page: impl FnOnce() -> Result<String, NodeError>) -> Result<(), NodeError> {
        if let Some(kept) = &self.kept {
            let html = page()?;
            kept.with(|output| output.html = Some(html));
        } else if let Some(path) = &self.report {
            write_text(path, &page()?)?;
            tracing::info!(report = %path.display(), "written");
        }
        Ok(())
    }

    /// Writes `value` as JSON if `--json` was given, and prints `text` unless the JSON goes to stdout.
    ///
    /// # Errors
    /// When the file or stdout cannot be written.
    pub fn figures(&self, value: &impl Serialize, text: impl FnOnce() -> String) -> Result<(), NodeError> {
        if let Some(kept) = &self.kept {
            let text = text();
            kept.with(|output| output.text = Some(text));
            return self.json_only(value);
        }
        if let Some(path) = &self.json {
            json(path, value)?;
        }
        if self.json.as_deref() != Some(Path::new("-")) {
            print!("{}", shown::lines(&text()));
        }
        Ok(())
    }

    /// Writes `value` as JSON if `--json` was given.
    ///
    /// # Errors
    /// When the file or stdout cannot be written.
    pub fn json_only(&self, value: &impl Serialize) -> Result<(), NodeError> {
        if let Some(kept) = &self.kept {
            let json = json_text(value)?;
            kept.with(|output| output.json = Some(json));
            return Ok(());
        }
        self.json.as_deref().map_or(Ok(()), |path| json(path, value))
    }
}

/// A report cannot be serialised.
#[derive(Debug, thiserror::Error)]
#[error("the report cannot be written as JSON: {0}")]
pub struct UnwritableReport(#[source] serde_json::Error);

impl PartError for UnwritableReport {}

/// Writes `value` as JSON to `path`, or to stdout if `path` is `-`.
///
/// # Errors
/// When the file or stdout cannot be written.
pub fn json(path: &Path, value: &impl Serialize) -> Result<(), NodeError> {
    let text = json_text(value)?;
    if path == Path::new("-") {
        std::io::stdout().write_all(text.as_bytes()).map_err(NodeError::io("writing to stdout"))
    } else {
        Ok(write_text(path, &text)?)
    }
}

/// `value` as indented JSON with a line end.
///
/// # Errors
/// [`UnwritableReport`].
pub fn json_text(value: &impl Serialize) -> Result<String, NodeError> {
    let mut text = serde_json::to_string_pretty(value).map_err(UnwritableReport)?;
    text.push('\n');
    Ok(text)
}
