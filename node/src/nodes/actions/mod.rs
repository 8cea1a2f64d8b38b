//! The actions of the node: long-running work on its history, with feedback, cancellation and a result.
//!
//! ```text
//! goal ─→ [ros-actions] ─→ ActionWork::prepare: history, running model ─→ [a thread of the goal: the job] ─→ model file
//!              ↑ feedback: stage ────────────────────────────────────────┘
//!              └─ result
//! ```
//!
//! | action | does | work |
//! |---|---|---|
//! | `close_loop` | diagnoses the running model: finds and adds missing effects | `close_loop.rs` |
//! | `identify` | fits a model of a given kind to the history | `identify.rs` |
//! | `design` | designs the next run for the running model; it needs no history | `design.rs` |
//!
//! The estimating thread is not involved: a job has a copy of the history and its own thread. Each action works on one goal at a
//! time; other goals are rejected meanwhile.
//!
//! A result is kept until its client asks for it or the next goal has a result. When the service stops, a client that waits for a
//! result gets an error.

mod close_loop;
mod design;
mod error;
mod identify;
mod job_thread;

pub use error::ActionError;

use crate::estimation::control::Control;
use crate::ros2::answer_limit::{AnswerLimit, Shorten};
use crate::ros2::participant::{ActionServerOf, ExecutingOf, NewGoalOf, Ros, RosMessage};
use crate::settings::config::RosArgs;
use crate::settings::error::{NodeError, RequestError};
use crate::settings::task::Task;
use crate::streams::parameters::Parameters;
use crate::watchdogs::overseer::SharedHistory;
use futures::FutureExt;
use futures::future::{BoxFuture, FusedFuture, join3};
use job_thread::{JobMessage, JobThread};
use mr_damper_model::sample::Run;
use mr_damper_msgs::Action;
use mr_damper_runs::write_text;
use ros2_client::action::{CancelHandle, GoalEndStatus, GoalError};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, SystemTime};

/// Time to deliver a last result before its writer is dropped; otherwise the result would be lost.
const DELIVERY: Duration = Duration::from_millis(150);

/// The work on a goal. Its arguments are a flag that requests its end, and a function that reports its stages.
type Job<D> = Box<dyn FnOnce(&AtomicBool, &(dyn Fn(Step) + Sync)) -> Result<D, NodeError> + Send>;

/// The current stage, and the approximate progress.
#[derive(Debug, Clone, PartialEq)]
struct Step {
    stage: String,
    /// From 0 to 1.
    progress: f32,
}

/// The work of an action.
trait ActionWork: Send + Sync + 'static {
    /// Type of the action.
    type Action: Action<Goal: Sync, Result: Sync, Feedback: Sync>;
    /// Result of a job.
    type Done: Send + 'static;
    /// Name of the action.
    const NAME: &'static str;

    /// Prepares the job for `goal`.
    ///
    /// # Errors
    /// When the goal is rejected.
    fn prepare(&self, goal: &<Self::Action as Action>::Goal) -> Result<Job<Self::Done>, NodeError>;

    /// Converts a step to feedback.
    fn feedback(step: Step) -> <Self::Action as Action>::Feedback;

    /// Converts the result of the job to the action's result.
    fn result(worked: Result<Self::Done, &NodeError>) -> <Self::Action as Action>::Result;

    /// Shortens a result that is too long for a client on another host.
    const SHORTEN: Option<Shorten<<Self::Action as Action>::Result>> = None;
}

/// The data that the actions work on.
#[derive(Clone)]
struct ActionContext {
    control: Arc<Control>,
    history: SharedHistory,
    /// Name of the damper, which is part of file names because several nodes may write into one directory.
    damper: String,
}

impl ActionContext {
    /// The last `seconds` of raw input, oldest first.
    fn runs(&self, seconds: f64) -> Result<Vec<Run>, RequestError> {
        if !(seconds > 0.0 && seconds.is_finite()) {
            return Err(RequestError::History { seconds });
        }
        let gap_s = self.control.config().settings.gap_s;
        let history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(history.runs(seconds, gap_s))
    }

    /// The directory that model files are written to.
    fn folder(&self) -> PathBuf {
        match self.control.config().close_loop_out.as_str() {
            "" => std::env::temp_dir(),
            out => out.into(),
        }
    }
}

