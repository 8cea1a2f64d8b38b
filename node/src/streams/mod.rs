//! Samples and commands in, results out, playing a run.

pub mod can;
pub mod changes;
pub mod parameters;
pub mod player;
pub mod sink;
pub mod source;
