//! Live view of dampers for `mr-damper serve` and `mr-damper top`: values, charts and their ages.
//!
//! ```text
//! ROS topics ───→ ros.rs ───┬→ News ─→ Picture (one per damper) ─→ Wall (all) ─┬→ JSON ─→ serve/
//! Zenoh mirror ─→ zenoh.rs ─┘                                                  └→ screen.rs, on the terminal
//! ```
//!
//! A view is an ordinary subscriber and sends nothing to a node. Only `ros.rs` uses ROS, and only `zenoh.rs` uses Zenoh; the rest is
//! plain data with time as an argument.

pub mod found;
mod hall;
mod news;
mod picture;
pub mod ros;
pub mod screen;
mod slope;
pub mod source;
mod state;
mod trail;
mod wall;
pub mod zenoh;

pub use hall::Hall;
pub use news::{News, TOPICS};
pub use picture::{Cursor, Picture, Points, STALE_S};
pub use state::{Aged, Change, Command, Drive, Estimate, Level, Measured, Residual, State};
pub use trail::{KEPT_S, Point, Trail};
pub use wall::{MOST_DAMPERS, Origin, SCHEMA, Snapshot, Wall, json};

#[cfg(test)]
mod tests;
