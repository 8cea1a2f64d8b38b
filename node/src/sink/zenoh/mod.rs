//! The Zenoh mirror: what enters and leaves a damper's pipeline, on Zenoh keys.
//!
//! ```text
//! estimating thread ── ring ──→ zenoh-mirror ──→ state/<topic>  every sample; CBOR, JSON or CDR
//!        └──── unpark ────────────↗   │    └───→ web/<topic>    the newest at 20-50 Hz; JSON
//!                                     │          alive          liveliness token
//!                                  history       meta, history, status; the last of state/ and web/
//!                                     └──→ zenoh-answers ──↗
//! ```
//!
//! Nodes on rmw_zenoh see the damper as a ROS node with its topics where that is asked for: `rmw.rs`, off by default. The mirror's
//! own keys all begin with `mr_damper/<damper>/`. One [`Link`] (the session) serves the process, one [`Mirror`]
//! each damper. What holds, and is tested:
//!
//! - The estimating thread shares the ring, an atomic counter and a wake-up with this module, no lock.
//! - Samples are dropped rather than waited for; a consumer that does not read holds up nobody.
//! - Nothing listens without being asked, and only on loopback unless allowed; nothing scouts.
//! - `seq` counts the samples of a key from 1. A sample that Zenoh drops or refuses leaves a gap. An event
//!   that the ring had no room for leaves none, because it is not known which keys it belonged to: it is
//!   counted in [`Stats::ring_dropped`], which `status` answers.
//! - Stopping takes less than a second, also when a consumer does not read.
//!
//! To be read with any Zenoh client; `tests/interop/zenoh_reader.py` is one in Python.

mod answer;
mod config;
mod encode;
mod error;
mod history;
mod link;
mod meta;
mod mirror;
mod outlet;
mod payload;
mod plan;
mod rmw;
#[cfg(test)]
mod samples;
mod shared;
mod stats;
mod throttle;
mod time_range;
mod topic;

pub use config::{Encoding, Rmw, SessionMode, ZenohConfig};
pub use error::ZenohError;
pub use link::Link;
pub use mirror::{Damper, Mirror, Renamer};
pub use payload::ModelNames;
pub use rmw::RmwPresence;
pub use stats::{CommandCounters, CommandStats, MirrorState, RmwCounters, RmwStats, RouteStats, Stats};
pub use time_range::TimeRange;
pub use topic::Topic;
