//! `mr-damper close --live`: has a running node name what its model lacks, by the node's action `close_loop`.

use crate::command::Surroundings;
use crate::command::output::OutputArgs;
use crate::command::progress::Working;
use crate::config::Config;
use crate::error::NodeError;
use crate::ros::{ActionClientOf, Part, Ros};
use crate::service;
use mr_damper_msgs::action::{CloseLoop, CloseLoopGoal, CloseLoopResult};
use ros2_client::NodeOptions;
use ros2_client::action::GoalId;
use serde_json::Value;
use std::fmt::Write;
use std::time::{Duration, Instant};

/// Name of the node, unless it is given another.
pub const NODE: &str = "mr_damper_close";

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
/// More history than any node keeps.
const ALL_S: f64 = 1e9;

/// What a closing on a running node needs.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "On a running node")]
pub struct LiveArgs {
    /// Have a running node do it, by its action close_loop: with the model that it runs, on the input that it remembers.
    /// --ros-args -r __ns:=/front_left names its namespace.
    #[arg(long, conflicts_with_all = [super::GROUP, "ConditioningArgs", "RunArgs", "report"])]
    pub live: bool,
    /// Seconds of history to use; by default all that the node keeps (its parameter history.duration_s).
    #[arg(long, value_name = "S", requires = "live", conflicts_with = super::GROUP, allow_hyphen_values = true, value_parser = seconds)]
    pub history: Option<f64>,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", requires = "live", conflicts_with = super::GROUP, value_parser = clap::value_parser!(u8).range(0..=232))]
    pub domain_id: Option<u8>,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("must be a positive number of seconds".to_owned()),
    }
}

/// Sends the goal, tells its stages, and prints what came out.
///
/// # Errors
/// When no node answers, the goal is rejected or comes to nothing, or the JSON cannot be written;
/// [`NodeError::Interrupted`], with the goal cancelled.
pub(super) fn run(args: &LiveArgs, output: &OutputArgs, around: &Surroundings) -> Result<(), NodeError> {
    let mut config = Config::default();
    around.ros_args.apply(&mut config)?;
    config.domain_id = args.domain_id.map_or(config.domain_id, i64::from);
    let action = around.ros_args.topic("close_loop");
    let name = around.ros_args.node.as_deref().unwrap_or(NODE);
    let options = NodeOptions::new().enable_rosout(false);
    let mut ros = Ros::start(&config, &around.ros_args, options, name)?;
    let client = ros.action_client::<CloseLoop>(&action)?;
    let asking = Asking { action: &action, ros: &ros, client: &client, around };
    let report = asking.find(&config).and_then(|()| asking.ask(args.history.unwrap_or(ALL_S)));
    drop(client);
    ros.stop();
    let report = report?;
    output.figures(&report, || text(&report, &around.ros_args.topic("load_model"), &config))
}

/// A client of the action of one node.
struct Asking<'a> {
    action: &'a str,
    ros: &'a Ros,
    client: &'a ActionClientOf<CloseLoop>,
    around: &'a Surroundings,
}

impl Asking<'_> {
    /// Waits until a node offers the action.
    fn find(&self, config: &Config) -> Result<(), NodeError> {
        let there = || {
            self.ros.reaches(self.client.goal_client())
                && self.ros.reaches(self.client.cancel_client())
                && self.ros.reaches(self.client.result_client())
        };
        match self.poll(FIND, || Ok(there().then_some(())))? {
            Some(_) => Ok(()),
            None => Err(NodeError::Failed(format!(
                "no node answers {} in {} within {} s. Is `mr-damper node` running there? Its domain is given by \
                 ROS_DOMAIN_ID or --domain-id, its namespace by --ros-args -r __ns:=/front_left (now {})",
                self.action,
                service::reach(config)?,
                FIND.as_secs(),
                self.around.ros_args.namespace()
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
        let working = Working::new(self.around.quiet);
        let mut seen_alive = Instant::now();
        loop {
            let told = self.client.receive_feedback(goal);
            if let Some(Part(feedback)) = told.map_err(|error| self.failed("reading feedback", &error))? {
                working.stage(&feedback.stage);
                continue;
            }
            let result = self.client.receive_result(request);
            if let Some((_, Part(result))) =
                result.map_err(|error| self.failed("reading the result", &error))?
            {
                return Ok(Some(result));
            }
            if self.around.interrupt.is_raised() {
                return Err(NodeError::Interrupted);
            }
            if seen_alive.elapsed() > ALIVE_EVERY {
                if !self.ros.reaches(self.client.goal_client()) {
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
            if !self.around.interrupt.sleep_until(Instant::now() + LOOK_EVERY) {
                return Err(NodeError::Interrupted);
            }
            if Instant::now() >= deadline {
                return Ok(None);
            }
        }
    }

    fn failed(&self, what: &str, error: &dyn std::fmt::Debug) -> NodeError {
        NodeError::Ros { what: format!("{}: {what}", self.action), why: format!("{error:?}") }
    }
}

/// The report's words, what was written, and what to do with it.
fn text(report: &Value, load_model: &str, config: &Config) -> String {
    let words = |key: &str| report[key].as_str();
    let mut text = words("text").unwrap_or_default().to_owned();
    text.push('\n');
    match words("model_file") {
        None => text.push_str("nothing was named: no model file is written\n"),
        Some(path) => {
            let _ = writeln!(text, "model file, on the node's machine: {path}");
            if report["loaded"] == true {
                text.push_str("It is in force.\n");
            } else {
                if let Some(why) = words("load_error") {
                    let _ = writeln!(text, "It was not swapped in: {why}");
                }
                let domain = match config.domain_id {
                    id @ 0.. => format!("ROS_DOMAIN_ID={id} "),
                    _ => String::new(),
                };
                let path = path.replace('\'', "''");
                let _ = writeln!(
                    text,
                    "To swap it in:\n  {domain}ros2 service call {load_model} mr_damper_msgs/srv/LoadModel \"{{model: '{path}'}}\""
                );
            }
        }
    }
    if let Some(note) = words("note") {
        let _ = writeln!(text, "Note: {note}");
    }
    let _ = writeln!(text, "{:.1} s", report["seconds"].as_f64().unwrap_or_default());
    text
}
