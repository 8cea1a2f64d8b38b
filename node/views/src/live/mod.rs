//! The live view of a running service, as a screen or as plain lines.
//!
//! ```text
//! events ─→ LiveSummary ─┬→ screen   (a terminal, 20 Hz)
//!                  └→ plain    (no terminal: a line per second, no escape codes)
//! ```
//!
//! This module does not depend on ROS, Zenoh or threads: the owner of the threads feeds the [`LiveSummary`] and shows copies
//! of it. Time is always an argument.

pub mod held_log;
mod live_summary;
mod meter;
pub mod plain;
pub mod screen;
mod terminal;

pub use live_summary::{Alarm, Counts, LiveSummary, ModeChange, RunInfo};
pub use meter::{Histogram, RateMeter};
pub use terminal::{Key, Terminal};

#[cfg(test)]
mod tests;
