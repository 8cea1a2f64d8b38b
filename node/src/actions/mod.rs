//! The actions of the node: long work on what it remembers, with feedback, cancelling and a result.
//!
//! ```text
//! goal ─→ [ros-actions] ─→ Work::consider: history, running model ─→ [a thread of the goal: the job] ─→ model file
//!              ↑ feedback: stage ─────────────────────────────────────────┘
//!              └─ result
//! ```
//!
//! | action | names | work |
//! |---|---|---|
//! | `close_loop` | what the running model lacks | `close_loop.rs` |
//! | `identify` | a model of some kind that fits the history | `identify.rs` |
//!
//! The estimating thread knows nothing of it: a job has a copy of the history and a thread of its own. One goal at
//! a time of each action: another one is rejected meanwhile.
//!
//! A result waits for its client to ask, until the next goal has one. When the service stops, who waits for a result is
//! told so.

mod close_loop;
mod identify;
mod working;

use crate::config::RosArgs;
use crate::control::Control;
use crate::error::NodeError;
use crate::far::{Far, Shorten};
use crate::overseer::SharedHistory;
use crate::parameters::Parameters;
use crate::ros::{ActionServerOf, ExecutingOf, NewGoalOf, Part, Ros, Task};
use futures::FutureExt;
use futures::future::{BoxFuture, FusedFuture, join};
use mr_damper_model::sample::Run;
use mr_damper_msgs::Action;
use ros2_client::action::{CancelHandle, GoalEndStatus};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, SystemTime};
use working::{Said, Working};

/// What a last result takes to arrive: it is lost when its writer goes together with it.
const DELIVERY: Duration = Duration::from_millis(150);

/// The work on a goal: gets a flag that tells it to end, and says its stages.
type Job<D> = Box<dyn FnOnce(&AtomicBool, &(dyn Fn(Step) + Sync)) -> Result<D, NodeError> + Send>;

/// What is being done now, and about how much is behind.
#[derive(Debug, Clone, PartialEq)]
struct Step {
    stage: String,
    /// From 0 to 1.
    progress: f32,
}

/// What an action does.
trait Work: Send + Sync + 'static {
    /// Its type.
    type Action: Action<Goal: Sync, Result: Sync, Feedback: Sync>;
    /// What a goal comes to.
    type Done: Send + 'static;
    /// Its name.
    const NAME: &'static str;

    /// Takes what the work on `goal` needs, or says why there will be none.
    fn consider(&self, goal: &<Self::Action as Action>::Goal) -> Result<Job<Self::Done>, String>;

    /// A step as feedback.
    fn feedback(step: Step) -> <Self::Action as Action>::Feedback;

    /// The result.
    fn result(worked: Result<Self::Done, &NodeError>) -> <Self::Action as Action>::Result;

    /// What makes a result fit that is too long over a network address.
    const SHORTEN: Option<Shorten<<Self::Action as Action>::Result>> = None;
}

/// What all work is done on.
#[derive(Clone)]
struct Remembered {
    control: Arc<Control>,
    history: SharedHistory,
    /// Name of the damper, for names of files: several nodes may write into one directory.
    damper: String,
}

impl Remembered {
    /// The last seconds of raw input, oldest first.
    fn runs(&self, seconds: f64) -> Result<Vec<Run>, String> {
        if !(seconds > 0.0 && seconds.is_finite()) {
            return Err("history must be a positive number of seconds".to_owned());
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

/// Length of all runs together, s.
fn total_s(runs: &[Run]) -> f64 {
    runs.iter().map(|run| run.duration().get()).sum()
}

/// Writes a model file under a name of its own; a file that is there may be the one that runs.
fn write_new(folder: &Path, damper: &str, what: &str, text: &str) -> Result<PathBuf, NodeError> {
    let now = chrono::DateTime::<chrono::Utc>::from(SystemTime::now()).format("%Y%m%dT%H%M%S%3fZ");
    let name = format!("mr-damper-{what}-{}-{now}.toml", damper.replace('/', "-"));
    create(&folder.join(name), text)
}

/// Writes a model file where there is none yet, and returns its absolute path: whoever reads of it may be anywhere.
fn create(path: &Path, text: &str) -> Result<PathBuf, NodeError> {
    let path = std::path::absolute(path).map_err(NodeError::io("finding the current directory"))?;
    let writing = || NodeError::io(format!("writing {}", path.display()));
    let mut file = OpenOptions::new().write(true).create_new(true).open(&path).map_err(writing())?;
    file.write_all(text.as_bytes()).map_err(|error| {
        // Half a model may read as a whole one. The first error counts.
        let _ = std::fs::remove_file(&path);
        writing()(error)
    })?;
    Ok(path)
}

/// The actions, offered; nothing works yet, so that more can be created on the node.
pub struct Actions {
    close_loop: Desk<close_loop::CloseLoopWork>,
    identify: Desk<identify::IdentifyWork>,
}

impl Actions {
    /// Offers the actions.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn offer(
        ros: &mut Ros,
        args: &RosArgs,
        control: &Arc<Control>,
        parameters: &Arc<Parameters>,
        history: SharedHistory,
    ) -> Result<Self, NodeError> {
        let damper = args.damper().to_owned();
        let remembered = Remembered { control: Arc::clone(control), history, damper };
        let close_loop = close_loop::CloseLoopWork::new(remembered.clone(), Arc::clone(parameters));
        Ok(Self {
            close_loop: Desk::offer(ros, args, close_loop)?,
            identify: Desk::offer(ros, args, identify::IdentifyWork::new(remembered))?,
        })
    }

    /// Starts to answer. The end of the task is that of all work.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub fn start(self) -> Result<Task, NodeError> {
        let Self { close_loop, identify } = self;
        Task::start("ros-actions", |stopped| {
            let stopped = stopped.shared();
            join(close_loop.run(stopped.clone()), identify.run(stopped)).map(drop)
        })
    }
}

/// The goal that is worked on.
struct Running<W: Work> {
    goal: ExecutingOf<W::Action>,
    working: Working<W::Done>,
}

/// A result that waits until its client asks for it.
struct Answer<'a, W: Work> {
    goal: ExecutingOf<W::Action>,
    sending: BoxFuture<'a, ()>,
}

