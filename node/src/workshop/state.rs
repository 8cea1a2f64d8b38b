//! What the workshop shows: plain data, which goes to the page as JSON.

use super::folder::About;
use crate::command::evaluate::RunReport;
use crate::report::answered::Answered;
use serde::Serialize;
use std::collections::BTreeMap;

/// All of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct State {
    /// The directory.
    pub folder: String,
    /// The largest upload, bytes.
    pub upload_limit_bytes: u64,
    /// Why no closing can be started on dampers other than the workshop's own; `None` where it can.
    pub no_closing: Option<String>,
    /// The runs.
    pub runs: Vec<Shelved>,
    /// Uploads that come in.
    pub uploads: Vec<Incoming>,
    /// Models to replay with.
    pub models: Vec<String>,
    /// The run that is replayed, or was last.
    pub replay: Option<Replay>,
    /// The last closing of each damper.
    pub closings: BTreeMap<String, Closing>,
    /// Pages of reports, the newest first.
    pub reports: Vec<String>,
}

/// A run on the shelf.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state")]
pub enum Shelved {
    /// It is being opened.
    Opening {
        /// Its name.
        name: String,
    },
    /// It can be replayed.
    Ready(Box<About>),
    /// It lies there and cannot be used.
    Unusable {
        /// Its name.
        name: String,
        /// Why.
        why: String,
    },
}

impl Shelved {
    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Opening { name } | Self::Unusable { name, .. } => name,
            Self::Ready(about) => &about.name,
        }
    }
}

/// An upload.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Incoming {
    /// Tells it from others.
    pub id: u64,
    /// The name that it will have.
    pub name: String,
    /// Bytes that have come.
    pub bytes: u64,
    /// Bytes that were announced.
    pub of: Option<u64>,
    /// All has come, and the loader opens it.
    pub opening: bool,
}

/// How a replay is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Playing {
    /// Node and player start.
    Starting,
    /// Samples are played.
    Playing,
    /// They wait.
    Paused,
    /// All were played; the node remembers them.
    Ended,
    /// It came to nothing.
    Failed,
}

impl Playing {
    /// True while samples are played or will be.
    #[must_use]
    pub const fn is_under_way(self) -> bool {
        matches!(self, Self::Starting | Self::Playing | Self::Paused)
    }
}

/// A run that is replayed through a node of the workshop's own.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Replay {
    /// Tells it from others.
    pub id: u64,
    /// The run.
    pub run: String,
    /// The model.
    pub model: String,
    /// What the page calls the damper.
    pub damper: String,
    /// Its ROS namespace.
    pub namespace: String,
    /// How it is.
    pub state: Playing,
    /// The same in words.
    pub says: String,
    /// Seconds of the run that were played.
    pub at_s: f64,
    /// Its length, s.
    pub length_s: f64,
    /// Speed, as a multiple of the original.
    pub rate: f64,
    /// The figures of the whole run, offline.
    pub figures: Figures,
}

/// Error figures of a whole run, as `mr-damper evaluate` has them.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state")]
pub enum Figures {
    /// They are computed.
    Computing,
    /// They are there.
    Done(RunReport),
    /// There are none.
    None {
        /// Why.
        why: String,
    },
}

/// How a closing is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Course {
    /// The node is asked, or works.
    Working,
    /// It was told to give up.
    Cancelling,
    /// It gave up.
    Cancelled,
    /// The report is there.
    Done,
    /// It came to nothing.
    Failed,
}

impl Course {
    /// True while it goes on.
    #[must_use]
    pub const fn is_under_way(self) -> bool {
        matches!(self, Self::Working | Self::Cancelling)
    }
}

/// A closing by a running node.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Closing {
    /// Tells it from others.
    pub id: u64,
    /// How it is.
    pub state: Course,
    /// The stage, or how it ended, in words.
    pub says: String,
    /// About how much is done, from 0 to 1.
    pub progress: f32,
    /// The page of the report.
    pub report: Option<String>,
    /// What it found.
    pub found: Option<Box<Answered>>,
}
