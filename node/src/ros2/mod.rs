//! Participant, graph, security, services, log topic.

pub mod answer_limit;
pub mod client;
pub mod close_loop_client;
pub mod dds_threads;
pub(crate) mod first_requests;
pub mod graph;
pub(crate) mod lagging_readers;
pub mod listed_peers;
pub mod participant;
pub(crate) mod participant_ports;
pub mod ros_environment;
pub mod rosout;
pub(crate) mod rtps;
pub mod security;
pub mod service_group;
pub mod types;
