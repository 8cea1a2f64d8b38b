//! The MR damper force service: a ROS 2 node, its Zenoh mirror, and the tools around them.
//!
//! `ARCHITECTURE.md` in this crate's directory gives the overview. In short: a source fills a wait-free ring; the
//! estimating thread steps the pipeline of `mr-damper-model`; one ring per sink carries the events to ROS, Zenoh and
//! the screen.

pub mod actions;
pub mod answer_limit;
pub mod changes;
pub mod cli;
pub mod client;
pub mod close_loop_client;
pub mod command;
pub mod config;
pub mod control;
pub mod damper_node;
pub mod dds_threads;
pub mod diagnostics;
pub mod doctor;
pub mod error;
pub mod estimator;
pub mod event_log;
pub mod files;
mod first_requests;
pub mod fleet;
pub mod frame;
pub mod graph;
pub mod hardened;
pub mod history;
pub mod interrupt;
mod lagging_readers;
pub mod lifecycle;
pub mod listed_peers;
pub mod logging;
pub mod memory;
mod mode_log;
pub mod models;
pub mod overseer;
pub mod panics;
pub mod parameters;
mod participant_ports;
pub mod player;
pub mod rmw;
pub mod ros;
pub mod ros_environment;
pub mod rosout;
mod rtps;
pub mod security;
pub mod service_group;
pub mod services;
pub mod sink;
pub mod source;
pub mod task;
pub mod types;
pub mod watch;
pub mod wire;
pub mod workshop;
pub mod zenoh_session;

pub use error::NodeError;
