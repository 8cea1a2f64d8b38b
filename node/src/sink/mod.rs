//! Where events go: one ring and one thread a sink.

pub mod ros;
pub mod zenoh;
