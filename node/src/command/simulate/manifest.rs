//! `simulate.toml`: what the runs of a directory are.

use crate::error::NodeError;
use crate::run::write_text;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

const FILE: &str = "simulate.toml";
const SCHEMA: &str = "mr-damper/simulate/1";

/// All simulated runs of a directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    schema: String,
    #[serde(default, rename = "run")]
    runs: Vec<Entry>,
}

/// One run: enough to make it again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    /// File or bag, in the manifest's directory.
    pub(super) file: String,
    /// Experiment, by its name.
    pub(super) experiment: String,
    /// Number of the replicate, from 1.
    pub(super) replicate: u32,
    /// `--seed`.
    pub(super) seed: u64,
    /// Seed of this run, from the above.
    pub(super) run_seed: u64,
    /// Seed of its excitation: runs of one experiment that have the same are replicates in the strict sense.
    pub(super) pattern_seed: u64,
    /// Duration in seconds.
    pub(super) duration_s: f64,
    /// `--amplitude`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) amplitude_m: Option<f64>,
    /// `--frequency`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) frequency_hz: Option<f64>,
    /// `--to-frequency`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) to_frequency_hz: Option<f64>,
    /// `--current`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) current_a: Option<f64>,
    /// `--plain`.
    pub(super) plain: bool,
    /// `--steady`.
    pub(super) steady: bool,
    /// `--perfect`.
    pub(super) perfect: bool,
    /// Noise of the load cell, N.
    pub(super) force_noise_n: f64,
    /// Temperature of the damper at the start, °C.
    pub(super) start_temp_c: f64,
    /// What wrote it.
    pub(super) tool: String,
    /// Effects that were put in, by id, with their sizes.
    pub(super) effects: BTreeMap<String, f64>,
}

impl Manifest {
    /// The manifest of `dir`; an empty one where there is none. Runs that are gone are left out.
    pub(super) fn read(dir: &Path) -> Result<Self, NodeError> {
        let path = dir.join(FILE);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self { schema: SCHEMA.to_owned(), runs: Vec::new() });
            }
            Err(error) => return Err(NodeError::io(format!("reading {}", path.display()))(error)),
        };
        let refuse = |why: String| NodeError::File {
            path: path.clone(),
            message: format!("{why}: move it away, or give another --out"),
        };
        let mut manifest: Self =
            toml::from_str(&text).map_err(|e| refuse(format!("is no manifest of runs ({})", e.message())))?;
        if manifest.schema != SCHEMA {
            return Err(refuse(format!("has the schema {}, not {SCHEMA}", manifest.schema)));
        }
        manifest.runs.retain(|entry| dir.join(&entry.file).exists());
        Ok(manifest)
    }

    /// Adds a run, in the place of one with its file.
    pub(super) fn add(&mut self, entry: Entry) {
        match self.runs.iter_mut().find(|old| old.file == entry.file) {
            Some(old) => *old = entry,
            None => self.runs.push(entry),
        }
    }

    /// Writes the manifest to `dir`, whole or not at all; none when there are no runs.
    pub(super) fn write(&self, dir: &Path) -> Result<(), NodeError> {
        if self.runs.is_empty() {
            return Ok(());
        }
        let text = toml::to_string(self)
            .map_err(|e| NodeError::Failed(format!("the manifest does not go into TOML: {e}")))?;
        let head = "# Runs of the virtual rig, as `mr-damper simulate` wrote them.\n";
        Ok(write_text(&dir.join(FILE), &format!("{head}{text}"))?)
    }
}
