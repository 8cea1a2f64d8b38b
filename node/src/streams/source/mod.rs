//! The sources of samples.

pub mod can;
pub mod collate;
mod input;
pub mod queued;
pub mod ros_source;
mod stamp;
mod unusable;
mod writers;
pub mod zenoh;

pub use input::{InputTopic, TOPICS, inputs};
pub use writers::Writers;
