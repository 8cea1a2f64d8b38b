//! Live state of dampers for `mr-damper serve` and `mr-damper top`: values, charts and their ages.
//!
//! ```text
//! DamperMessage ─→ DamperView (each) ─→ DamperRegistry (all) ─┬→ JSON ─→ serve/
//!                                                             └→ screen.rs, on the terminal
//! ```
//!
//! Plain data with time as an argument. `mr-damper-node` subscribes over ROS or Zenoh and hands over the messages.

mod damper_message;
mod damper_state;
mod damper_view;
pub mod discovery;
mod history;
mod point_buffer;
mod registry;
pub mod screen;
mod shared_registry;
mod slope;

pub use damper_message::{DamperMessage, TOPICS, type_of};
pub use damper_state::{
    Aged, CommandReading, DamperState, DriveReading, EstimateReading, MeasuredReading, PastModeChange,
    ResidualReading, StatusLevel,
};
pub use damper_view::{ChartCursor, ChartHistory, ChartPoints, DamperView, STALE_S};
pub use history::{BUCKET_S, Bucket, HISTORY_S, History};
pub use point_buffer::{ChartPoint, KEPT_S, PointBuffer};
pub use registry::{DamperRegistry, DataOrigin, MOST_DAMPERS, SCHEMA, Snapshot, json};
pub use shared_registry::SharedRegistry;

#[cfg(test)]
mod tests;
