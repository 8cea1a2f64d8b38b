//! The action `close_loop`: names what the running model lacks, on what the service remembers.
//!
//! ```text
//! goal: seconds of history ─→ [ros-actions] ─→ history, running free model ─→ [close-loop: diagnosis] ─→ model file
//!                                   ↑ feedback: stage ──────────────────────────┘            └─→ load_model, if asked
//!                                   └─ result: the report of `mr-damper close`, JSON
//! ```
//!
//! The estimating thread knows nothing of it: the diagnosis has a copy of the history and a thread of its own. One goal at
//! a time: another one is rejected while a diagnosis runs. Nothing is swapped in unless `close_loop.auto_load` says so.

mod work;

use crate::command::close::in_words;
use crate::control::Control;
use crate::error::NodeError;
use crate::overseer::SharedHistory;
use crate::ros::{ActionServerOf, ExecutingOf, Part, Ros, run_async};
use crate::services;
use futures::channel::oneshot;
use futures::future::BoxFuture;
use mr_damper_model::diagnose::Stage;
use mr_damper_msgs::action::{CloseLoop, CloseLoopFeedback, CloseLoopGoal, CloseLoopResult};
use ros2_client::Node;
use ros2_client::action::GoalEndStatus;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use work::Job;

/// What the diagnosing thread says.
enum Said {
    Stage(Stage),
    Ended(Box<Ended>),
}

/// How a goal ended.
struct Ended {
    status: GoalEndStatus,
    report: String,
}

/// The goal that is worked on.
struct Running {
    goal: ExecutingOf<CloseLoop>,
    cancel: Arc<AtomicBool>,
    said: UnboundedReceiver<Said>,
    thread: JoinHandle<()>,
}

/// A result that waits until its client asks for it.
struct Answer<'a> {
    goal: ExecutingOf<CloseLoop>,
    sending: BoxFuture<'a, ()>,
}

/// The running action.
pub struct CloseLoopAction {
    stop: oneshot::Sender<()>,
    thread: JoinHandle<()>,
}

impl CloseLoopAction {
    /// Starts the thread that answers `server`.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub fn start(
        server: ActionServerOf<CloseLoop>,
        ros: &Ros,
        control: &Arc<Control>,
        history: SharedHistory,
    ) -> Result<Self, NodeError> {
        let desk = Desk { server, control: Arc::clone(control), history, node: ros.share() };
        let (stop, stopped) = oneshot::channel();
        let thread = run_async("ros-actions", desk.run(stopped))?;
        Ok(Self { stop, thread })
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Ends the thread, and with it a diagnosis that still runs. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        // A thread that has panicked does not listen any more.
        let _ = self.stop.send(());
        self.thread.join()
    }
}

struct Desk {
    server: ActionServerOf<CloseLoop>,
    control: Arc<Control>,
    history: SharedHistory,
    node: Arc<Node>,
}

impl Desk {
    async fn run(self, mut stopped: oneshot::Receiver<()>) {
        let mut running: Option<Running> = None;
        let mut answer: Option<Answer<'_>> = None;
        loop {
            tokio::select! {
                _ = &mut stopped => break,
                goal = self.server.receive_new_goal() => match goal {
                    Ok(goal) => self.consider(goal, &mut running).await,
                    Err(error) => tracing::warn!(?error, "a goal of close_loop cannot be read"),
                },
                request = self.server.receive_cancel_request() => match request {
                    Ok(request) => {
                        let ours = running.as_ref().map(|running| running.goal.goal_id());
                        let cancelled: Vec<_> = request.goals().filter(|id| Some(*id) == ours).collect();
                        if let (Some(running), false) = (&running, cancelled.is_empty()) {
                            running.cancel.store(true, Ordering::Release);
                        }
                        let responded = self.server.respond_to_cancel_requests(&request, cancelled.into_iter());
                        if let Err(error) = responded.await {
                            tracing::warn!(?error, "the answer to a cancellation was not sent");
                        }
                    }
                    Err(error) => tracing::warn!(?error, "a cancellation of close_loop cannot be read"),
                },
                said = next(&mut running) => match said {
                    Said::Stage(stage) => self.tell(&running, stage).await,
                    Said::Ended(ended) => {
                        if let Some(Running { goal, thread, .. }) = running.take() {
                            // It has said its last word, so it ends at once; a panic was said as one.
                            let _ = thread.join();
                            self.forget(answer.take()).await;
                            answer = Some(self.answer(goal, *ended));
                        }
                    }
                },
                () = sent(&mut answer) => answer = None,
            }
        }
        if let Some(Running { cancel, thread, .. }) = running {
            cancel.store(true, Ordering::Release);
            let _ = thread.join();
        }
    }

    /// Accepts the goal and begins to work on it, or rejects it.
    async fn consider(&self, goal: crate::ros::NewGoalOf<CloseLoop>, running: &mut Option<Running>) {
        let Some(Part(wanted)) = self.server.get_new_goal(goal.clone()) else { return };
        let why_not = if running.is_some() {
            Some("another goal is worked on; cancel it, or wait for its result")
        } else if !(wanted.history > 0.0 && wanted.history.is_finite()) {
            Some("history must be a positive number of seconds")
        } else {
            None
        };
        if let Some(why) = why_not {
            tracing::warn!(history_s = wanted.history, "close_loop: goal rejected: {why}");
            if let Err(error) = self.server.reject_goal(goal).await {
                tracing::warn!(?error, "a goal of close_loop was not rejected");
            }
            return;
        }
        let executing = match self.server.accept_goal(goal).await {
            Ok(accepted) => self.server.start_executing_goal(accepted).await,
            Err(error) => Err(error),
        };
        match executing.map_err(|error| format!("{error:?}")).and_then(|goal| self.begin(goal, &wanted)) {
            Ok(begun) => *running = Some(begun),
            Err(error) => tracing::error!(error, "close_loop: a goal was not begun"),
        }
    }

