//! The live view of a running service: what its events amount to, as a screen or as plain lines.
//!
//! ```text
//! events ─→ Board ─┬→ screen   (a terminal, 20 Hz)
//!                  └→ plain    (no terminal: a line a second, no escape codes)
//! ```
//!
//! Nothing here knows of ROS, Zenoh or threads: whoever owns the threads feeds the [`Board`] and shows copies of
//! it. Time is an argument throughout.

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
