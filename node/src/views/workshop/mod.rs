//! Uploads, replays and diagnoses from the live page (`mr-damper serve --workshop DIR`).
//!
//! ```text
//! POST ─→ serve/workshop_routes.rs ─→ Workshop ─┬→ upload.rs     one thread per upload: file, loader, list of runs
//!                                               ├→ diagnosis.rs  one thread per diagnosis: close_loop of the damper's node, report
//!                                               └→ replay.rs     one thread with its own node, player and watcher; another
//!                                                    │            computes the errors
//! page ←── state, on each change ←───────────────────┴→ WorkshopState (plain data)      folder.rs: the directory
//! ```
//!
//! `mr-damper-views` has the web server, the displayed state, and the trait [`WorkshopRequests`] between them.
//!
//! Nothing here runs on a thread of the web server. A watched node is affected only through its own action. Runs are replayed
//! through a node in this process, in a namespace that no other process uses.

mod diagnosis;
mod error;
mod folder;
mod replay;
mod upload;

pub use error::WorkshopError;
pub use replay::RATES;

use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use folder::Folder;
use mr_damper_model::preset;
use mr_damper_views::watch::{SharedRegistry, json};
use mr_damper_views::workshop::{
    ReadOptions, Refusal, RefusalKind, ReplayCommand, StoredRun, Upload, WorkshopRequests, WorkshopState,
};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Time that threads have to end when the server stops, so that Ctrl-C ends the process within a second.
const END_WITHIN: Duration = Duration::from_millis(800);

/// Settings of a workshop.
#[derive(Debug)]
pub struct WorkshopSettings {
    /// The directory; created if it is missing.
    pub folder: PathBuf,
    /// The largest upload, bytes.
    pub upload_limit_bytes: u64,
    /// The shared registry of all dampers.
    pub registry: Arc<SharedRegistry>,
    /// ROS domain; negative: `ROS_DOMAIN_ID`, else 0.
    pub domain_id: i64,
    /// The ROS arguments of the process.
    pub ros_args: RosArgs,
    /// Why no diagnosis of the watched dampers can be started; `None` when it can.
    pub no_diagnosis: Option<String>,
}

/// The part of the server that takes uploads and starts replays and diagnoses.
#[derive(Debug)]
pub struct Workshop {
    folder: Folder,
    registry: Arc<SharedRegistry>,
    domain_id: i64,
    ros_args: RosArgs,
    state: Mutex<WorkshopState>,
    state_json: watch::Sender<Arc<str>>,
    /// Namespaces of the dampers that can be asked for a diagnosis, by name.
    diagnosable: Mutex<BTreeMap<String, String>>,
    replay: Mutex<Option<replay::ReplayHandle>>,
    threads: Mutex<Vec<WorkThread>>,
    ids: AtomicU64,
}

/// A thread of the workshop, and the interrupt that ends it.
#[derive(Debug)]
struct WorkThread {
    name: String,
    interrupt: Interrupt,
    handle: JoinHandle<()>,
}

impl Workshop {
    /// Opens the workshop. A separate thread loads the descriptions of the existing runs.
    ///
    /// # Errors
    /// When the directory cannot be opened.
    pub fn open(settings: WorkshopSettings) -> Result<Arc<Self>, NodeError> {
        let folder = Folder::open(&settings.folder)?;
        let runs = folder.runs()?;
        let state = WorkshopState {
            folder: folder.root().display().to_string(),
            upload_limit_bytes: settings.upload_limit_bytes,
            no_closing: settings.no_diagnosis,
            runs: runs.iter().map(|name| StoredRun::Opening { name: name.clone() }).collect(),
            models: models(&folder)?,
            reports: folder.reports()?,
            ..WorkshopState::default()
        };
        let state_json = watch::Sender::new(json(&state).into());
        let workshop = Arc::new(Self {
            folder,
            registry: settings.registry,
            domain_id: settings.domain_id,
            ros_args: settings.ros_args,
            state: Mutex::new(state),
            state_json,
            diagnosable: Mutex::default(),
            replay: Mutex::default(),
            threads: Mutex::default(),
            ids: AtomicU64::new(1),
        });
        let looking = Arc::clone(&workshop);
        workshop.spawn("workshop-runs".to_owned(), move |interrupt| {
            for name in runs.iter().take_while(|_| !interrupt.is_raised()) {
                let stored = match catch_panic(|| looking.folder.about(name)) {
                    Ok(about) => StoredRun::Ready(Box::new(about)),
                    Err(error) => StoredRun::Unusable { name: name.clone(), why: error.to_string() },
                };
                // The run may have been deleted meanwhile.
                looking.change(|state| {
                    state
                        .runs
                        .iter_mut()
                        .filter(|run| run.name() == name)
                        .for_each(|run| *run = stored.clone());
                });
            }
        })?;
        Ok(workshop)
    }

    /// The state that the page shows, as JSON; a new value is sent on every change.
    #[must_use]
    pub fn state_updates(&self) -> watch::Receiver<Arc<str>> {
        self.state_json.subscribe()
    }

    /// Locks the state that the page shows.
    pub fn state(&self) -> MutexGuard<'_, WorkshopState> {
        // Plain data: even after a panic in the middle of a change it can be shown.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state that the page shows, and sends it.
    fn change<T>(&self, how: impl FnOnce(&mut WorkshopState) -> T) -> T {
        let mut state = self.state();
        let done = how(&mut state);
        // Send within the lock, so that changes are sent in their order.
        self.state_json.send_replace(json(&*state).into());
        done
    }

