//! `mr-damper close --live`: asks a running node to diagnose its own model, through the node's action `close_loop`.

use crate::commands::context::CliContext;
use crate::commands::number::seconds;
use crate::commands::output::OutputArgs;
use crate::commands::progress::Working;
use crate::ros2::close_loop_client::{self, ALL_S};
use crate::settings::config::Config;
use crate::settings::error::NodeError;
use serde_json::Value;
use std::fmt::Write;

/// Default name of this command's node.
pub const NODE: &str = "mr_damper_close";

/// Arguments for a diagnosis on a running node.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "On a running node")]
pub struct LiveArgs {
    /// Let a running node do the diagnosis, through its action close_loop: for the model that it runs, on its input
    /// history. Give the node's namespace with --ros-args -r __ns:=/front_left.
    #[arg(long, conflicts_with_all = [super::GROUP, "ConditioningArgs", "RunArgs", "report"])]
    pub live: bool,
    /// Seconds of history to use; default: all that the node keeps (its parameter history.duration_s).
    #[arg(long, value_name = "S", requires = "live", conflicts_with = super::GROUP, allow_hyphen_values = true, value_parser = seconds)]
    pub history: Option<f64>,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", requires = "live", conflicts_with = super::GROUP, value_parser = clap::value_parser!(u8).range(0..=232))]
    pub domain_id: Option<u8>,
}

/// Sends the goal, shows its stages, and prints the result.
///
/// # Errors
/// When no node answers, the goal is rejected or fails, or the JSON cannot be written;
/// [`NodeError::Interrupted`], after the goal was cancelled.
pub(super) fn run(args: &LiveArgs, output: &OutputArgs, context: &CliContext) -> Result<(), NodeError> {
    let mut config = Config::default();
    context.ros_args.apply(&mut config)?;
    config.domain_id = args.domain_id.map_or(config.domain_id, i64::from);
    let working = Working::new(context.quiet);
    let history_s = args.history.unwrap_or(ALL_S);
    let say = |stage: &str, _: f32| working.stage(stage);
    let report =
        close_loop_client::diagnose(&config, &context.ros_args, NODE, history_s, &context.interrupt, &say)?;
    drop(working);
    let load_line = close_loop_client::load_line(&report, &context.ros_args, &config);
    output.figures(&report, || text(&report, load_line.as_deref()))
}

/// The text of the report, and where the model file is and how to load it.
fn text(report: &Value, load_line: Option<&str>) -> String {
    let words = |key: &str| report[key].as_str();
    let mut text = words("text").unwrap_or_default().to_owned();
    text.push('\n');
    match words("model_file") {
        None => text.push_str("no effect was found: no model file is written\n"),
        Some(path) => {
            let _ = writeln!(text, "model file, on the node's machine: {path}");
            if report["loaded"] == true {
                text.push_str("The node has loaded it.\n");
            } else {
                if let Some(why) = words("load_error") {
                    let _ = writeln!(text, "The node has not loaded it: {why}");
                }
                let _ = writeln!(text, "To load it:\n  {}", load_line.unwrap_or_default());
            }
        }
    }
    if let Some(note) = words("note") {
        let _ = writeln!(text, "Note: {note}");
    }
    let _ = writeln!(text, "{:.1} s", report["seconds"].as_f64().unwrap_or_default());
    text
}
