//! Finished cells on disk, one line of JSON each, so that an interrupted comparison can continue.
//!
//! A line is identified by a key: the hash of everything that determines the cell's figures (the program, the model, the
//! options, every run). If a run or option changes, the key changes, and the line is not used.

use super::error::CompareError;
use super::runs::Source;
use crate::settings::error::NodeError;
use mr_damper_model::compare::Finished;
use mr_damper_model::identify::{ModelSpec, Options};
use mr_damper_model::inverse::Method;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A finished cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(in crate::commands) struct FinishedCell {
    /// Hash of everything that determines the figures.
    pub(in crate::commands) key: String,
    /// Time of identification and tests, s.
    pub(in crate::commands) seconds: f64,
    /// The figures.
    pub(in crate::commands) cell: Finished,
    /// The model as a model file, if there is one.
    pub(in crate::commands) model: Option<String>,
}

/// A line of finished work.
pub(in crate::commands) trait FinishedLine: Serialize + DeserializeOwned {
    /// Hash of everything that determines the figures.
    fn key(&self) -> &str;
}

impl FinishedLine for FinishedCell {
    fn key(&self) -> &str {
        &self.key
    }
}

/// The lines of one kind in the file of finished work.
#[derive(Debug)]
pub(in crate::commands) struct State<L> {
    path: PathBuf,
    known: HashMap<String, L>,
    file: Mutex<File>,
}

impl<L: FinishedLine> State<L> {
    /// Opens the file at `path`, or creates it. A line that a crash cut short is ignored, and so are lines of other kinds.
    ///
    /// # Errors
    /// When the file cannot be read or written.
    pub(in crate::commands) fn open(path: &Path) -> Result<Self, NodeError> {
        let failed = |what: &str| NodeError::io(format!("{what} {}", path.display()));
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(failed("reading")(error)),
        };
        let lines = text.lines().filter_map(|line| serde_json::from_str::<L>(line).ok());
        let known = lines.map(|line| (line.key().to_owned(), line)).collect();
        let mut file = OpenOptions::new().create(true).append(true).open(path).map_err(failed("opening"))?;
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n").map_err(failed("writing"))?;
        }
        Ok(Self { path: path.to_owned(), known, file: Mutex::new(file) })
    }

    /// The line with this key.
    pub(super) fn get(&self, key: &str) -> Option<&L> {
        self.known.get(key)
    }

    /// Appends a line. It has been passed to the operating system when this returns.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(super) fn add(&self, line: &L) -> Result<(), NodeError> {
        let mut text = serde_json::to_string(line).map_err(CompareError::Cell)?;
        text.push('\n');
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(text.as_bytes()).map_err(NodeError::io(format!("writing {}", self.path.display())))
    }
}

/// Everything that determines the figures of a cell, except its model and its training experiment.
#[derive(Debug, Serialize)]
pub(super) struct CellKeys {
    program: String,
    options: String,
    runs: Vec<(String, u32, String)>,
}

impl CellKeys {
    /// Of this program, with `options`, on `sources`.
    pub(super) fn new(options: &Options, sources: &[Source]) -> Self {
        let runs = sources.iter().map(|s| (s.experiment.clone(), s.replicate, s.sha256.clone()));
        Self { program: program(), options: format!("{options:?}"), runs: runs.collect() }
    }

    /// The key of `spec` trained on `experiment`.
    pub(super) fn key(&self, spec: ModelSpec, experiment: &str) -> String {
        self.hash(&format!("{} {} {experiment}", spec.label(), spec.form().name()))
    }

    /// The key of the inverses `methods` trained on `experiment`.
    pub(super) fn inverse_key(&self, methods: &[Method], experiment: &str) -> String {
        self.hash(&format!("inverse {methods:?} {experiment}"))
    }

    fn hash(&self, what: &str) -> String {
        Sha256::digest(format!("{self:?} {what}")).iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// Version, size and time of this executable: another build of the same version may compute other figures.
fn program() -> String {
    let built = std::env::current_exe().and_then(std::fs::metadata).map(|found| {
        let when = found.modified().ok().and_then(|at| at.duration_since(std::time::UNIX_EPOCH).ok());
        (found.len(), when.map_or(0, |when| when.as_nanos()))
    });
    format!("mr-damper {} {:?}", env!("CARGO_PKG_VERSION"), built.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(key: &str) -> FinishedCell {
        let cell = Finished {
            model: "arx".to_owned(),
            form: "passive".to_owned(),
            trained_on: "a".to_owned(),
            parameters: None,
            identification: Vec::new(),
            cross_validation: Vec::new(),
            warnings: Vec::new(),
            failure: Some("too little data".to_owned()),
        };
        FinishedCell { key: key.to_owned(), seconds: 0.1, cell, model: None }
    }

    #[test]
    fn lines_are_read_back_and_a_cut_line_is_ignored() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("state.jsonl");
        let state = State::<FinishedCell>::open(&path).expect("a new file");
        state.add(&line("one")).expect("room");
        std::fs::OpenOptions::new()
            .append(true)
            .open(&path)
            .and_then(|mut file| file.write_all(b"{\"key\": \"tw"))
            .expect("room");
        State::<FinishedCell>::open(&path).expect("the file").add(&line("three")).expect("room");
        let state = State::open(&path).expect("the file");
        assert_eq!((state.get("one"), state.get("two")), (Some(&line("one")), None));
        assert_eq!(state.get("three"), Some(&line("three")));
    }

    #[test]
    fn key_depends_on_options_runs_model_and_experiment() {
        let source =
            |sha256: &str| Source { experiment: "a".to_owned(), replicate: 1, sha256: sha256.to_owned() };
        let options = Options::default();
        let key =
            |options: &Options, sha256, spec, on| CellKeys::new(options, &[source(sha256)]).key(spec, on);
        let first = key(&options, "00", ModelSpec::ARX_PASSIVE, "a");
        assert_eq!(first, key(&options, "00", ModelSpec::ARX_PASSIVE, "a"));
        let others = [
            key(&Options { seed: 1, ..options.clone() }, "00", ModelSpec::ARX_PASSIVE, "a"),
            key(&options, "01", ModelSpec::ARX_PASSIVE, "a"),
            key(&options, "00", ModelSpec::ARX_SEMI_ACTIVE, "a"),
            key(&options, "00", ModelSpec::ARX_PASSIVE, "b"),
        ];
        assert!(!others.contains(&first));
    }
}
