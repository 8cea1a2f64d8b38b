//! Where samples come from.

pub mod ros;
