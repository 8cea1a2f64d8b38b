//! The workshop of the live page: closings of running dampers, runs that are uploaded, and replays of them.
//!
//! ```text
//! POST ─→ serve/bench.rs ─→ Workshop ─┬→ upload.rs    a thread an upload: file, loader, shelf
//!                                     ├→ closing.rs   a thread a closing: the action close_loop of the damper's node, report
//!                                     └→ replay.rs    a thread: a node, a player and a watcher of its own; another for the figures
//!                                          │
//! page ←── state, on each change ←─────────┴→ State (state.rs: plain data)          folder.rs: the directory
//! ```
//!
//! Nothing here is on a thread of the web server, and nothing of a watched node is touched but by its own action. What is replayed
//! goes through a node that lives here, in a namespace that no other process has.

mod closing;
mod folder;
mod refusal;
mod replay;
mod state;
mod upload;

pub use folder::{About, Reading, run_name, safe_name};
pub use refusal::{Kind, Refusal};
pub use replay::{RATES, Turn};
pub use state::{Closing, Course, Figures, Incoming, Playing, Replay, Shelved, State};
pub use upload::{Part, Upload};

use crate::config::RosArgs;
use crate::error::NodeError;
use crate::interrupt::Interrupt;
use crate::watch::{Hall, json};
use folder::Folder;
use mr_damper_model::preset;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// How long threads may take to end once they were told, when the server does: Ctrl-C ends within a second.
const END_WITHIN: Duration = Duration::from_millis(800);

/// What a workshop is opened with.
#[derive(Debug)]
pub struct Opening {
    /// The directory; made where it is missing.
    pub folder: PathBuf,
    /// The largest upload, bytes.
    pub upload_limit_bytes: u64,
    /// Where pictures of dampers hang.
    pub hall: Arc<Hall>,
    /// ROS domain; negative: `ROS_DOMAIN_ID`, else 0.
    pub domain_id: i64,
    /// The ROS arguments of the process.
    pub ros_args: RosArgs,
    /// Why no closing can be started on the dampers that are watched; `None` where it can.
    pub no_closing: Option<String>,
}

/// The workshop.
#[derive(Debug)]
pub struct Workshop {
    folder: Folder,
    hall: Arc<Hall>,
    domain_id: i64,
    ros_args: RosArgs,
    state: Mutex<State>,
    said: watch::Sender<Arc<str>>,
    /// Namespaces of the dampers that can be asked for something, by name.
    askable: Mutex<BTreeMap<String, String>>,
    replay: Mutex<Option<replay::Held>>,
    works: Mutex<Vec<Work>>,
    ids: AtomicU64,
}

/// A thread of the workshop, and what tells it to end.
#[derive(Debug)]
struct Work {
    name: String,
    interrupt: Interrupt,
    thread: JoinHandle<()>,
}

impl Workshop {
    /// Opens the workshop, and looks at the runs that are there on a thread of its own.
    ///
    /// # Errors
    /// When the directory cannot be had.
    pub fn open(opening: Opening) -> Result<Arc<Self>, NodeError> {
        let folder = Folder::open(&opening.folder)?;
        let runs = folder.runs()?;
        let state = State {
            folder: folder.root().display().to_string(),
            upload_limit_bytes: opening.upload_limit_bytes,
            no_closing: opening.no_closing,
            runs: runs.iter().map(|name| Shelved::Opening { name: name.clone() }).collect(),
            models: models(&folder)?,
            reports: folder.reports()?,
            ..State::default()
        };
        let said = watch::Sender::new(json(&state).into());
        let workshop = Arc::new(Self {
            folder,
            hall: opening.hall,
            domain_id: opening.domain_id,
            ros_args: opening.ros_args,
            state: Mutex::new(state),
            said,
            askable: Mutex::default(),
            replay: Mutex::default(),
            works: Mutex::default(),
            ids: AtomicU64::new(1),
        });
        let looking = Arc::clone(&workshop);
        workshop.work("workshop-shelf".to_owned(), move |interrupt| {
            for name in runs.iter().take_while(|_| !interrupt.is_raised()) {
                let shelved = match guarded(|| looking.folder.about(name)) {
                    Ok(about) => Shelved::Ready(Box::new(about)),
                    Err(error) => Shelved::Unusable { name: name.clone(), why: error.to_string() },
                };
                // It may have been deleted meanwhile.
                looking.change(|state| {
                    state
                        .runs
                        .iter_mut()
                        .filter(|run| run.name() == name)
                        .for_each(|run| *run = shelved.clone());
                });
            }
        })?;
        Ok(workshop)
    }

