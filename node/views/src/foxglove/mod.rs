//! The endpoint for viewers that speak the Foxglove WebSocket protocol: Foxglove, Lichtblick, PlotJuggler.
//!
//! ```text
//! receiving thread ─→ Channels::publish ─┬→ queue of a viewer ─→ viewer.rs ─→ WebSocket     server.rs, one thread for all viewers
//!                                        └→ queue of a viewer ─→ ...
//! ```
//!
//! A channel is a topic with the definition of its ROS 2 type (`ros2msg`), and its messages are CDR, as in the bags that `mr-damper
//! record` writes. A message is sent only to viewers that subscribed to its channel.
//!
//! The endpoint is read-only: it offers no capability that changes anything, and refuses such requests with a status. It listens on
//! loopback by default and checks the host and the origin of a request. A viewer that does not keep up loses the oldest messages, and they
//! are counted (`queue.rs`); nothing waits for it.

mod channels;
mod parameters;
mod protocol;
mod queue;
mod server;
mod viewer;

pub use channels::{ChannelId, Channels};
pub use server::{FoxgloveServer, require_loopback_for_viewers};

#[cfg(test)]
mod tests;
