//! The thread of a goal: reports stages, and always reports its end, even after a panic.

use super::{ActionError, Job, Step};
use crate::settings::error::NodeError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tracing::Span;

/// A message of the thread.
#[derive(Debug)]
pub(super) enum JobMessage<D> {
    /// A stage begins.
    Step(Step),
    /// The work has ended; this is the last message.
    Ended(Result<D, NodeError>),
}

/// Work on a goal, on a separate thread.
pub(super) struct JobThread<D> {
    cancelled: Arc<AtomicBool>,
    messages: UnboundedReceiver<JobMessage<D>>,
    thread: JoinHandle<()>,
}

impl<D: Send + 'static> JobThread<D> {
    /// Starts `job` on a thread named after the action `name`.
    ///
    /// # Errors
    /// When the thread cannot be started.
    pub(super) fn start(name: &str, job: Job<D>) -> Result<Self, NodeError> {
        let cancelled = Arc::new(AtomicBool::new(false));
        let (sender, messages) = unbounded_channel();
        let body = {
            let (cancelled, span) = (Arc::clone(&cancelled), Span::current());
            move || {
                let _inside = span.entered();
                // Sending fails only after the receiver has cancelled the job.
                let worked = job(&cancelled, &|step| drop(sender.send(JobMessage::Step(step))));
                drop(sender.send(JobMessage::Ended(worked)));
            }
        };
        let thread = std::thread::Builder::new()
            .name(name.replace('_', "-"))
            .spawn(body)
            .map_err(NodeError::io(format!("starting the thread of a goal of {name}")))?;
        Ok(Self { cancelled, messages, thread })
    }

    /// The next message of the thread. A job that panics sends no further message, which is reported as its end.
    pub(super) async fn next(&mut self) -> JobMessage<D> {
        self.messages.recv().await.unwrap_or_else(|| JobMessage::Ended(Err(ActionError::Panicked.into())))
    }

    /// Requests the job to end.
    pub(super) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
    }

    /// True after [`JobThread::cancel`].
    pub(super) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Acquire)
    }

    /// Requests the job to end, and waits until it has ended.
    pub(super) fn end(self) {
        self.cancel();
        // A panic was already reported.
        let _ = self.thread.join();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures::executor::block_on;

    fn end_of(mut job: JobThread<String>) -> Result<String, NodeError> {
        loop {
            if let JobMessage::Ended(ended) = block_on(job.next()) {
                job.end();
                return ended;
            }
        }
    }

    #[test]
    fn a_job_that_panics_ends_with_a_failure() {
        let job = JobThread::start(
            "test",
            Box::new(|_, say| {
                say(Step { stage: "begin".to_owned(), progress: 0.0 });
                panic!("on purpose");
            }),
        );
        let error = end_of(job.expect("a thread")).expect_err("a failure");
        assert!(matches!(error.part(), Some(ActionError::Panicked)), "{error}");
    }

    #[test]
    fn a_cancelled_job_is_interrupted_and_another_one_returns_its_result() {
        let task: Job<String> = Box::new(|cancelled, _| {
            while !cancelled.load(Ordering::Acquire) {
                std::thread::yield_now();
            }
            Err(NodeError::Interrupted)
        });
        let job = JobThread::start("test", task).expect("a thread");
        assert!(!job.is_cancelled());
        job.cancel();
        assert!(matches!(end_of(job), Err(NodeError::Interrupted)));
        let ended = end_of(JobThread::start("test", Box::new(|_, _| Ok("{}".to_owned()))).expect("a thread"));
        assert_eq!(ended.expect("a result"), "{}");
    }
}
