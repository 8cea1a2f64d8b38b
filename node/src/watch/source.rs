//! Where dampers are heard, as whoever starts a view says.

use super::ros::RosSource;
use super::wall::{Origin, Wall};
use super::zenoh::ZenohSource;
use crate::command::Surroundings;
use crate::config::Config;
use crate::error::NodeError;
use crate::ros;
use std::path::PathBuf;

/// What is watched.
#[derive(Debug, Clone, clap::Args)]
pub struct SourceArgs {
    /// Watch these dampers alone, by their namespaces, e.g. front_left,front_right.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub dampers: Vec<String>,
    /// Watch the Zenoh mirror at this address, e.g. tcp/127.0.0.1:7447, and not ROS. The mirror thins what it sends to
    /// zenoh.web_rate_hz.
    #[arg(long, value_name = "ENDPOINT", conflicts_with = "domain_id")]
    pub zenoh: Option<String>,
    /// Zenoh's own configuration file (JSON5), as the node's parameter zenoh.config: user and password, certificates.
    #[arg(long, value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", default_value_t = -1, value_parser = ros::domain_flag)]
    pub domain_id: i64,
}

impl SourceArgs {
    /// Where news will come from.
    #[must_use]
    pub const fn origin(&self) -> Origin {
        if self.zenoh.is_some() { Origin::Zenoh } else { Origin::Ros }
    }
}

/// Where dampers are heard.
pub enum Source {
    /// On ROS topics.
    Ros(Box<RosSource>),
    /// On the Zenoh mirror.
    Zenoh(ZenohSource),
}

impl Source {
    /// Begins to listen; in ROS as the node called `name`, unless it is given another.
    ///
    /// # Errors
    /// Those of [`RosSource::start`] and [`ZenohSource::start`].
    pub fn start(args: &SourceArgs, around: &Surroundings, name: &str) -> Result<Self, NodeError> {
        if let Some(endpoint) = &args.zenoh {
            return ZenohSource::start(endpoint, args.zenoh_config.as_deref(), &args.dampers)
                .map(Self::Zenoh);
        }
        // clap's own `requires` gives way where --zenoh conflicts with something that was given.
        if let Some(file) = &args.zenoh_config {
            return Err(NodeError::Usage(format!(
                "--zenoh-config {} goes with --zenoh ENDPOINT, which is missing: ROS is watched without it",
                file.display()
            )));
        }
        let config = Config { domain_id: args.domain_id, ..Config::default() };
        let name = around.ros_args.node.as_deref().unwrap_or(name);
        RosSource::start(&config, &around.ros_args, name, &args.dampers)
            .map(|source| Self::Ros(Box::new(source)))
    }

    /// Brings what has come onto the wall.
    ///
    /// # Errors
    /// When DDS refuses a subscription, or ROS has ended.
    pub fn bring(&mut self, wall: &mut Wall, now_s: f64) -> Result<(), NodeError> {
        match self {
            Self::Ros(source) => {
                source.look(wall, now_s)?;
                source.drain(wall, now_s);
                source.check()?;
            }
            // It connects again by itself.
            Self::Zenoh(source) => {
                source.look(wall, now_s);
                source.drain(wall, now_s);
            }
        }
        Ok(())
    }

    /// Never shows the damper in the ROS namespace `namespace`. The mirror on Zenoh has its own names.
    pub fn leave_out(&mut self, namespace: &str) {
        if let Self::Ros(source) = self {
            source.leave_out(namespace);
        }
    }

    /// The dampers that can be asked for something, by ROS: name and namespace. Through the mirror on Zenoh there are none.
    #[must_use]
    pub fn askable(&self) -> Vec<(String, String)> {
        match self {
            Self::Ros(source) => {
                source.watched().map(|(name, namespace)| (name.to_owned(), namespace.to_owned())).collect()
            }
            Self::Zenoh(_) => Vec::new(),
        }
    }

    /// Ends it.
    pub fn stop(self) {
        match self {
            Self::Ros(source) => source.stop(),
            Self::Zenoh(source) => source.stop(),
        }
    }
}