/// Total length of all runs, s.
fn total_s(runs: &[Run]) -> f64 {
    runs.iter().map(|run| run.duration().get()).sum()
}

/// Writes a model file under a new name, because the node may be using an existing file.
fn write_new(folder: &Path, damper: &str, what: &str, text: &str) -> Result<PathBuf, NodeError> {
    create(&new_path(folder, damper, what, "toml"), text)
}

/// A path that no other goal and no other damper has.
fn new_path(folder: &Path, damper: &str, what: &str, extension: &str) -> PathBuf {
    let now = chrono::DateTime::<chrono::Utc>::from(SystemTime::now()).format("%Y%m%dT%H%M%S%3fZ");
    folder.join(format!("mr-damper-{what}-{}-{now}.{extension}", damper.replace('/', "-")))
}

/// Writes a new model file and returns its absolute path, because the reader may have another working directory.
fn create(path: &Path, text: &str) -> Result<PathBuf, NodeError> {
    let path = std::path::absolute(path).map_err(NodeError::io("finding the current directory"))?;
    if path.symlink_metadata().is_ok() {
        return Err(RequestError::FileExists { path: path.display().to_string() }.into());
    }
    write_text(&path, text)?;
    Ok(path)
}

/// The action servers before they start to answer, so that more entities can be created on the node.
pub struct Actions {
    close_loop: GoalServer<close_loop::CloseLoopWork>,
    design: GoalServer<design::DesignWork>,
    identify: GoalServer<identify::IdentifyWork>,
}

impl Actions {
    /// Creates the action servers.
    ///
    /// # Errors
    /// When DDS cannot create a server.
    pub fn offer(
        ros: &mut Ros,
        args: &RosArgs,
        control: &Arc<Control>,
        parameters: &Arc<Parameters>,
        history: SharedHistory,
    ) -> Result<Self, NodeError> {
        let damper = args.damper().to_owned();
        let context = ActionContext { control: Arc::clone(control), history, damper };
        let close_loop = close_loop::CloseLoopWork::new(context.clone(), Arc::clone(parameters));
        Ok(Self {
            close_loop: GoalServer::offer(ros, args, close_loop)?,
            design: GoalServer::offer(ros, args, design::DesignWork::new(context.clone()))?,
            identify: GoalServer::offer(ros, args, identify::IdentifyWork::new(context))?,
        })
    }

    /// Starts to answer goals. When the returned task ends, all work has ended.
    ///
    /// # Errors
    /// When the thread cannot be started.
    pub fn start(self) -> Result<Task, NodeError> {
        let Self { close_loop, design, identify } = self;
        Task::start("ros-actions", |stopped| {
            let stopped = stopped.shared();
            let runs = (close_loop.run(stopped.clone()), design.run(stopped.clone()), identify.run(stopped));
            join3(runs.0, runs.1, runs.2).map(drop)
        })
    }
}

/// The running goal.
struct RunningGoal<W: ActionWork> {
    goal: ExecutingOf<W::Action>,
    job: JobThread<W::Done>,
}

/// A result that is kept until its client asks for it.
struct PendingResult<'a, W: ActionWork> {
    goal: ExecutingOf<W::Action>,
    sending: BoxFuture<'a, ()>,
}

/// The server of one action: receives goals and returns results.
struct GoalServer<W: ActionWork> {
    server: ActionServerOf<W::Action>,
    /// The action's full name.
    name: String,
    limit: AnswerLimit,
    work: W,
}

impl<W: ActionWork> GoalServer<W> {
    fn offer(ros: &mut Ros, args: &RosArgs, work: W) -> Result<Self, NodeError> {
        let name = args.service(W::NAME);
        Ok(Self {
            server: ros.serve_action::<W::Action>(&name)?,
            name,
            limit: ros.domain().answer_limit(),
            work,
        })
    }

