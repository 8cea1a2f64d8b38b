//! Where samples come from.

pub mod collate;
pub mod ros;
pub mod zenoh;
