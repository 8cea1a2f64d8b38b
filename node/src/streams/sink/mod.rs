//! Sinks for the pipeline's events. Each sink has its own ring and thread.

pub mod can;
pub mod ros_sink;
mod standard;
pub mod zenoh;