    async fn run(self, mut stopped: impl FusedFuture + Unpin + Send) {
        let mut running: Option<RunningGoal<W>> = None;
        let mut pending: Option<PendingResult<'_, W>> = None;
        loop {
            tokio::select! {
                _ = &mut stopped => break,
                goal = self.server.receive_new_goal() => match goal {
                    Ok(goal) => {
                        let begun = self.start_goal(goal, running.is_some()).await;
                        running = begun.or(running);
                    }
                    Err(error) => tracing::warn!(%error, "cannot read a goal of {}", W::NAME),
                },
                request = self.server.receive_cancel_request() => match request {
                    Ok(request) => self.cancel(&request, running.as_ref()).await,
                    Err(error) => tracing::warn!(%error, "cannot read a cancellation of {}", W::NAME),
                },
                message = next(&mut running) => match message {
                    JobMessage::Step(step) => self.send_feedback(running.as_ref(), step).await,
                    JobMessage::Ended(worked) => {
                        if let Some(RunningGoal { goal, job }) = running.take() {
                            // The job has ended, so this does not block.
                            job.end();
                            self.drop_unclaimed(pending.take()).await;
                            pending = Some(self.pending_result(goal, worked));
                        }
                    }
                },
                () = sent(&mut pending) => pending = None,
            }
        }
        if let Some(RunningGoal { goal, job }) = running {
            job.end();
            let stopped = ActionError::Stopped.into();
            // A client that waits for the result has asked by now; do not wait for others.
            if self.pending_result(goal, Err(stopped)).sending.now_or_never().is_some() {
                std::thread::sleep(DELIVERY);
            }
        }
    }

    /// Accepts the goal and starts the work on it, or rejects it.
    async fn start_goal(&self, goal: NewGoalOf<W::Action>, busy: bool) -> Option<RunningGoal<W>> {
        let RosMessage(requested) = self.server.get_new_goal(goal.clone())?;
        let begun = if busy {
            Err(RequestError::Busy.into())
        } else {
            self.work.prepare(&requested).and_then(|job| JobThread::start(W::NAME, job))
        };
        let job = match begun {
            Ok(job) => job,
            Err(why) => {
                tracing::warn!("{}: goal rejected: {why}", W::NAME);
                if let Err(error) = self.server.reject_goal(goal).await {
                    tracing::warn!(
                        error = in_words(&error),
                        "cannot send the rejection of a goal of {}",
                        W::NAME
                    );
                }
                return None;
            }
        };
        let executing = match self.server.accept_goal(goal).await {
            Ok(accepted) => self.server.start_executing_goal(accepted).await,
            Err(error) => Err(error),
        };
        match executing {
            Ok(goal) => Some(RunningGoal { goal, job }),
            Err(error) => {
                tracing::error!(error = in_words(&error), "{}: cannot accept a goal", W::NAME);
                job.end();
                None
            }
        }
    }

    /// Cancels the running goal, if `request` contains it. Unknown goals and goals that have ended are ignored.
    async fn cancel(&self, request: &CancelHandle, running: Option<&RunningGoal<W>>) {
        let target = running.filter(|running| request.contains_goal(&running.goal.goal_id()));
        if let Some(running) = target {
            running.job.cancel();
        }
        let cancelled = target.map(|running| running.goal.goal_id());
        if let Err(error) = self.server.respond_to_cancel_requests(request, cancelled.into_iter()).await {
            tracing::warn!(%error, "cannot send the answer to a cancellation of {}", W::NAME);
        }
    }

    async fn send_feedback(&self, running: Option<&RunningGoal<W>>, step: Step) {
        // A goal that is being cancelled gets no feedback.
        let Some(running) = running.filter(|running| !running.job.is_cancelled()) else { return };
        let published = self.server.publish_feedback(running.goal.clone(), RosMessage(W::feedback(step)));
        if let Err(error) = published.await {
            tracing::warn!(error = in_words(&error), "cannot publish feedback of {}", W::NAME);
        }
    }

