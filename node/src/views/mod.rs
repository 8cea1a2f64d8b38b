//! The sources and the work behind the views.

pub mod foxglove;
pub mod watch;
pub mod workshop;
