//! What is going on, for those who watch: each damper's figures and charts, and how old they are.
//!
//! ```text
//! ROS topics ───→ ros.rs ───┬→ News ─→ Picture (one a damper) ─→ Wall ─┬→ JSON ─→ serve/
//! Zenoh mirror ─→ zenoh.rs ─┘                                       └→ screen.rs, the terminal's
//! ```
//!
//! A watcher is a peer as any other: it subscribes, and nothing of it reaches a node. Only `ros.rs` knows of ROS, and `zenoh.rs` of
//! Zenoh; the rest is plain data, with time as an argument.

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
