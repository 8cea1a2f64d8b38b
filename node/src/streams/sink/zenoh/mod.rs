//! The Zenoh mirror publishes the inputs and outputs of a damper's pipeline on Zenoh keys.
//!
//! ```text
//! estimating thread ── ring ──→ zenoh-mirror ──→ state/<topic>  every sample; CBOR, JSON or CDR
//!        └──── unpark ────────────↗   │    └───→ web/<topic>    the newest at 20-50 Hz; JSON
//!                                     │          alive          liveliness token
//!                                  history       meta, history, status; last sample of state/ and web/
//!                                     └──→ zenoh-answers ──↗
//! ```
//!
//! With `zenoh.rmw` (off by default, see `rmw_output.rs`), nodes on rmw_zenoh see the damper as a ROS node with its topics.
//! All other keys of the mirror begin with `mr_damper/<damper>/`. The process has one [`Link`] (the session), each damper
//! has one [`Mirror`]. Tested properties:
//!
//! - The estimating thread shares with this module a ring, an atomic counter and a wake-up, but no lock.
//! - Samples are dropped instead of waited for; a consumer that does not read delays nobody.
//! - By default the node neither listens nor scouts; it uses other interfaces than loopback only if allowed.
//! - `seq` counts the samples of a key from 1. A sample that Zenoh drops or refuses leaves a gap. An event that did not
//!   fit into the ring leaves no gap, because its keys are not known; [`Stats::ring_dropped`], part of `status`, counts it.
//! - Stopping takes less than a second, even when a consumer does not read.
//!
//! Any Zenoh client can read the keys; `tests/interop/zenoh_reader.py` is an example in Python.

mod answer;
mod declarations;
mod encode;
mod history;
mod meta;
mod mirror;
mod payload;
mod rmw_output;
#[cfg(test)]
pub(in crate::streams::sink) mod samples;
mod shared;
mod stats;
mod throttle;
mod time_range;
mod topic;

pub use crate::estimation::wire::ModelNames;
pub use crate::zenoh::session::{Encoding, Link, SessionMode, ZenohConfig, ZenohError};
pub use mirror::{Damper, Mirror, Renamer};
pub use rmw_output::RmwPresence;
pub use stats::{CommandCounters, CommandStats, MirrorState, RmwCounters, RmwStats, RouteStats, Stats};
pub use time_range::{TimeProblem, TimeRange, TimeRangeError};
pub use topic::Topic;
