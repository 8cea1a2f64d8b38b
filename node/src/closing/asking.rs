//! A client of the action `close_loop`: has a running node name what its model lacks. For the command and for the page.

use crate::config::{Config, RosArgs};
use crate::error::NodeError;
use crate::interrupt::Interrupt;
use crate::ros::{ActionClientOf, Part, Ros};
use crate::service;
use mr_damper_msgs::action::{CloseLoop, CloseLoopFeedback, CloseLoopGoal, CloseLoopResult};
use ros2_client::NodeOptions;
use ros2_client::action::GoalId;
use serde_json::Value;
use std::time::{Duration, Instant};

/// More history than any node keeps, s.
pub const ALL_S: f64 = 1e9;

/// How long a node may take to be found.
const FIND: Duration = Duration::from_secs(10);
/// How long it may take to accept or reject a goal. A first call can take three seconds.
const ACCEPT: Duration = Duration::from_secs(10);
/// How long it may take to accept a cancellation: Ctrl-C ends the command within a second.
const CANCEL: Duration = Duration::from_millis(700);
/// How often it is looked for answers.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How often it is looked whether the node is still there.
const ALIVE_EVERY: Duration = Duration::from_secs(1);

/// Has the node in the namespace of `args` close its loop on its last `history_s` seconds, and returns its report. Asks as the node
/// called `name`, unless `args` give another; `say` hears each stage in words, and about how much is done, from 0 to 1.
///
/// # Errors
/// When no node answers, or the goal is rejected or comes to nothing; [`NodeError::Interrupted`], with the goal cancelled, once
/// `interrupt` is raised.
pub fn ask(
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
    let asking = Asking { action: &action, args, ros: &ros, client: &client, interrupt, say };
    let report = asking.find(config).and_then(|()| asking.ask(history_s));
    drop(client);
    ros.stop();
    report
}

/// The line that swaps in the model file of `report` at the node in the namespace of `args`; `None` where there is none.
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

/// A client of the action of one node.
struct Asking<'a> {
    action: &'a str,
    args: &'a RosArgs,
    ros: &'a Ros,
    client: &'a ActionClientOf<CloseLoop>,
    interrupt: &'a Interrupt,
    say: &'a dyn Fn(&str, f32),
}

impl Asking<'_> {
    /// Waits until a node offers the action.
    fn find(&self, config: &Config) -> Result<(), NodeError> {
        match self.poll(FIND, || Ok(self.ros.reaches(self.client).then_some(())))? {
            Some(_) => Ok(()),
            None => Err(NodeError::Failed(format!(
                "no node answers {} in {} within {} s. Is `mr-damper node` running there? Its domain is given by \
                 ROS_DOMAIN_ID or --domain-id, its namespace by --ros-args -r __ns:=/front_left (now {})",
                self.action,
                service::reach(config)?,
                FIND.as_secs(),
                self.args.namespace()
            ))),
        }
    }

    /// The report of a goal of so many seconds.
    fn ask(&self, history: f64) -> Result<Value, NodeError> {
        let sent = self.client.send_goal(Part(CloseLoopGoal { history }));
        let (request, goal) = sent.map_err(|error| self.failed("sending the goal", &error))?;
        let answer = self.poll(ACCEPT, || {
            let answer = self.client.receive_goal_response(request);
            answer.map_err(|error| self.failed("reading the answer to the goal", &error))
        });
        let answer = answer.inspect_err(|_| self.cancel(goal))?;
        match answer {
            Some(answer) if answer.accepted => {}
            Some(_) => {
                return Err(NodeError::Failed(format!(
                    "{} rejects the goal: it works on one at a time, so wait for the other one, or cancel that. The \
                     node's log says why",
                    self.action
                )));
            }
            None => {
                self.cancel(goal);
                return Err(NodeError::Failed(format!(
                    "{} did not answer within {} s; the node's log may say why",
                    self.action,
                    ACCEPT.as_secs()
                )));
            }
        }
        let result = self.result(goal).inspect_err(|_| self.cancel(goal))?.ok_or_else(|| {
            NodeError::Failed(format!("the node of {} has gone while it worked on the goal", self.action))
        })?;
        let report: Value = serde_json::from_str(&result.report)
            .map_err(|error| self.failed("reading the report", &error))?;
        match report["error"].as_str() {
            None if result.success => Ok(report),
            why => Err(NodeError::Failed(format!(
                "{} came to nothing: {}",
                self.action,
                why.unwrap_or("it does not say why; see the node's log")
            ))),
        }
    }

    /// Tells the stages of a goal until its result is there; `None` when the node has gone.
    fn result(&self, goal: GoalId) -> Result<Option<CloseLoopResult>, NodeError> {
        let request = self.client.request_result(goal);
        let request = request.map_err(|error| self.failed("asking for the result", &error))?;
        let mut seen_alive = Instant::now();
        loop {
            let told = self.client.receive_feedback(goal);
            if let Some(Part(CloseLoopFeedback { stage, progress })) =
                told.map_err(|error| self.failed("reading feedback", &error))?
            {
                (self.say)(&stage, progress);
                continue;
            }
            let result = self.client.receive_result(request);
            if let Some((_, Part(result))) =
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

    /// Asks for the goal to be cancelled, and waits a moment for the answer; nothing more can be done about it.
    fn cancel(&self, goal: GoalId) {
        let deadline = Instant::now() + CANCEL;
        let Ok(request) = self.client.cancel_goal(goal) else { return };
        while Instant::now() < deadline {
            match self.client.receive_cancel_response(request) {
                Ok(None) => std::thread::sleep(LOOK_EVERY),
                Ok(Some(answer)) if answer.goals_canceling.is_empty() => return,
                Ok(Some(_)) => return tracing::info!("the goal is cancelled"),
                Err(error) => return tracing::warn!(?error, "the answer to the cancellation cannot be read"),
            }
        }
        tracing::warn!("the node did not say that it cancels the goal: it may work on");
    }

    /// Looks for something until it is there; `None` when it is not there in time.
    ///
    /// # Errors
    /// Those of `look`; [`NodeError::Interrupted`].
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

    fn failed(&self, what: &str, error: &dyn std::fmt::Debug) -> NodeError {
        NodeError::Ros { what: format!("{}: {what}", self.action), why: format!("{error:?}") }
    }
}