/// Where goals come in and results go out.
struct Desk<W: Work> {
    server: ActionServerOf<W::Action>,
    /// The action's full name.
    name: String,
    far: Far,
    work: W,
}

impl<W: Work> Desk<W> {
    fn offer(ros: &mut Ros, args: &RosArgs, work: W) -> Result<Self, NodeError> {
        let name = args.service(W::NAME);
        Ok(Self { server: ros.serve_action::<W::Action>(&name)?, name, far: ros.domain().far(), work })
    }

    async fn run(self, mut stopped: impl FusedFuture + Unpin + Send) {
        let mut running: Option<Running<W>> = None;
        let mut answer: Option<Answer<'_, W>> = None;
        loop {
            tokio::select! {
                _ = &mut stopped => break,
                goal = self.server.receive_new_goal() => match goal {
                    Ok(goal) => {
                        let begun = self.consider(goal, running.is_some()).await;
                        running = begun.or(running);
                    }
                    Err(error) => tracing::warn!(?error, "a goal of {} cannot be read", W::NAME),
                },
                request = self.server.receive_cancel_request() => match request {
                    Ok(request) => self.cancel(&request, running.as_ref()).await,
                    Err(error) => tracing::warn!(?error, "a cancellation of {} cannot be read", W::NAME),
                },
                said = next(&mut running) => match said {
                    Said::Step(step) => self.tell(running.as_ref(), step).await,
                    Said::Ended(worked) => {
                        if let Some(Running { goal, working }) = running.take() {
                            // It has said its last word, so this takes no time.
                            working.end();
                            self.forget(answer.take()).await;
                            answer = Some(self.answer(goal, worked));
                        }
                    }
                },
                () = sent(&mut answer) => answer = None,
            }
        }
        if let Some(Running { goal, working }) = running {
            working.end();
            let stopped = NodeError::Failed("the node was stopped while it worked on this goal".to_owned());
            // Whoever waits has asked by now; nobody is waited for.
            if self.answer(goal, Err(stopped)).sending.now_or_never().is_some() {
                std::thread::sleep(DELIVERY);
            }
        }
    }

    /// Begins to work on the goal and accepts it, or rejects it.
    async fn consider(&self, goal: NewGoalOf<W::Action>, busy: bool) -> Option<Running<W>> {
        let Part(wanted) = self.server.get_new_goal(goal.clone())?;
        let begun = if busy {
            Err("another goal is worked on; cancel it, or wait for its result".to_owned())
        } else {
            self.work
                .consider(&wanted)
                .and_then(|job| Working::start(W::NAME, job).map_err(|error| error.to_string()))
        };
        let working = match begun {
            Ok(working) => working,
            Err(why) => {
                tracing::warn!(goal = ?wanted, "{}: goal rejected: {why}", W::NAME);
                if let Err(error) = self.server.reject_goal(goal).await {
                    tracing::warn!(?error, "the rejection of a goal of {} was not sent", W::NAME);
                }
                return None;
            }
        };
        let executing = match self.server.accept_goal(goal).await {
            Ok(accepted) => self.server.start_executing_goal(accepted).await,
            Err(error) => Err(error),
        };
        match executing {
            Ok(goal) => Some(Running { goal, working }),
            Err(error) => {
                tracing::error!(?error, "{}: a goal could not be accepted", W::NAME);
                working.end();
                None
            }
        }
    }

