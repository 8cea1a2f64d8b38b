//! State of the workshop: plain data that is sent to the page as JSON.

use mr_damper_reports::diagnosis_summary::DiagnosisSummary;
use mr_damper_reports::evaluate::RunReport;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The whole state.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct WorkshopState {
    /// The directory.
    pub folder: String,
    /// The largest upload, bytes.
    pub upload_limit_bytes: u64,
    /// Why no diagnosis can be started on dampers other than the replayed one; `None` when it can.
    pub no_closing: Option<String>,
    /// The runs.
    pub runs: Vec<StoredRun>,
    /// Uploads in progress.
    pub uploads: Vec<UploadProgress>,
    /// Models to replay with.
    pub models: Vec<String>,
    /// The current or last replay.
    pub replay: Option<Replay>,
    /// The last diagnosis of each damper.
    pub closings: BTreeMap<String, Diagnosis>,
    /// Pages of reports, newest first.
    pub reports: Vec<String>,
}

/// How a run is read, if its file leaves that open.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReadOptions {
    /// Columns in the order of the thesis, without header.
    pub thesis_txt: bool,
    /// Drop bad rows and count them.
    pub skip_bad_rows: bool,
    /// `current_a` or `command_v`, for runs that contain both.
    pub drive: Option<String>,
    /// The damper's namespace in a bag with several dampers.
    pub namespace: Option<String>,
    /// The joint to read from JointState topics.
    pub joint: Option<String>,
}

/// Description of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Name of the run in the directory.
    pub name: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Length of the displacement, s.
    pub length_s: f64,
    /// Mean rate of the displacement, Hz.
    pub rate_hz: Option<f64>,
    /// Number of displacement samples.
    pub samples: usize,
    /// Channels, by the names of their columns.
    pub channels: Vec<String>,
    /// Notes of the loader.
    pub notes: Vec<String>,
    /// SHA-256 of the file.
    pub sha256: String,
    /// How the run is read.
    pub reading: ReadOptions,
}

/// A run in the directory.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state")]
pub enum StoredRun {
    /// The run is being opened.
    Opening {
        /// Name of the run.
        name: String,
    },
    /// The run can be replayed.
    Ready(Box<About>),
    /// The run cannot be used.
    Unusable {
        /// Name of the run.
        name: String,
        /// The reason.
        why: String,
    },
}

impl StoredRun {
    /// Name of the run.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Opening { name } | Self::Unusable { name, .. } => name,
            Self::Ready(about) => &about.name,
        }
    }
}

/// An upload in progress.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct UploadProgress {
    /// Unique number of the upload.
    pub id: u64,
    /// The name that the run will have.
    pub name: String,
    /// Bytes received.
    pub bytes: u64,
    /// Bytes announced by the sender.
    pub of: Option<u64>,
    /// True when all bytes were received and the loader opens the run.
    pub opening: bool,
}

/// State of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReplayStatus {
    /// Node and player start.
    Starting,
    /// Samples are being played.
    Playing,
    /// Playing is paused.
    Paused,
    /// All samples were played; the node has them in its history.
    Ended,
    /// The replay failed.
    Failed,
}

impl ReplayStatus {
    /// True while samples are being played or still will be.
    #[must_use]
    pub const fn is_under_way(self) -> bool {
        matches!(self, Self::Starting | Self::Playing | Self::Paused)
    }
}

/// A replay of a run through a separate node.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Replay {
    /// Unique number of the replay.
    pub id: u64,
    /// The run.
    pub run: String,
    /// The model.
    pub model: String,
    /// Name of the damper on the page.
    pub damper: String,
    /// ROS namespace of the node.
    pub namespace: String,
    /// State of the replay.
    pub state: ReplayStatus,
    /// The state in words.
    pub says: String,
    /// Seconds of the run that were played.
    pub at_s: f64,
    /// Length of the run, s.
    pub length_s: f64,
    /// Speed, as a multiple of the original.
    pub rate: f64,
    /// Errors over the whole run, computed offline.
    pub figures: RunFigures,
}

/// Errors over a whole run, as in `mr-damper evaluate`.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state")]
pub enum RunFigures {
    /// The errors are being computed.
    Computing,
    /// The errors.
    Done(RunReport),
    /// The errors could not be computed.
    None {
        /// The reason.
        why: String,
    },
}

/// State of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DiagnosisStatus {
    /// The node was asked, or is working.
    Working,
    /// Cancelling was requested.
    Cancelling,
    /// The diagnosis was cancelled.
    Cancelled,
    /// The report has arrived.
    Done,
    /// The diagnosis failed.
    Failed,
}

impl DiagnosisStatus {
    /// True until the diagnosis has ended.
    #[must_use]
    pub const fn is_under_way(self) -> bool {
        matches!(self, Self::Working | Self::Cancelling)
    }
}

/// A diagnosis by a running node.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnosis {
    /// Unique number of the diagnosis.
    pub id: u64,
    /// State of the diagnosis.
    pub state: DiagnosisStatus,
    /// The stage, or the result, in words.
    pub says: String,
    /// Approximate progress, from 0 to 1.
    pub progress: f32,
    /// Name of the report's page.
    pub report: Option<String>,
    /// The result.
    pub found: Option<Box<DiagnosisSummary>>,
}
