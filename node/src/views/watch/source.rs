//! Source of the data: ROS topics or the Zenoh mirror, as the command line says.

use super::ros_watcher::RosWatcher;
use super::zenoh_watcher::ZenohWatcher;
use crate::ros2::participant::{self, Ros};
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::NodeError;
use mr_damper_views::watch::{DamperMessage, DamperRegistry, DataOrigin};
use std::path::PathBuf;

/// Gets each received message, with the full name of its topic, such as `/front_left/force_estimate`.
pub type Seen<'a> = &'a mut dyn FnMut(&str, &DamperMessage);

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
    #[arg(long, value_name = "ID", default_value_t = -1, value_parser = participant::domain_flag)]
    pub domain_id: i64,
}

impl SourceArgs {
    /// Origin of the data.
    #[must_use]
    pub const fn origin(&self) -> DataOrigin {
        if self.zenoh.is_some() { DataOrigin::Zenoh } else { DataOrigin::Ros }
    }
}

/// A source of data.
pub enum DataSource {
    /// ROS topics.
    Ros(Box<RosWatcher>),
    /// The Zenoh mirror.
    Zenoh(ZenohWatcher),
}

impl DataSource {
    /// Starts the source. In ROS it is a node named `name`, unless the ROS arguments give another name.
    ///
    /// # Errors
    /// Errors of [`RosWatcher::start`] and [`ZenohWatcher::start`].
    pub fn start(args: &SourceArgs, ros_args: &RosArgs, name: &str) -> Result<Self, NodeError> {
        if let Some(endpoint) = &args.zenoh {
            return ZenohWatcher::start(endpoint, args.zenoh_config.as_deref(), &args.dampers)
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
        let name = ros_args.node.as_deref().unwrap_or(name);
        RosWatcher::start(&config, ros_args, name, &args.dampers).map(|watcher| Self::Ros(Box::new(watcher)))
    }

    /// Records all received messages in `registry`, and shows each to `seen`.
    ///
    /// # Errors
    /// When a subscription fails, or ROS has ended.
    pub fn poll(
        &mut self,
        registry: &mut DamperRegistry,
        now_s: f64,
        seen: Seen<'_>,
    ) -> Result<(), NodeError> {
        match self {
            Self::Ros(watcher) => {
                watcher.discover(registry, now_s)?;
                watcher.drain(registry, now_s, seen);
                watcher.check()?;
            }
            // Zenoh reconnects by itself.
            Self::Zenoh(watcher) => {
                watcher.check_connection(registry, now_s);
                watcher.drain(registry, now_s, seen);
            }
        }
        Ok(())
    }

    /// Full names of the topics that are subscribed to, with the names that they have in the node; none with a Zenoh source, whose topics
    /// are known once a sample arrives.
    #[must_use]
    pub fn topics(&self) -> Vec<(String, &'static str)> {
        match self {
            Self::Ros(watcher) => {
                watcher.topics().map(|(name, in_node)| (name.to_owned(), in_node)).collect()
            }
            Self::Zenoh(_) => Vec::new(),
        }
    }

    /// Number of [`DataSource::topics`].
    #[must_use]
    pub fn topic_count(&self) -> usize {
        match self {
            Self::Ros(watcher) => watcher.topics().count(),
            Self::Zenoh(_) => 0,
        }
    }

    /// The node of this source in ROS; `None` with a Zenoh source.
    pub fn ros_mut(&mut self) -> Option<&mut Ros> {
        match self {
            Self::Ros(watcher) => Some(watcher.ros_mut()),
            Self::Zenoh(_) => None,
        }
    }

    /// Ignores the damper in the ROS namespace `namespace`. This has no effect on a Zenoh source.
    pub fn ignore(&mut self, namespace: &str) {
        if let Self::Ros(watcher) = self {
            watcher.ignore(namespace);
        }
    }

    /// Names and namespaces of the dampers that can be asked for a diagnosis over ROS; none with a Zenoh source.
    #[must_use]
    pub fn diagnosable(&self) -> Vec<(String, String)> {
        match self {
            Self::Ros(watcher) => {
                watcher.watched().map(|(name, namespace)| (name.to_owned(), namespace.to_owned())).collect()
            }
            Self::Zenoh(_) => Vec::new(),
        }
    }

    /// Stops the source.
    pub fn stop(self) {
        match self {
            Self::Ros(watcher) => watcher.stop(),
            Self::Zenoh(watcher) => watcher.stop(),
        }
    }
}
