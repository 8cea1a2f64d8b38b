//! Logs go to stderr; stdout belongs to results.

use crate::live::held_log;
use crate::rosout::ToRosout;
use clap::ValueEnum;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, fmt};

/// How log lines look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line.
    Json,
}

/// Where log lines go besides stderr, and whether they go there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs {
    /// To standard error.
    pub stderr: bool,
    /// To the topic `/rosout`, once there is a node.
    pub rosout: bool,
}

/// Starts logging at `level` (`RUST_LOG` is stronger). Called once, before anything is logged.
pub fn start(format: LogFormat, level: &str, outputs: Outputs) {
    // The middlewares are chatty. What matters of them shows in our own counters and messages; their errors
    // are still let through, except four that say nothing: a missing ROS_DISTRO, a publisher without readers,
    // leaving a multicast group that loopback never joined, and /clock in the type that the client library takes for it.
    let default = format!(
        "{level},rustdds=error,rustdds::network::udp_listener=off,rustdds::discovery::discovery_db=off,ros2_client=error,ros2_client::distributions=off,ros2_client::node=off,zenoh=error"
    );
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let colour = std::io::IsTerminal::is_terminal(&std::io::stderr());
    let lines = fmt::layer().with_writer(|| held_log::Writer).with_target(false).with_ansi(colour);
    let lines = match (outputs.stderr, format) {
        (false, _) => None,
        (true, LogFormat::Text) => Some(lines.boxed()),
        (true, LogFormat::Json) => Some(lines.json().with_ansi(false).boxed()),
    };
    let rosout = outputs.rosout.then_some(ToRosout);
    // A second start (in tests) leaves the first in place.
    let _ = tracing_subscriber::registry().with(filter).with(lines).with(rosout).try_init();
}
