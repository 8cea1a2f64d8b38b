//! A damper's node as a whole.

pub mod actions;
pub mod checks;
pub mod damper_node;
pub mod fleet;
pub mod services;
