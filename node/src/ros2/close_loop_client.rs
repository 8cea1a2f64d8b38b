//! A client of the action `close_loop`: it lets a running node diagnose its model. The command and the web page use it.

mod error;

pub use error::CloseLoopError;

use crate::ros2::participant::{self, ActionClientOf, Ros, RosMessage};
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use mr_damper_msgs::action::{CloseLoop, CloseLoopFeedback, CloseLoopGoal, CloseLoopResult};
use ros2_client::NodeOptions;
use ros2_client::action::GoalId;
use serde_json::Value;
use std::time::{Duration, Instant};

/// A history longer than any node keeps, s.
pub const ALL_S: f64 = 1e9;

/// Longest time to find a node.
const FIND: Duration = Duration::from_secs(10);
/// Longest time until a goal is accepted or rejected. A first call can take 3 s.
const ACCEPT: Duration = Duration::from_secs(10);
/// Longest time until a cancellation is accepted; Ctrl-C must end the command within a second.
const CANCEL: Duration = Duration::from_millis(700);
/// Time between two checks for answers.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Time between two checks that the node is still present.
const ALIVE_EVERY: Duration = Duration::from_secs(1);

/// Lets the node in the namespace of `args` run the diagnosis (`close_loop`) on its last `history_s` seconds, and
/// returns its report.
///
/// The client is a node called `name`, unless `args` give another name. `say` receives each stage as text, and the
/// approximate progress, from 0 to 1.
///
/// # Errors
/// [`CloseLoopError`] when no node answers, or the goal is rejected or fails; [`NodeError::Interrupted`], with the goal
/// cancelled, once `interrupt` is raised.
pub fn diagnose(
    config: &Config,
    args: &RosArgs,
    name: &str,
    history_s: f64,
    interrupt: &Interrupt,
    say: &dyn Fn(&str, f32),
) -> Result<Value, NodeError> {
    let action = args.topic("close_loop");
    let name = args.node.as_deref().unwrap_or(name);
    let mut ros = Ros::start(config, args, NodeOptions::new().enable_rosout(false), name)?;
    let client = ros.action_client::<CloseLoop>(&action)?;
    let call = CloseLoopClient { action: &action, args, ros: &ros, client: &client, interrupt, say };
    let report = call.find(config).and_then(|()| call.run(history_s));
    drop(client);
    ros.stop();
    report
}

/// The command line that loads the model file of `report` at the node in the namespace of `args`; `None` without a
/// model file.
#[must_use]
pub fn load_line(report: &Value, args: &RosArgs, config: &Config) -> Option<String> {
    let domain = match config.domain_id {
        id @ 0.. => format!("ROS_DOMAIN_ID={id} "),
        _ => String::new(),
    };
    let path = report["model_file"].as_str()?.replace('\'', "''");
    let service = args.topic("load_model");
    Some(format!("{domain}ros2 service call {service} mr_damper_msgs/srv/LoadModel \"{{model: '{path}'}}\""))
}

/// A client of one node's action.
struct CloseLoopClient<'a> {
    action: &'a str,
    args: &'a RosArgs,
    ros: &'a Ros,
    client: &'a ActionClientOf<CloseLoop>,
    interrupt: &'a Interrupt,
    say: &'a dyn Fn(&str, f32),
}

