//! An async task on a thread of its own.

use crate::settings::error::NodeError;
use futures::channel::oneshot;
use std::thread::JoinHandle;
use tracing::Span;

/// An async task on its own thread, with a stop signal.
pub struct Task {
    stop: oneshot::Sender<()>,
    thread: JoinHandle<()>,
}

impl Task {
    /// Starts the task on a thread called `name`. `task` gets the stop signal.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn start<F>(
        name: &'static str,
        task: impl FnOnce(oneshot::Receiver<()>) -> F,
    ) -> Result<Self, NodeError>
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let (stop, stopped) = oneshot::channel();
        Ok(Self { stop, thread: run_async(name, task(stopped))? })
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Signals the task to end, and waits for it. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        // The receiver is gone if the thread has panicked.
        let _ = self.stop.send(());
        self.thread.join()
    }
}

/// Runs `task` to its end on a new thread called `name`.
///
/// # Errors
/// When the system cannot start the thread.
fn run_async(
    name: &'static str,
    task: impl Future<Output = ()> + Send + 'static,
) -> Result<JoinHandle<()>, NodeError> {
    let starting = format!("starting the thread {name}");
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .build()
        .map_err(NodeError::io(starting.as_str()))?;
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn({
            let span = Span::current();
            move || {
                // Log lines of the thread carry its damper's name.
                let _inside = span.entered();
                runtime.block_on(task);
            }
        })
        .map_err(NodeError::io(starting.as_str()))
}
