//! Process and system for every program of the MR damper force service: clock, threads and their priority, advice for disk errors and
//! alarms, text that is safe for a terminal, and the provenance in files and reports.
//!
//! This crate defines no error type of the service and uses neither ROS nor Zenoh.

pub mod alarm;
pub mod clock;
pub mod disk;
pub mod latency;
pub mod provenance;
pub mod realtime;
pub mod shown;
pub mod worker;
