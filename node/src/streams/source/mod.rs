//! The sources of samples.

pub mod collate;
mod input;
pub mod ros_source;
mod stamp;
mod writers;
pub mod zenoh;

pub use input::{InputTopic, inputs};
pub use writers::Writers;
