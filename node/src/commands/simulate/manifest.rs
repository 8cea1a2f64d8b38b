//! `simulate.toml`: the description of the runs in a directory.

use crate::settings::error::{NodeError, PartError};
use mr_damper_runs::write_text;
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

/// The manifest cannot be serialised.
#[derive(Debug, thiserror::Error)]
#[error("the manifest cannot be written as TOML: {0}")]
struct UnwritableManifest(#[source] toml::ser::Error);

impl PartError for UnwritableManifest {}

/// One run, with all that is needed to reproduce it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    /// File or bag in the manifest's directory.
    pub(super) file: String,
    /// Name of the experiment.
    pub(super) experiment: String,
    /// Number of the replicate, from 1.
    pub(super) replicate: u32,
    /// `--seed`.
    pub(super) seed: u64,
    /// Seed of this run, derived from `seed`.
    pub(super) run_seed: u64,
    /// Seed of its excitation. Runs of one experiment with the same pattern seed are replicates in the strict sense.
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
    /// The constant current.
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
    /// Name and version of the program that wrote it.
    pub(super) tool: String,
    /// Sizes of the added effects, by id.
    pub(super) effects: BTreeMap<String, f64>,
}

impl Manifest {
    /// Reads the manifest of `dir`; without a file it is empty. Runs whose file no longer exists are left out.
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
        let mut manifest: Self = toml::from_str(&text)
            .map_err(|e| refuse(format!("is not a manifest of runs ({})", e.message())))?;
        if manifest.schema != SCHEMA {
            return Err(refuse(format!("has the schema {}, not {SCHEMA}", manifest.schema)));
        }
        manifest.runs.retain(|entry| dir.join(&entry.file).exists());
        Ok(manifest)
    }

    /// Adds a run, or replaces the entry with the same file.
    pub(super) fn add(&mut self, entry: Entry) {
        match self.runs.iter_mut().find(|old| old.file == entry.file) {
            Some(old) => *old = entry,
            None => self.runs.push(entry),
        }
    }

    /// Writes the manifest to `dir`, completely or not at all. Without runs it writes nothing.
    pub(super) fn write(&self, dir: &Path) -> Result<(), NodeError> {
        if self.runs.is_empty() {
            return Ok(());
        }
        let text = toml::to_string(self).map_err(UnwritableManifest)?;
        let head = "# Runs of the virtual rig, as `mr-damper simulate` wrote them.\n";
        Ok(write_text(&dir.join(FILE), &format!("{head}{text}"))?)
    }
}