    /// What the page shows, as JSON; it changes whenever something does.
    #[must_use]
    pub fn said(&self) -> watch::Receiver<Arc<str>> {
        self.said.subscribe()
    }

    /// What the page shows.
    pub fn state(&self) -> MutexGuard<'_, State> {
        // Plain data, of which any mixture can be shown.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes what the page shows.
    fn change<T>(&self, how: impl FnOnce(&mut State) -> T) -> T {
        let mut state = self.state();
        let done = how(&mut state);
        // Within the lock, so that the last change is the last that is said.
        self.said.send_replace(json(&*state).into());
        done
    }

    /// Learns which dampers can be asked for something: names and namespaces.
    pub fn know(&self, askable: Vec<(String, String)>) {
        *self.askable.lock().unwrap_or_else(PoisonError::into_inner) = askable.into_iter().collect();
    }

    /// Looks for models that were put into the directory, or taken out.
    pub fn look_for_models(&self) {
        match models(&self.folder) {
            Ok(found) if self.state().models == found => {}
            Ok(found) => self.change(|state| state.models = found),
            Err(error) => tracing::warn!("{error}"),
        }
    }

    /// The report called `name`.
    ///
    /// # Errors
    /// When there is none.
    pub fn report(&self, name: &str) -> Result<Vec<u8>, Refusal> {
        self.folder.report(name)
    }

    /// Deletes the run called `name`.
    ///
    /// # Errors
    /// When there is none, it is being replayed or opened, or the file cannot be deleted.
    pub fn delete_run(&self, name: &str) -> Result<String, Refusal> {
        let mut state = self.state();
        match state.runs.iter().find(|run| run.name() == name) {
            None => return Err(Refusal::new(Kind::Missing, format!("there is no run called {name}"))),
            Some(Shelved::Opening { .. }) => {
                return Err(Refusal::new(Kind::Busy, format!("{name} is being opened; wait for that")));
            }
            Some(_) => {}
        }
        if state.replay.as_ref().is_some_and(|replay| replay.run == name && replay.state.is_under_way()) {
            return Err(Refusal::new(Kind::Busy, format!("{name} is being replayed; stop that first")));
        }
        self.folder.delete(name)?;
        state.runs.retain(|run| run.name() != name);
        self.said.send_replace(json(&*state).into());
        Ok(format!("{name} is deleted"))
    }

    /// A number that nothing else here has.
    fn next_id(&self) -> u64 {
        self.ids.fetch_add(1, Ordering::Relaxed)
    }

    /// Does something on a thread of its own, until it is done or the interrupt that it gets is raised.
    fn work(
        &self,
        name: String,
        work: impl FnOnce(&Interrupt) + Send + 'static,
    ) -> Result<Interrupt, NodeError> {
        let interrupt = Interrupt::manual();
        let (theirs, starting) = (interrupt.clone(), NodeError::io(format!("starting the thread {name}")));
        let thread =
            std::thread::Builder::new().name(name.clone()).spawn(move || work(&theirs)).map_err(starting)?;
        let mut works = self.works.lock().unwrap_or_else(PoisonError::into_inner);
        works.retain(|work| !work.thread.is_finished());
        works.push(Work { name, interrupt: interrupt.clone(), thread });
        Ok(interrupt)
    }

    /// Tells all work to end, and returns until when that is waited for.
    pub fn interrupt(&self) -> Instant {
        let works = self.works.lock().unwrap_or_else(PoisonError::into_inner);
        works.iter().for_each(|work| work.interrupt.raise());
        Instant::now() + END_WITHIN
    }

    /// Waits for all work to end, and says what did not by `deadline`: that ends with the process. Of uploads nothing is left in any
    /// case.
    pub fn close(&self, deadline: Instant) {
        let works = std::mem::take(&mut *self.works.lock().unwrap_or_else(PoisonError::into_inner));
        for Work { name, thread, .. } in works {
            while !thread.is_finished() && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(5));
            }
            match thread.is_finished().then(|| thread.join()) {
                Some(Ok(())) => {}
                Some(Err(_)) => tracing::error!(thread = name, "had panicked"),
                None => tracing::info!(thread = name, "did not end in time and is left"),
            }
        }
        self.folder.sweep();
    }
}

/// The models of the thesis, and those in the directory.
fn models(folder: &Folder) -> Result<Vec<String>, NodeError> {
    Ok(folder.models()?.into_iter().chain(preset::names()).collect())
}

/// What `work` comes to; a panic is a failure, so that nobody waits for its end for ever.
fn guarded<T>(work: impl FnOnce() -> Result<T, NodeError>) -> Result<T, NodeError> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        Err(NodeError::Failed("it panicked; the log says where. Please report it".to_owned()))
    })
}