    /// Starts the diagnosing thread.
    fn begin(&self, goal: ExecutingOf<CloseLoop>, wanted: &CloseLoopGoal) -> Result<Running, String> {
        let config = self.control.config();
        let mut base = self.control.models().free;
        // The rows must be what the model runs on.
        if let Some((apply_to, cutoff_hz)) = config.pipeline_settings(base.conditioning.cutoff_hz).filter {
            (base.conditioning.apply_to, base.conditioning.cutoff_hz) = (apply_to, cutoff_hz);
        }
        let history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
        let runs = history.runs(wanted.history, config.settings.gap_s);
        drop(history);
        let out = match config.close_loop_out.as_str() {
            "" => std::env::temp_dir(),
            out => PathBuf::from(out),
        };
        tracing::info!(history_s = wanted.history, "close_loop: a goal is worked on");
        let job = Job { base, runs, out };
        let auto_load =
            config.close_loop_auto_load.then(|| (Arc::clone(&self.control), Arc::clone(&self.node)));
        let cancel = Arc::new(AtomicBool::new(false));
        let (says, said) = unbounded_channel();
        let thread = std::thread::Builder::new().name("close-loop".to_owned()).spawn({
            let cancel = Arc::clone(&cancel);
            move || diagnose(&job, &cancel, auto_load.as_ref(), &says)
        });
        let thread = thread.map_err(|error| format!("starting the thread of a diagnosis: {error}"))?;
        Ok(Running { goal, cancel, said, thread })
    }

    async fn tell(&self, running: &Option<Running>, stage: Stage) {
        let Some(running) = running else { return };
        if running.cancel.load(Ordering::Acquire) {
            return;
        }
        let feedback = CloseLoopFeedback { stage: in_words(stage), progress: progress(stage) };
        let published = self.server.publish_feedback(running.goal.clone(), Part(feedback));
        if let Err(error) = published.await {
            tracing::warn!(?error, "feedback of close_loop was not published");
        }
    }

    fn answer(&self, goal: ExecutingOf<CloseLoop>, ended: Ended) -> Answer<'_> {
        let Ended { status, report } = ended;
        let result = CloseLoopResult { success: status == GoalEndStatus::Succeeded, report };
        let sending = self.server.send_result_response(goal.clone(), status, Part(result));
        let sending = Box::pin(async move {
            if let Err(error) = sending.await {
                tracing::warn!(?error, "the result of close_loop was not sent");
            }
        });
        Answer { goal, sending }
    }

    /// A result that nobody has asked for by the time of the next one is dropped.
    async fn forget(&self, answer: Option<Answer<'_>>) {
        let Some(Answer { goal, sending }) = answer else { return };
        drop(sending);
        tracing::warn!("nobody asked for the result of a goal of close_loop; it is dropped");
        if let Err(error) = self.server.abort_executing_goal(goal).await {
            tracing::debug!(?error, "the goal had been cancelled");
        }
    }
}

/// The next thing that the diagnosing thread says; never, when there is none. A thread that died says so by its silence.
async fn next(running: &mut Option<Running>) -> Said {
    match running {
        Some(running) => running.said.recv().await.unwrap_or_else(|| {
            let error =
                NodeError::Failed("the diagnosis died; the node's log says why. Please report it".to_owned());
            Said::Ended(Box::new(Ended { status: GoalEndStatus::Aborted, report: work::error_json(&error) }))
        }),
        None => std::future::pending().await,
    }
}

async fn sent(answer: &mut Option<Answer<'_>>) {
    match answer {
        Some(answer) => answer.sending.as_mut().await,
        None => std::future::pending().await,
    }
}

/// The diagnosing thread.
fn diagnose(
    job: &Job,
    cancel: &AtomicBool,
    auto_load: Option<&(Arc<Control>, Arc<Node>)>,
    says: &UnboundedSender<Said>,
) {
    // Who does not listen any more has been told to stop.
    let say = |stage| drop(says.send(Said::Stage(stage)));
    let worked = work::work(job, cancel, &say).and_then(|done| {
        let loaded = match (&done.model, auto_load) {
            (Some(path), Some((control, node))) => {
                let loaded = services::load_model(control, node, &path.display().to_string());
                loaded.map(|_| true).map_err(|error| error.to_string())
            }
            _ => Ok(false),
        };
        tracing::info!(model_file = ?done.model, loaded = ?loaded, "close_loop: {}", done.in_short());
        done.json(&loaded)
    });
    let ended = match worked {
        Ok(report) => Ended { status: GoalEndStatus::Succeeded, report },
        Err(error) => {
            tracing::warn!("close_loop came to nothing: {error}");
            let cancelled = matches!(error, NodeError::Interrupted);
            let status = if cancelled { GoalEndStatus::Canceled } else { GoalEndStatus::Aborted };
            Ended { status, report: work::error_json(&error) }
        }
    };
    drop(says.send(Said::Ended(Box::new(ended))));
}

/// About how much of the work is done when `stage` begins.
fn progress(stage: Stage) -> f32 {
    match stage {
        Stage::Base => 0.0,
        Stage::Scores(round) => (0.05 + 0.2 * (round as f32 - 1.0)).min(0.6),
        Stage::Refits(round) => (0.15 + 0.2 * (round as f32 - 1.0)).min(0.65),
        Stage::Pruning => 0.7,
        Stage::Rival => 0.75,
        Stage::Sealed => 0.95,
    }
}
