//! The MR damper force service: a ROS 2 node, its Zenoh mirror, and the tools around them.
//!
//! `ARCHITECTURE.md` in this crate's directory gives the overview. In short: a source fills a wait-free ring; the
//! estimating thread steps the pipeline of `mr-damper-model`; one ring per sink carries the events to ROS, Zenoh and
//! the screen.

pub mod commands;
pub mod estimation;
pub mod nodes;
pub mod process;
pub mod ros2;
pub mod settings;
pub mod streams;
pub mod views;
pub mod watchdogs;
pub mod zenoh;

pub use settings::error::NodeError;
