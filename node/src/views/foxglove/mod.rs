//! The data of the Foxglove endpoint (`mr_damper_views::foxglove`): the messages that the watchers receive, or a recording.
//!
//! ```text
//! watch/ ───────────→ live.rs ──────┬→ Channels ─→ viewers
//! mr-damper-runs ───→ recording.rs ─┤
//! nodes (if asked) ─→ parameters.rs ┘
//! ```

pub mod args;
pub mod live;
pub mod parameters;
pub mod recording;
