//! The error type, configuration, signals, async tasks.

pub mod config;
pub mod error;
pub mod interrupt;
pub mod task;
