//! Limits of the process, the kind of build, and panics of middleware threads.

pub mod files;
pub mod hardened;
pub mod panics;