    /// Sets the dampers that can be asked for a diagnosis: names and namespaces.
    pub fn set_diagnosable(&self, diagnosable: Vec<(String, String)>) {
        *self.diagnosable.lock().unwrap_or_else(PoisonError::into_inner) = diagnosable.into_iter().collect();
    }

    /// Updates the list of models after files were added to or removed from the directory.
    pub fn look_for_models(&self) {
        match models(&self.folder) {
            Ok(found) if self.state().models == found => {}
            Ok(found) => self.change(|state| state.models = found),
            Err(error) => tracing::warn!("{error}"),
        }
    }

    /// The report named `name`.
    ///
    /// # Errors
    /// When it does not exist.
    pub fn report(&self, name: &str) -> Result<Vec<u8>, Refusal> {
        self.folder.report(name)
    }

    /// Deletes the run named `name`.
    ///
    /// # Errors
    /// When it does not exist, is being replayed or opened, or its file cannot be deleted.
    pub fn delete_run(&self, name: &str) -> Result<String, Refusal> {
        let mut state = self.state();
        match state.runs.iter().find(|run| run.name() == name) {
            None => {
                return Err(Refusal::new(RefusalKind::Missing, format!("a run named {name} does not exist")));
            }
            Some(StoredRun::Opening { .. }) => {
                return Err(Refusal::new(
                    RefusalKind::Busy,
                    format!("{name} is being opened; wait until that is done"),
                ));
            }
            Some(_) => {}
        }
        if state.replay.as_ref().is_some_and(|replay| replay.run == name && replay.state.is_under_way()) {
            return Err(Refusal::new(
                RefusalKind::Busy,
                format!("{name} is being replayed; stop that first"),
            ));
        }
        self.folder.delete(name)?;
        state.runs.retain(|run| run.name() != name);
        self.state_json.send_replace(json(&*state).into());
        Ok(format!("{name} is deleted"))
    }

    /// A new unique number.
    fn next_id(&self) -> u64 {
        self.ids.fetch_add(1, Ordering::Relaxed)
    }

    /// Runs `work` on a new thread. It should end early when its interrupt, which is also returned, is raised.
    fn spawn(
        &self,
        name: String,
        work: impl FnOnce(&Interrupt) + Send + 'static,
    ) -> Result<Interrupt, NodeError> {
        let interrupt = Interrupt::manual();
        let (theirs, starting) = (interrupt.clone(), NodeError::io(format!("starting the thread {name}")));
        let handle =
            std::thread::Builder::new().name(name.clone()).spawn(move || work(&theirs)).map_err(starting)?;
        let mut threads = self.threads.lock().unwrap_or_else(PoisonError::into_inner);
        threads.retain(|thread| !thread.handle.is_finished());
        threads.push(WorkThread { name, interrupt: interrupt.clone(), handle });
        Ok(interrupt)
    }

    /// Interrupts all work, and returns the deadline for [`Workshop::close`].
    pub fn interrupt(&self) -> Instant {
        let threads = self.threads.lock().unwrap_or_else(PoisonError::into_inner);
        threads.iter().for_each(|thread| thread.interrupt.raise());
        Instant::now() + END_WITHIN
    }

    /// Waits for all work to end until `deadline`, and logs threads that did not; they end with the process. Incomplete uploads are
    /// removed in any case.
    pub fn close(&self, deadline: Instant) {
        let threads = std::mem::take(&mut *self.threads.lock().unwrap_or_else(PoisonError::into_inner));
        for WorkThread { name, handle, .. } in threads {
            while !handle.is_finished() && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(5));
            }
            match handle.is_finished().then(|| handle.join()) {
                Some(Ok(())) => {}
                Some(Err(_)) => tracing::error!(thread = name, "had panicked"),
                None => tracing::info!(thread = name, "did not end in time; it ends with the process"),
            }
        }
        self.folder.sweep();
    }
}

impl WorkshopRequests for Workshop {
    fn state(&self) -> WorkshopState {
        self.state().clone()
    }

    fn state_updates(&self) -> watch::Receiver<Arc<str>> {
        self.state_updates()
    }

    fn report(&self, name: &str) -> Result<Vec<u8>, Refusal> {
        self.report(name)
    }

    fn delete_run(&self, run: &str) -> Result<String, Refusal> {
        self.delete_run(run)
    }

    fn take_upload(
        self: Arc<Self>,
        name: &str,
        reading: ReadOptions,
        announced: Option<u64>,
    ) -> Result<Upload, Refusal> {
        Self::take_upload(&self, name, reading, announced)
    }

    fn start_replay(self: Arc<Self>, run: &str, model: &str, rate: f64) -> Result<String, Refusal> {
        Self::start_replay(&self, run, model, rate)
    }

    fn control_replay(&self, command: ReplayCommand) -> Result<String, Refusal> {
        self.control_replay(command)
    }

    fn start_diagnosis(self: Arc<Self>, damper: &str, history_s: Option<f64>) -> Result<String, Refusal> {
        Self::start_diagnosis(&self, damper, history_s)
    }

    fn cancel_diagnosis(&self, damper: &str) -> Result<String, Refusal> {
        self.cancel_diagnosis(damper)
    }
}

impl From<NodeError> for Refusal {
    fn from(error: NodeError) -> Self {
        Self::new(RefusalKind::Failed, error.to_string())
    }
}

/// Names of the models in the directory, followed by the presets.
fn models(folder: &Folder) -> Result<Vec<String>, NodeError> {
    Ok(folder.models()?.into_iter().chain(preset::names()).collect())
}

/// Runs `work` and turns a panic into an error, so that its end is always reported.
fn catch_panic<T>(work: impl FnOnce() -> Result<T, NodeError>) -> Result<T, NodeError> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(WorkshopError::TaskPanicked.into()))
}