impl CloseLoopClient<'_> {
    /// Waits until a node offers the action.
    fn find(&self, config: &Config) -> Result<(), NodeError> {
        match self.poll(FIND, || Ok(self.ros.reaches(self.client).then_some(())))? {
            Some(_) => Ok(()),
            None => Err(CloseLoopError::NoNode {
                action: self.action.to_owned(),
                reach: participant::reach(config)?,
                within_s: FIND.as_secs(),
                namespace: self.args.namespace(),
            }
            .into()),
        }
    }

    /// Sends a goal for `history` seconds and returns the report.
    fn run(&self, history: f64) -> Result<Value, NodeError> {
        let sent = self.client.send_goal(RosMessage(CloseLoopGoal { history }));
        let (request, goal) = sent.map_err(|error| self.failed("sending the goal", &error))?;
        let answer = self.poll(ACCEPT, || {
            let answer = self.client.receive_goal_response(request);
            answer.map_err(|error| self.failed("reading the answer to the goal", &error))
        });
        let answer = answer.inspect_err(|_| self.cancel(goal))?;
        let action = self.action.to_owned();
        match answer {
            Some(answer) if answer.accepted => {}
            Some(_) => return Err(CloseLoopError::Rejected { action }.into()),
            None => {
                self.cancel(goal);
                return Err(CloseLoopError::NoAnswer { action, within_s: ACCEPT.as_secs() }.into());
            }
        }
        let Some(result) = self.result(goal).inspect_err(|_| self.cancel(goal))? else {
            return Err(CloseLoopError::NodeGone { action }.into());
        };
        let report: Value = serde_json::from_str(&result.report)
            .map_err(|error| self.failed("reading the report", &error))?;
        match report["error"].as_str() {
            None if result.success => Ok(report),
            error => Err(CloseLoopError::Failed {
                action,
                error: error.map(str::to_owned),
                reason: report.get("reason").filter(|reason| !reason.is_null()).cloned(),
            }
            .into()),
        }
    }

    /// Reports the stages of a goal until its result arrives; `None` when the node has disappeared.
    fn result(&self, goal: GoalId) -> Result<Option<CloseLoopResult>, NodeError> {
        let request = self.client.request_result(goal);
        let request = request.map_err(|error| self.failed("asking for the result", &error))?;
        let mut seen_alive = Instant::now();
        loop {
            let feedback = self.client.receive_feedback(goal);
            if let Some(RosMessage(CloseLoopFeedback { stage, progress })) =
                feedback.map_err(|error| self.failed("reading feedback", &error))?
            {
                (self.say)(&stage, progress);
                continue;
            }
            let result = self.client.receive_result(request);
            if let Some((_, RosMessage(result))) =
                result.map_err(|error| self.failed("reading the result", &error))?
            {
                return Ok(Some(result));
            }
            if self.interrupt.is_raised() {
                return Err(NodeError::Interrupted);
            }
            if seen_alive.elapsed() > ALIVE_EVERY {
                if !self.ros.reaches(self.client) {
                    return Ok(None);
                }
                seen_alive = Instant::now();
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Requests the cancellation of the goal, and waits a short time for the answer. Errors are only logged.
    fn cancel(&self, goal: GoalId) {
        let deadline = Instant::now() + CANCEL;
        let Ok(request) = self.client.cancel_goal(goal) else { return };
        while Instant::now() < deadline {
            match self.client.receive_cancel_response(request) {
                Ok(None) => std::thread::sleep(LOOK_EVERY),
                Ok(Some(answer)) if answer.goals_canceling.is_empty() => return,
                Ok(Some(_)) => return tracing::info!("the goal is cancelled"),
                Err(error) => return tracing::warn!(%error, "cannot read the answer to the cancellation"),
            }
        }
        tracing::warn!("the node did not confirm the cancellation; it may still execute the goal");
    }

    /// Calls `look` until it returns a value; `None` if it does not in time.
    ///
    /// # Errors
    /// The errors of `look`; [`NodeError::Interrupted`].
    fn poll<T>(
        &self,
        within: Duration,
        mut look: impl FnMut() -> Result<Option<T>, NodeError>,
    ) -> Result<Option<T>, NodeError> {
        let deadline = Instant::now() + within;
        loop {
            if let Some(found) = look()? {
                return Ok(Some(found));
            }
            if !self.interrupt.sleep_until(Instant::now() + LOOK_EVERY) {
                return Err(NodeError::Interrupted);
            }
            self.ros.check()?;
            if Instant::now() >= deadline {
                return Ok(None);
            }
        }
    }

    fn failed(&self, what: &str, error: &dyn std::fmt::Display) -> NodeError {
        NodeError::Ros { what: format!("{}: {what}", self.action), why: error.to_string() }
    }
}