    /// Cancels what runs, if `request` means that; there is nothing to cancel in a goal that is unknown or over.
    async fn cancel(&self, request: &CancelHandle, running: Option<&Running<W>>) {
        let meant = running.filter(|running| request.contains_goal(&running.goal.goal_id()));
        if let Some(running) = meant {
            running.working.cancel();
        }
        let cancelled = meant.map(|running| running.goal.goal_id());
        if let Err(error) = self.server.respond_to_cancel_requests(request, cancelled.into_iter()).await {
            tracing::warn!(?error, "the answer to a cancellation of {} was not sent", W::NAME);
        }
    }

    async fn tell(&self, running: Option<&Running<W>>, step: Step) {
        // There is no feedback on a goal that is being cancelled.
        let Some(running) = running.filter(|running| !running.working.is_cancelled()) else { return };
        let published = self.server.publish_feedback(running.goal.clone(), Part(W::feedback(step)));
        if let Err(error) = published.await {
            tracing::warn!(?error, "feedback of {} was not published", W::NAME);
        }
    }

    fn answer(&self, goal: ExecutingOf<W::Action>, worked: Result<W::Done, NodeError>) -> Answer<'_, W> {
        let status = match &worked {
            Ok(_) => GoalEndStatus::Succeeded,
            Err(NodeError::Interrupted) => GoalEndStatus::Canceled,
            Err(_) => GoalEndStatus::Aborted,
        };
        let result = match worked {
            Ok(done) => W::result(Ok(done)),
            Err(error) => W::result(Err(&error)),
        };
        let asked = format!("{}/_action/get_result", self.name);
        let result = self.far.fit_all(&asked, result, W::SHORTEN);
        let sending = self.server.send_result_response(goal.clone(), status, Part(result));
        let sending = Box::pin(async move {
            if let Err(error) = sending.await {
                tracing::warn!(?error, "the result of {} was not sent", W::NAME);
            }
        });
        Answer { goal, sending }
    }

    /// Drops a result that nobody has asked for by the time of the next one.
    async fn forget(&self, answer: Option<Answer<'_, W>>) {
        let Some(Answer { goal, sending }) = answer else { return };
        drop(sending);
        tracing::warn!("nobody asked for the result of a goal of {}; it is dropped", W::NAME);
        if let Err(error) = self.server.abort_executing_goal(goal).await {
            // It stays on the status topic as one that is being cancelled: ros2-client knows no other way.
            tracing::debug!(?error, "the goal had been cancelled");
        }
    }
}

/// What the work says next; never, when there is none.
async fn next<W: Work>(running: &mut Option<Running<W>>) -> Said<W::Done> {
    match running {
        Some(running) => running.working.next().await,
        None => std::future::pending().await,
    }
}

/// The end of sending; never, when there is nothing to send.
async fn sent<W: Work>(answer: &mut Option<Answer<'_, W>>) {
    match answer {
        Some(answer) => answer.sending.as_mut().await,
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// Runs in a child of the test below, on a disk with room for a page.
    #[test]
    fn writer_on_a_full_disk() {
        let Some(disk) = std::env::var_os("ACTIONS_DISK") else { return };
        let path = Path::new(&disk).join("model.toml");
        let error = create(&path, &"a = 1\n".repeat(10_000)).expect_err("there is no room").to_string();
        assert!(error.contains("model.toml") && error.contains("make room on that disk"), "{error}");
        assert!(!path.exists(), "half a model may read as a whole one");
        create(&path, "a = 1\n").expect("there is room, and the name is free");
    }

    #[test]
    fn a_model_file_that_finds_no_room_is_not_left_half_written() {
        let disk = tempfile::tempdir().expect("a directory");
        let script = "mount -t tmpfs -o size=8k none \"$ACTIONS_DISK\" || exit 77
            exec \"$0\" --exact actions::tests::writer_on_a_full_disk";
        let me = std::env::current_exe().expect("this program");
        let mut command = Command::new("unshare");
        command.args(["--mount", "--propagation", "private", "sh", "-c", script]).arg(me);
        let ended = command.env("ACTIONS_DISK", disk.path()).output();
        match ended.as_ref().map(|ended| (ended.status.code(), ended.status.success())) {
            Ok((_, true)) => {}
            Ok((Some(77 | 1), _)) | Err(_) if !rustix::process::geteuid().is_root() => {
                eprintln!("SKIPPED: no disk can be mounted in a namespace of its own; that takes root");
            }
            _ => panic!("{ended:?}"),
        }
    }
}
