//! What the live page shows of a workshop, and what it can request of it.
//!
//! [`WorkshopState`] is plain data that is sent to the page as JSON. `mr-damper-node` keeps it and does the work: it implements
//! [`WorkshopRequests`].

mod refusal;
mod state;

pub use refusal::{Refusal, RefusalKind};
pub use state::{
    About, Diagnosis, DiagnosisStatus, ReadOptions, Replay, ReplayStatus, RunFigures, StoredRun,
    UploadProgress, WorkshopState,
};

use axum::body::Bytes;
use std::fmt::Debug;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot, watch};

/// The requests of the page to a workshop. Each may take long and is called on a thread of its own, except
/// [`state`](Self::state) and [`state_updates`](Self::state_updates). A request that starts work returns what to tell the user.
pub trait WorkshopRequests: Debug + Send + Sync {
    /// The state that the page shows.
    fn state(&self) -> WorkshopState;

    /// The state as JSON; a new value is sent on every change.
    fn state_updates(&self) -> watch::Receiver<Arc<str>>;

    /// The report named `name`.
    ///
    /// # Errors
    /// When it does not exist.
    fn report(&self, name: &str) -> Result<Vec<u8>, Refusal>;

    /// Deletes the run named `run`.
    ///
    /// # Errors
    /// When it does not exist, is being replayed or opened, or its file cannot be deleted.
    fn delete_run(&self, run: &str) -> Result<String, Refusal>;

    /// Starts an upload that will become the run named `name`. `announced` is its size in bytes, if known.
    ///
    /// # Errors
    /// When the name is not the name of a run, the announced size is too large, too many uploads are running, or the file cannot be
    /// created.
    fn take_upload(
        self: Arc<Self>,
        name: &str,
        reading: ReadOptions,
        announced: Option<u64>,
    ) -> Result<Upload, Refusal>;

    /// Replays the run named `run` with a listed model, at `rate` times the original speed.
    ///
    /// # Errors
    /// When the run or model does not exist, the rate is out of range, or another replay is running.
    fn start_replay(self: Arc<Self>, run: &str, model: &str, rate: f64) -> Result<String, Refusal>;

    /// Passes a command to the running replay.
    ///
    /// # Errors
    /// When no replay is running, or the command does not apply to it.
    fn control_replay(&self, command: ReplayCommand) -> Result<String, Refusal>;

    /// Asks the node of the damper named `damper` for a diagnosis of its last `history_s` seconds, or of its whole history.
    ///
    /// # Errors
    /// When the damper cannot be asked, or a diagnosis of it is already running here.
    fn start_diagnosis(self: Arc<Self>, damper: &str, history_s: Option<f64>) -> Result<String, Refusal>;

    /// Cancels the diagnosis of the damper named `damper`.
    ///
    /// # Errors
    /// When no diagnosis of it is running.
    fn cancel_diagnosis(&self, damper: &str) -> Result<String, Refusal>;
}

/// A part of an upload.
#[derive(Debug)]
pub enum UploadPart {
    /// The next bytes.
    Bytes(Bytes),
    /// The end of the upload.
    End,
}

/// The sending end of an upload.
#[derive(Debug)]
pub struct Upload {
    /// Queue for the parts of the upload.
    pub parts: mpsc::Sender<UploadPart>,
    /// Result of the upload.
    pub kept: oneshot::Receiver<Result<About, Refusal>>,
}

/// A command to a running replay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ReplayCommand {
    /// Pause.
    Pause,
    /// Continue after a pause.
    Resume,
    /// Change the speed, as a multiple of the original.
    Rate(f64),
    /// Stop the replay and its node.
    Stop,
}
