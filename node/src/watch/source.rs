//! Source of the data for a view: ROS topics or the Zenoh mirror, as the command line says.

use super::ros::RosSource;
use super::wall::{Origin, Wall};
use super::zenoh::ZenohSource;
use crate::command::Surroundings;
use crate::config::Config;
use crate::error::NodeError;
use crate::ros;
use std::path::PathBuf;

/// Options that select the dampers to watch.
#[derive(Debug, Clone, clap::Args)]
pub struct SourceArgs {
    /// Watch only these dampers, given by their namespaces, e.g. front_left,front_right.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub dampers: Vec<String>,
    /// Watch the Zenoh mirror at this address, e.g. tcp/127.0.0.1:7447, instead of ROS. The mirror limits the rate of each
    /// topic to zenoh.web_rate_hz.
    #[arg(long, value_name = "ENDPOINT", conflicts_with = "domain_id")]
    pub zenoh: Option<String>,
    /// Zenoh configuration file (JSON5) with user, password and certificates, like the node's parameter zenoh.config.
    #[arg(long, value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// ROS domain; by default ROS_DOMAIN_ID, or 0 if that is not set.
    #[arg(long, value_name = "ID", default_value_t = -1, value_parser = ros::domain_flag)]
    pub domain_id: i64,
}

impl SourceArgs {
    /// Origin of the data.
    #[must_use]
    pub const fn origin(&self) -> Origin {
        if self.zenoh.is_some() { Origin::Zenoh } else { Origin::Ros }
    }
}

/// A source of data.
pub enum Source {
    /// ROS topics.
    Ros(Box<RosSource>),
    /// The Zenoh mirror.
    Zenoh(ZenohSource),
}

impl Source {
    /// Starts the source. In ROS it is a node named `name`, unless the ROS arguments give another name.
    ///
    /// # Errors
    /// Errors of [`RosSource::start`] and [`ZenohSource::start`].
    pub fn start(args: &SourceArgs, around: &Surroundings, name: &str) -> Result<Self, NodeError> {
        if let Some(endpoint) = &args.zenoh {
            return ZenohSource::start(endpoint, args.zenoh_config.as_deref(), &args.dampers)
                .map(Self::Zenoh);
        }
        // Checked here, because clap's `requires` is not enforced when --zenoh conflicts with another given option.
        if let Some(file) = &args.zenoh_config {
            return Err(NodeError::Usage(format!(
                "--zenoh-config {} needs --zenoh ENDPOINT, which is missing: without it, ROS is watched",
                file.display()
            )));
        }
        let config = Config { domain_id: args.domain_id, ..Config::default() };
        let name = around.ros_args.node.as_deref().unwrap_or(name);
        RosSource::start(&config, &around.ros_args, name, &args.dampers)
            .map(|source| Self::Ros(Box::new(source)))
    }

    /// Records all received messages in the view `wall`.
    ///
    /// # Errors
    /// When a subscription fails, or ROS has ended.
    pub fn bring(&mut self, wall: &mut Wall, now_s: f64) -> Result<(), NodeError> {
        match self {
            Self::Ros(source) => {
                source.look(wall, now_s)?;
                source.drain(wall, now_s);
                source.check()?;
            }
            // Zenoh reconnects by itself.
            Self::Zenoh(source) => {
                source.look(wall, now_s);
                source.drain(wall, now_s);
            }
        }
        Ok(())
    }

    /// Ignores the damper in the ROS namespace `namespace`. This has no effect on a Zenoh source.
    pub fn leave_out(&mut self, namespace: &str) {
        if let Self::Ros(source) = self {
            source.leave_out(namespace);
        }
    }

    /// Names and namespaces of the dampers that can be asked for a diagnosis over ROS; none with a Zenoh source.
    #[must_use]
    pub fn askable(&self) -> Vec<(String, String)> {
        match self {
            Self::Ros(source) => {
                source.watched().map(|(name, namespace)| (name.to_owned(), namespace.to_owned())).collect()
            }
            Self::Zenoh(_) => Vec::new(),
        }
    }

    /// Stops the source.
    pub fn stop(self) {
        match self {
            Self::Ros(source) => source.stop(),
            Self::Zenoh(source) => source.stop(),
        }
    }
}
