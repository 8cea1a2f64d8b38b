//! What observes a running node.

pub mod diagnostics;
pub mod effect_watch;
pub mod event_log;
mod fleet_rows;
pub mod history;
pub mod memory;
pub(crate) mod mode_log;
pub mod overseer;
