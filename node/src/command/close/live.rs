//! `mr-damper close --live`: has a running node name what its model lacks, by the node's action `close_loop`.

use crate::closing::asking::{self, ALL_S};
use crate::command::Surroundings;
use crate::command::output::OutputArgs;
use crate::command::progress::Working;
use crate::config::Config;
use crate::error::NodeError;
use serde_json::Value;
use std::fmt::Write;

/// Name of the node, unless it is given another.
pub const NODE: &str = "mr_damper_close";

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
    let working = Working::new(around.quiet);
    let history_s = args.history.unwrap_or(ALL_S);
    let say = |stage: &str, _: f32| working.stage(stage);
    let report = asking::ask(&config, &around.ros_args, NODE, history_s, &around.interrupt, &say)?;
    drop(working);
    let load_line = asking::load_line(&report, &around.ros_args, &config);
    output.figures(&report, || text(&report, load_line.as_deref()))
}

/// The report's words, what was written, and what to do with it.
fn text(report: &Value, load_line: Option<&str>) -> String {
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
                let _ = writeln!(text, "To swap it in:\n  {}", load_line.unwrap_or_default());
            }
        }
    }
    if let Some(note) = words("note") {
        let _ = writeln!(text, "Note: {note}");
    }
    let _ = writeln!(text, "{:.1} s", report["seconds"].as_f64().unwrap_or_default());
    text
}
