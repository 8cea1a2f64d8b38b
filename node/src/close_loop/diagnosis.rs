//! The diagnosing thread: what it says on its way, and that it ends with a report whatever happens.

use super::work::error_json;
use crate::error::NodeError;
use mr_damper_model::diagnose::Stage;
use ros2_client::action::GoalEndStatus;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};

/// What the diagnosing thread says.
#[derive(Debug)]
pub(super) enum Said {
    /// A stage begins.
    Stage(Stage),
    /// Its last word.
    Ended(Ended),
}

/// How a goal ended.
#[derive(Debug)]
pub(super) struct Ended {
    pub(super) status: GoalEndStatus,
    /// JSON.
    pub(super) report: String,
}

impl Ended {
    /// The end of a goal by what its work came to.
    pub(super) fn by(worked: Result<String, NodeError>) -> Self {
        match worked {
            Ok(report) => Self { status: GoalEndStatus::Succeeded, report },
            Err(error) => {
                let status = match error {
                    NodeError::Interrupted => GoalEndStatus::Canceled,
                    _ => GoalEndStatus::Aborted,
                };
                Self { status, report: error_json(&error) }
            }
        }
    }
}

/// A diagnosis that runs on a thread of its own.
pub(super) struct Diagnosis {
    cancelled: Arc<AtomicBool>,
    said: UnboundedReceiver<Said>,
    thread: JoinHandle<()>,
}

impl Diagnosis {
    /// Starts `task`, which gets a flag that tells it to end, and says its stages; what it returns is the report.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub(super) fn start(
        task: impl FnOnce(&AtomicBool, &dyn Fn(Stage)) -> Result<String, NodeError> + Send + 'static,
    ) -> Result<Self, NodeError> {
        let cancelled = Arc::new(AtomicBool::new(false));
        let (says, said) = unbounded_channel();
        let body = {
            let cancelled = Arc::clone(&cancelled);
            move || {
                // Whoever does not listen any more has told the task to end.
                let worked = task(&cancelled, &|stage| drop(says.send(Said::Stage(stage))));
                drop(says.send(Said::Ended(Ended::by(worked))));
            }
        };
        let thread = std::thread::Builder::new()
            .name("close-loop".to_owned())
            .spawn(body)
            .map_err(NodeError::io("starting the thread of a diagnosis"))?;
        Ok(Self { cancelled, said, thread })
    }

    /// The next thing that it says. A task that panics says nothing more, which is an end as well.
    pub(super) async fn next(&mut self) -> Said {
        self.said.recv().await.unwrap_or_else(|| {
            let died = "the diagnosis died; the node's log says why. Please report it";
            Said::Ended(Ended::by(Err(NodeError::Failed(died.to_owned()))))
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

    fn last_word(mut diagnosis: Diagnosis) -> Ended {
        loop {
            if let Said::Ended(ended) = block_on(diagnosis.next()) {
                diagnosis.end();
                return ended;
            }
        }
    }

    #[test]
    fn a_diagnosis_that_panics_ends_as_one_that_failed() {
        let diagnosis = Diagnosis::start(|_, say| {
            say(Stage::Base);
            panic!("on purpose");
        });
        let ended = last_word(diagnosis.expect("a thread"));
        assert_eq!(ended.status, GoalEndStatus::Aborted);
        assert!(ended.report.contains("the diagnosis died"), "{}", ended.report);
    }

    #[test]
    fn one_that_is_told_to_end_is_cancelled_and_one_that_is_not_has_its_report() {
        let task = |cancelled: &AtomicBool, _: &dyn Fn(Stage)| {
            while !cancelled.load(Ordering::Acquire) {
                std::thread::yield_now();
            }
            Err(NodeError::Interrupted)
        };
        let diagnosis = Diagnosis::start(task).expect("a thread");
        assert!(!diagnosis.is_cancelled());
        diagnosis.cancel();
        assert_eq!(last_word(diagnosis).status, GoalEndStatus::Canceled);

        let ended = last_word(Diagnosis::start(|_, _| Ok("{}".to_owned())).expect("a thread"));
        assert_eq!((ended.status, ended.report.as_str()), (GoalEndStatus::Succeeded, "{}"));
    }
}
