//! Live view of dampers for `mr-damper serve` and `mr-damper top`: values, charts and their ages.
//!
//! ```text
//! ROS topics ───→ ros_watcher.rs ───┬→ DamperMessage ─→ DamperView (each) ─→ DamperRegistry (all) ─┬→ JSON ─→ serve/
//! Zenoh mirror ─→ zenoh_watcher.rs ─┘                                                              └→ screen.rs, on the terminal
//! ```
//!
//! A watcher is an ordinary subscriber and sends nothing to a node. Only `ros_watcher.rs` uses ROS, and only `zenoh_watcher.rs` uses
//! Zenoh; the rest is plain data with time as an argument.

mod damper_message;
mod damper_state;
mod damper_view;
pub mod discovery;
mod point_buffer;
mod registry;
pub mod ros_watcher;
pub mod screen;
mod shared_registry;
mod slope;
pub mod source;
pub mod zenoh_watcher;

pub use damper_message::{DamperMessage, TOPICS};
pub use damper_state::{
    Aged, CommandReading, DamperState, DriveReading, EstimateReading, MeasuredReading, PastModeChange,
    ResidualReading, StatusLevel,
};
pub use damper_view::{ChartCursor, ChartPoints, DamperView, STALE_S};
pub use point_buffer::{ChartPoint, KEPT_S, PointBuffer};
pub use registry::{DamperRegistry, DataOrigin, MOST_DAMPERS, SCHEMA, Snapshot, json};
pub use shared_registry::SharedRegistry;

#[cfg(test)]
mod tests;
