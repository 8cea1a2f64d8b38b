//! A damper's node as a whole.

pub mod actions;
mod can_threads;
pub mod checks;
pub mod damper_node;
pub mod fleet;
pub mod services;
