//! The dampers of a process: one service each, started and ended together.
//!
//! They share one participant in the ROS domain and one Zenoh session. They share no path for samples: each damper has
//! its own topics, rings and threads, so that the input of one never reaches another.

use crate::nodes::damper_node::{DamperNode, Process, ThreadsPanicked};
use crate::process::files;
use crate::ros2::rosout;
use crate::settings::config::Damper;
use crate::settings::error::NodeError;

/// The running services, by the names of their dampers.
pub struct Fleet {
    services: Vec<(String, DamperNode)>,
}

impl Fleet {
    /// Starts a service for each of `dampers`.
    ///
    /// # Errors
    /// When one does not start. The message names it, and the services that had started are stopped.
    pub fn start(dampers: &[Damper]) -> Result<Self, NodeError> {
        let Some(first) = dampers.first() else { return Ok(Self { services: Vec::new() }) };
        files::allow(dampers.len());
        let process = Process::join(&first.config, first.args.enclave.as_deref())?;
        let mut fleet = Self { services: Vec::with_capacity(dampers.len()) };
        for damper in dampers {
            // With several dampers, log lines of its threads carry its name.
            let _inside = (dampers.len() > 1).then(|| rosout::span(&damper.args.full_name()).entered());
            match DamperNode::start_in(&process, &damper.config, &damper.args, false) {
                Ok((service, _)) => fleet.services.push((damper.name().to_owned(), service)),
                Err(error) => {
                    if let Err(ended) = fleet.stop() {
                        tracing::error!("{ended}");
                    }
                    return Err(if dampers.len() == 1 {
                        error
                    } else {
                        NodeError::Damper { name: damper.name().to_owned(), why: Box::new(error) }
                    });
                }
            }
        }
        Ok(fleet)
    }

    /// The services, by the names of their dampers.
    pub fn services(&self) -> impl Iterator<Item = (&str, &DamperNode)> {
        self.services.iter().map(|(name, service)| (name.as_str(), service))
    }

    /// A thread that has died, if any: the damper's name and the thread's name.
    #[must_use]
    pub fn dead_thread(&self) -> Option<(&str, &'static str)> {
        self.services().find_map(|(name, service)| Some((name, service.dead_thread()?)))
    }

    /// Ends all services.
    ///
    /// # Errors
    /// The first error of a service that had panicked.
    pub fn stop(self) -> Result<(), ThreadsPanicked> {
        let ended: Vec<_> = self.services.into_iter().map(|(_, service)| service.stop()).collect();
        ended.into_iter().collect()
    }
}
