//! The thread of a goal: what it says on its way, and that it ends with a last word whatever happens.

use super::{Job, Step};
use crate::error::NodeError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tracing::Span;

/// What the thread says.
#[derive(Debug)]
pub(super) enum Said<D> {
    /// A stage begins.
    Step(Step),
    /// Its last word.
    Ended(Result<D, NodeError>),
}

/// Work on a goal, on a thread of its own.
pub(super) struct Working<D> {
    cancelled: Arc<AtomicBool>,
    said: UnboundedReceiver<Said<D>>,
    thread: JoinHandle<()>,
}

impl<D: Send + 'static> Working<D> {
    /// Starts `job` on a thread called `name`.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub(super) fn start(name: &str, job: Job<D>) -> Result<Self, NodeError> {
        let cancelled = Arc::new(AtomicBool::new(false));
        let (says, said) = unbounded_channel();
        let body = {
            let (cancelled, span) = (Arc::clone(&cancelled), Span::current());
            move || {
                let _inside = span.entered();
                // Whoever does not listen any more has told the job to end.
                let worked = job(&cancelled, &|step| drop(says.send(Said::Step(step))));
                drop(says.send(Said::Ended(worked)));
            }
        };
        let thread = std::thread::Builder::new()
            .name(name.replace('_', "-"))
            .spawn(body)
            .map_err(NodeError::io(format!("starting the thread of a goal of {name}")))?;
        Ok(Self { cancelled, said, thread })
    }

    /// The next thing that it says. A job that panics says nothing more, which is an end as well.
    pub(super) async fn next(&mut self) -> Said<D> {
        self.said.recv().await.unwrap_or_else(|| {
            let died = "the work died; the node's log says why. Please report it";
            Said::Ended(Err(NodeError::Failed(died.to_owned())))
        })
    }

    /// Tells it to end.
    pub(super) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
    }

    /// True once it was told to end.
    pub(super) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Acquire)
    }

    /// Tells it to end, and waits until it has.
    pub(super) fn end(self) {
        self.cancel();
        // A panic was said as one.
        let _ = self.thread.join();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures::executor::block_on;

    fn last_word(mut working: Working<String>) -> Result<String, NodeError> {
        loop {
            if let Said::Ended(ended) = block_on(working.next()) {
                working.end();
                return ended;
            }
        }
    }

    #[test]
    fn work_that_panics_ends_as_one_that_failed() {
        let working = Working::start(
            "test",
            Box::new(|_, say| {
                say(Step { stage: "begin".to_owned(), progress: 0.0 });
                panic!("on purpose");
            }),
        );
        let error = last_word(working.expect("a thread")).expect_err("a failure").to_string();
        assert!(error.contains("the work died"), "{error}");
    }

    #[test]
    fn what_is_told_to_end_is_interrupted_and_what_is_not_has_its_result() {
        let task: Job<String> = Box::new(|cancelled, _| {
            while !cancelled.load(Ordering::Acquire) {
                std::thread::yield_now();
            }
            Err(NodeError::Interrupted)
        });
        let working = Working::start("test", task).expect("a thread");
        assert!(!working.is_cancelled());
        working.cancel();
        assert!(matches!(last_word(working), Err(NodeError::Interrupted)));
        let ended =
            last_word(Working::start("test", Box::new(|_, _| Ok("{}".to_owned()))).expect("a thread"));
        assert_eq!(ended.expect("a result"), "{}");
    }
}
