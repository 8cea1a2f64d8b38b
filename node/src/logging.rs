//! Logs go to stderr; stdout belongs to results.

use crate::live::held_log;
use clap::ValueEnum;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt;

/// How log lines look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One JSON object a line.
    Json,
}

/// Starts logging at `level` (`RUST_LOG` is stronger). Called once, before anything is logged.
pub fn start(format: LogFormat, level: &str) {
    // The middlewares are chatty. What matters of them shows in our own counters and messages; their errors
    // are still let through, except three that say nothing: a missing ROS_DISTRO, a publisher without readers, and
    // leaving a multicast group that loopback never joined.
    let default = format!(
        "{level},rustdds=error,rustdds::network::udp_listener=off,ros2_client=error,ros2_client::distributions=off,ros2_client::node=off,zenoh=error"
    );
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let lines = fmt().with_env_filter(filter).with_writer(|| held_log::Writer).with_target(false);
    // A second start (in tests) leaves the first in place.
    let _ = match format {
        LogFormat::Text => {
            let colour = std::io::IsTerminal::is_terminal(&std::io::stderr());
            lines.with_ansi(colour).try_init()
        }
        LogFormat::Json => lines.json().try_init(),
    };
}
