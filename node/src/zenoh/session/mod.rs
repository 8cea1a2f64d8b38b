//! The Zenoh session of the process: its settings, their checks, and its errors.
//!
//! The mirror (`sink/zenoh`), the commands and inputs (`source/zenoh`) and the viewers (`watch`) use one [`Link`].

mod config;
mod error;
mod link;
mod session_config;

pub use config::{Encoding, Rmw, SessionMode, ZenohConfig};
pub use error::{FileProblem, ZenohError};
pub use link::Link;
pub(crate) use link::{Inner, SessionState};
