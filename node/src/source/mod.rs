//! Where samples come from.

pub mod collate;
mod input;
pub mod ros;
pub mod zenoh;
