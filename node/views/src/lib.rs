//! The terminal screens and the live page of the MR damper force service.
//!
//! | module | content |
//! |---|---|
//! | [`live`] | the demo's screen |
//! | [`watch`] | state of all watched dampers, as JSON and as a screen |
//! | [`serve`] | the web server of the live page |
//! | [`foxglove`] | the endpoint for Foxglove, Lichtblick and PlotJuggler |
//! | [`workshop`] | what the page shows of a workshop and can request of it |
//!
//! This crate uses neither ROS nor Zenoh nor the node: `mr-damper-node` hands over messages and events, and does the work of a workshop
//! behind [`workshop::WorkshopRequests`].

mod error;
pub mod foxglove;
mod http_server;
pub mod live;
pub mod serve;
pub mod watch;
pub mod workshop;

pub use error::ServeError;
