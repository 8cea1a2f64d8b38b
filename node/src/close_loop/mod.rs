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
//!
//! A result waits for its client to ask, until the next goal has one. When the service stops, who waits for a result is
//! told so.

mod diagnosis;
mod work;

use crate::command::close::in_words;
use crate::config::RosArgs;
use crate::control::Control;
use crate::error::NodeError;
use crate::overseer::SharedHistory;
use crate::ros::{ActionServerOf, ExecutingOf, NewGoalOf, Part, Ros, Task};
use diagnosis::{Diagnosis, Ended, Said};
use futures::FutureExt;
use futures::channel::oneshot;
use futures::future::BoxFuture;
use mr_damper_model::diagnose::Stage;
use mr_damper_msgs::action::{CloseLoop, CloseLoopFeedback, CloseLoopGoal, CloseLoopResult};
use ros2_client::Node;
use ros2_client::action::{CancelHandle, GoalEndStatus};
use std::sync::{Arc, PoisonError};
use std::time::Duration;
use work::{Job, Swap};

/// What a last result takes to arrive: it is lost when its writer goes together with it.
const DELIVERY: Duration = Duration::from_millis(150);

/// The goal that is worked on.
struct Running {
    goal: ExecutingOf<CloseLoop>,
    diagnosis: Diagnosis,
}

/// A result that waits until its client asks for it.
struct Answer<'a> {
    goal: ExecutingOf<CloseLoop>,
    sending: BoxFuture<'a, ()>,
}

/// Offers the action. Starts nothing yet, so that more can be created on the node.
///
/// # Errors
/// When DDS refuses.
pub fn offer(ros: &mut Ros, args: &RosArgs) -> Result<ActionServerOf<CloseLoop>, NodeError> {
    ros.serve_action::<CloseLoop>(&args.topic("close_loop"))
}

/// Starts the task that answers `server`. Its end is that of a diagnosis that still runs.
///
/// # Errors
/// When the system starts no thread.
pub fn start(
    server: ActionServerOf<CloseLoop>,
    ros: &Ros,
    args: &RosArgs,
    control: &Arc<Control>,
    history: SharedHistory,
) -> Result<Task, NodeError> {
    let damper = args.damper().to_owned();
    let desk = Desk { server, control: Arc::clone(control), history, node: ros.share(), damper };
    Task::start("ros-actions", |stopped| desk.run(stopped))
}

/// Where goals come in and results go out.
struct Desk {
    server: ActionServerOf<CloseLoop>,
    control: Arc<Control>,
    history: SharedHistory,
    node: Arc<Node>,
    damper: String,
}

impl Desk {
    async fn run(self, mut stopped: oneshot::Receiver<()>) {
        let mut running: Option<Running> = None;
        let mut answer: Option<Answer<'_>> = None;
        loop {
            tokio::select! {
                _ = &mut stopped => break,
                goal = self.server.receive_new_goal() => match goal {
                    Ok(goal) => {
                        let begun = self.consider(goal, running.is_some()).await;
                        running = begun.or(running);
                    }
                    Err(error) => tracing::warn!(?error, "a goal of close_loop cannot be read"),
                },
                request = self.server.receive_cancel_request() => match request {
                    Ok(request) => self.cancel(&request, running.as_ref()).await,
                    Err(error) => tracing::warn!(?error, "a cancellation of close_loop cannot be read"),
                },
                said = next(&mut running) => match said {
                    Said::Stage(stage) => self.tell(running.as_ref(), stage).await,
                    Said::Ended(ended) => {
                        if let Some(Running { goal, diagnosis }) = running.take() {
                            // It has said its last word, so this takes no time.
                            diagnosis.end();
                            self.forget(answer.take()).await;
                            answer = Some(self.answer(goal, ended));
                        }
                    }
                },
                () = sent(&mut answer) => answer = None,
            }
        }
        if let Some(Running { goal, diagnosis }) = running {
            diagnosis.end();
            let stopped = NodeError::Failed("the node was stopped while it worked on this goal".to_owned());
            // Whoever waits has asked by now; nobody is waited for.
            if self.answer(goal, Ended::by(Err(stopped))).sending.now_or_never().is_some() {
                std::thread::sleep(DELIVERY);
            }
        }
    }

