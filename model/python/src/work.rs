//! Work without Python's global lock, which Ctrl-C ends.

use crate::error::exception;
use mr_damper_node::NodeError;
use mr_damper_node::commands::context::{CliContext, ProgressSink};
use mr_damper_node::settings::config::RosArgs;
use mr_damper_node::settings::interrupt::Interrupt;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::fmt::Debug;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};

/// How often Python handles signals and receives progress while the work runs.
const POLL: Duration = Duration::from_millis(50);
/// Stack of a working thread, bytes: as much as a main thread has on Linux.
const STACK: usize = 8 << 20;

/// The newest progress: stage, steps done, and their total number.
type Latest = Arc<Mutex<Option<(String, u64, u64)>>>;

/// Runs `work` on its own thread. Meanwhile other Python threads run, signals are handled every 50 ms, and `progress` (if it is given) is
/// called with the newest stage, steps and total. An exception of a signal handler or of `progress` ends the work and is raised.
/// Warnings of the work become Python warnings.
///
/// # Errors
/// The exception for the error of `work`; the exception of a signal handler or of `progress`.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&CliContext) -> Result<T, NodeError> + Send,
) -> PyResult<T> {
    let interrupt = Interrupt::manual();
    let latest = Latest::default();
    let context = CliContext {
        interrupt: interrupt.clone(),
        quiet: true,
        ros_args: RosArgs::default(),
        progress: progress.is_some().then(|| sink(&latest)),
    };
    let done = (Mutex::new(false), Condvar::new());
    let warnings = Warnings::default();
    let (result, stopped) = std::thread::scope(|scope| -> PyResult<_> {
        let job = || {
            let _ended = Ended(&done);
            tracing::subscriber::with_default(warnings.clone(), || work(&context))
        };
        let thread = std::thread::Builder::new().name("mr-damper".to_owned()).stack_size(STACK);
        let thread = thread.spawn_scoped(scope, job).map_err(|error| {
            PyRuntimeError::new_err(format!("the system cannot start a thread: {error}; end other work"))
        })?;
        let mut stopped = None;
        while !py.detach(|| wait(&done)) {
            if stopped.is_none()
                && let Err(raised) = py.check_signals().and_then(|()| report(progress, &latest))
            {
                interrupt.raise();
                stopped = Some(raised);
            }
        }
        Ok((py.detach(|| thread.join()), stopped))
    })?;
    if let Some(raised) = stopped {
        return Err(raised);
    }
    let result = result.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    report(progress, &latest)?;
    warnings.raise(py)?;
    result.map_err(|error| exception(py, &error))
}

/// Notes the end of the work, also after a panic.
struct Ended<'a>(&'a (Mutex<bool>, Condvar));

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.1.notify_all();
    }
}

/// Waits for the end of the work; false after [`POLL`].
fn wait((ended, changed): &(Mutex<bool>, Condvar)) -> bool {
    let ended = ended.lock().unwrap_or_else(PoisonError::into_inner);
    let waited = changed.wait_timeout_while(ended, POLL, |ended| !*ended);
    *waited.unwrap_or_else(PoisonError::into_inner).0
}

/// Keeps the newest progress in `latest`.
fn sink(latest: &Latest) -> ProgressSink {
    let latest = Arc::clone(latest);
    Arc::new(move |stage, done, of| {
        *latest.lock().unwrap_or_else(PoisonError::into_inner) = Some((stage.to_owned(), done, of));
    })
}

/// Calls `progress` with the newest progress, if there is any since the last call.
fn report(progress: Option<&Bound<'_, PyAny>>, latest: &Latest) -> PyResult<()> {
    let Some(progress) = progress else { return Ok(()) };
    let newest = latest.lock().unwrap_or_else(PoisonError::into_inner).take();
    newest.map_or(Ok(()), |(stage, done, of)| progress.call1((stage, done, of)).map(|_| ()))
}

/// Collects the warnings that the work logs.
#[derive(Debug, Clone, Default)]
struct Warnings(Arc<Mutex<Vec<String>>>);

impl Warnings {
    /// Issues the warnings in Python.
    fn raise(&self, py: Python<'_>) -> PyResult<()> {
        let texts = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        if texts.is_empty() {
            return Ok(());
        }
        let warn = py.import("mr_damper._errors")?.getattr("warn")?;
        texts.into_iter().try_for_each(|text| warn.call1((text,)).map(|_| ()))
    }
}

impl Subscriber for Warnings {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() <= Level::WARN
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut line = Line::default();
        event.record(&mut line);
        let text = match line.run {
            Some(run) => format!("{run}: {}", line.message),
            None => line.message,
        };
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

/// The message of a log line, and its field `run`.
#[derive(Default)]
struct Line {
    run: Option<String>,
    message: String,
}

impl Visit for Line {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        match field.name() {
            "message" => self.message = format!("{value:?}"),
            "run" => self.run = Some(format!("{value:?}")),
            _ => {}
        }
    }
}
