//! The live view of a running service, as a screen or as plain lines.
//!
//! ```text
//! events ─→ Board ─┬→ screen   (a terminal, 20 Hz)
//!                  └→ plain    (no terminal: a line per second, no escape codes)
//! ```
//!
//! This module does not depend on ROS, Zenoh or threads: the owner of the threads feeds the [`Board`] and shows copies
//! of it. Time is always an argument.

mod board;
pub mod held_log;
mod meter;
pub mod plain;
pub mod screen;
mod terminal;

pub use board::{Alarm, Board, Change, Counts, Headline};
pub use meter::{Histogram, RateMeter};
pub use terminal::{Key, Terminal};

#[cfg(test)]
mod tests;
