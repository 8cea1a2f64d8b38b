//! Watches dampers for `mr-damper serve` and `mr-damper top`.
//!
//! ```text
//! ROS topics ───→ ros_watcher.rs ───┬→ DamperMessage ─→ mr_damper_views::watch
//! Zenoh mirror ─→ zenoh_watcher.rs ─┘
//! ```
//!
//! A watcher is an ordinary subscriber and sends nothing to a node. Only `ros_watcher.rs` uses ROS, and only `zenoh_watcher.rs` uses
//! Zenoh.

pub mod ros_watcher;
pub mod source;
pub mod zenoh_watcher;