    /// Begins to work on the goal and accepts it, or rejects it.
    async fn consider(&self, goal: NewGoalOf<CloseLoop>, busy: bool) -> Option<Running> {
        let Part(wanted) = self.server.get_new_goal(goal.clone())?;
        let diagnosis = match self.begin(&wanted, busy) {
            Ok(diagnosis) => diagnosis,
            Err(why) => {
                tracing::warn!(history_s = wanted.history, "close_loop: goal rejected: {why}");
                if let Err(error) = self.server.reject_goal(goal).await {
                    tracing::warn!(?error, "the rejection of a goal of close_loop was not sent");
                }
                return None;
            }
        };
        let executing = match self.server.accept_goal(goal).await {
            Ok(accepted) => self.server.start_executing_goal(accepted).await,
            Err(error) => Err(error),
        };
        match executing {
            Ok(goal) => Some(Running { goal, diagnosis }),
            Err(error) => {
                tracing::error!(?error, "close_loop: a goal could not be accepted");
                diagnosis.end();
                None
            }
        }
    }

    /// Starts the diagnosing thread on what is remembered now.
    fn begin(&self, wanted: &CloseLoopGoal, busy: bool) -> Result<Diagnosis, String> {
        if busy {
            return Err("another goal is worked on; cancel it, or wait for its result".to_owned());
        }
        if !(wanted.history > 0.0 && wanted.history.is_finite()) {
            return Err("history must be a positive number of seconds".to_owned());
        }
        let config = self.control.config();
        let running = self.control.models().free;
        let mut base = running;
        // The rows must be what the model runs on.
        if let Some((apply_to, cutoff_hz)) = config.pipeline_settings(base.conditioning.cutoff_hz).filter {
            (base.conditioning.apply_to, base.conditioning.cutoff_hz) = (apply_to, cutoff_hz);
        }
        let history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
        let runs = history.runs(wanted.history, config.settings.gap_s);
        drop(history);
        let folder = match config.close_loop_out.as_str() {
            "" => std::env::temp_dir(),
            out => out.into(),
        };
        let swap = config.close_loop_auto_load.then(|| Swap {
            control: Arc::clone(&self.control),
            node: Arc::clone(&self.node),
            running,
        });
        let job = Job { base, runs, folder, damper: self.damper.clone(), swap };
        Diagnosis::start(move |cancelled, say| job.work(cancelled, say)).map_err(|error| error.to_string())
    }

    /// Cancels what runs, if `request` means that; there is nothing to cancel in a goal that is unknown or over.
    async fn cancel(&self, request: &CancelHandle, running: Option<&Running>) {
        let meant = running.filter(|running| request.contains_goal(&running.goal.goal_id()));
        if let Some(running) = meant {
            running.diagnosis.cancel();
        }
        let cancelled = meant.map(|running| running.goal.goal_id());
        if let Err(error) = self.server.respond_to_cancel_requests(request, cancelled.into_iter()).await {
            tracing::warn!(?error, "the answer to a cancellation of close_loop was not sent");
        }
    }

    async fn tell(&self, running: Option<&Running>, stage: Stage) {
        // There is no feedback on a goal that is being cancelled.
        let Some(running) = running.filter(|running| !running.diagnosis.is_cancelled()) else { return };
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

    /// Drops a result that nobody has asked for by the time of the next one.
    async fn forget(&self, answer: Option<Answer<'_>>) {
        let Some(Answer { goal, sending }) = answer else { return };
        drop(sending);
        tracing::warn!("nobody asked for the result of a goal of close_loop; it is dropped");
        if let Err(error) = self.server.abort_executing_goal(goal).await {
            // It stays on the status topic as one that is being cancelled: ros2-client knows no other way.
            tracing::debug!(?error, "the goal had been cancelled");
        }
    }
}

/// What the diagnosis says next; never, when there is none.
async fn next(running: &mut Option<Running>) -> Said {
    match running {
        Some(running) => running.diagnosis.next().await,
        None => std::future::pending().await,
    }
}

/// The end of sending; never, when there is nothing to send.
async fn sent(answer: &mut Option<Answer<'_>>) {
    match answer {
        Some(answer) => answer.sending.as_mut().await,
        None => std::future::pending().await,
    }
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