    fn pending_result(
        &self,
        goal: ExecutingOf<W::Action>,
        worked: Result<W::Done, NodeError>,
    ) -> PendingResult<'_, W> {
        let status = match &worked {
            Ok(_) => GoalEndStatus::Succeeded,
            Err(NodeError::Interrupted) => GoalEndStatus::Canceled,
            Err(_) => GoalEndStatus::Aborted,
        };
        let result = match worked {
            Ok(done) => W::result(Ok(done)),
            Err(error) => W::result(Err(&error)),
        };
        let service = format!("{}/_action/get_result", self.name);
        let result = self.limit.fit_all(&service, result, W::SHORTEN);
        let sending = self.server.send_result_response(goal.clone(), status, RosMessage(result));
        let sending = Box::pin(async move {
            if let Err(error) = sending.await {
                tracing::warn!(error = in_words(&error), "cannot send the result of {}", W::NAME);
            }
        });
        PendingResult { goal, sending }
    }

    /// Drops a result that no client has asked for before the next one.
    async fn drop_unclaimed(&self, pending: Option<PendingResult<'_, W>>) {
        let Some(PendingResult { goal, sending }) = pending else { return };
        drop(sending);
        tracing::warn!("no client asked for the result of a goal of {}; it is dropped", W::NAME);
        if let Err(error) = self.server.abort_executing_goal(goal).await {
            // The goal stays on the status topic as being cancelled, because ros2-client cannot remove it.
            tracing::debug!(error = in_words(&error), "the goal had been cancelled");
        }
    }
}

/// A fault of the action server in words, for the log.
fn in_words<T>(error: &GoalError<T>) -> String {
    match error {
        GoalError::NoSuchGoal => "the goal is not known".to_owned(),
        GoalError::WrongGoalState => "the goal is in another state".to_owned(),
        GoalError::DDSReadError(error) => error.to_string(),
        GoalError::DDSWriteError(error) => error.to_string(),
    }
}

/// The next message of the running job; without a job it waits forever.
async fn next<W: ActionWork>(running: &mut Option<RunningGoal<W>>) -> JobMessage<W::Done> {
    match running {
        Some(running) => running.job.next().await,
        None => std::future::pending().await,
    }
}

/// Waits until the kept result is sent; without one it waits forever.
async fn sent<W: ActionWork>(pending: &mut Option<PendingResult<'_, W>>) {
    match pending {
        Some(pending) => pending.sending.as_mut().await,
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// A model file that is seen in part may be read as another model.
    #[test]
    fn a_model_file_appears_whole_and_replaces_none() {
        let dir = tempfile::tempdir().expect("a directory");
        let path = dir.path().join("model.toml");
        let text = "a = 1\n".repeat(4_000_000);
        let lengths: Vec<u64> = std::thread::scope(|scope| {
            let writing = scope.spawn(|| create(&path, &text).expect("written"));
            let mut seen = Vec::new();
            while !writing.is_finished() {
                seen.extend(path.metadata().map(|there| there.len()));
            }
            seen
        });
        assert!(lengths.iter().all(|length| *length == text.len() as u64), "{:?}", lengths.first());
        let refused = create(&path, "a = 2\n").expect_err("the name is taken").to_string();
        assert!(refused.contains("exists already and is not overwritten"), "{refused}");
        assert_eq!(std::fs::read_dir(dir.path()).expect("there").count(), 1);
    }

    /// Runs in a child process of the test below, on a file system with room for one page.
    #[test]
    fn writer_on_a_full_disk() {
        let Some(disk) = std::env::var_os("ACTIONS_DISK") else { return };
        let path = Path::new(&disk).join("model.toml");
        let error = create(&path, &"a = 1\n".repeat(10_000)).expect_err("there is no room").to_string();
        assert!(error.contains("model.toml") && error.contains("make room on that disk"), "{error}");
        assert!(!path.exists(), "the incomplete file is removed");
        create(&path, "a = 1\n").expect("there is room, and the name is free");
    }

    #[test]
    #[ignore = "needs root: mounts a small disk"]
    fn an_incomplete_model_file_on_a_full_disk_is_removed() {
        let disk = tempfile::tempdir().expect("a directory");
        let script = "mount -t tmpfs -o size=8k none \"$ACTIONS_DISK\" || exit 77
            exec \"$0\" --exact actions::tests::writer_on_a_full_disk";
        let me = std::env::current_exe().expect("this program");
        let mut command = Command::new("unshare");
        command.args(["--mount", "--propagation", "private", "sh", "-c", script]).arg(me);
        let ended = command.env("ACTIONS_DISK", disk.path()).output();
        let ended = ended.expect("unshare (util-linux) starts");
        assert!(ended.status.success(), "{ended:?}");
    }
}
