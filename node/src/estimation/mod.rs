//! Models, lifecycle, estimating thread, changes to it, messages.

pub mod control;
pub mod estimator;
pub mod frame;
pub mod lifecycle;
pub mod models;
pub mod wire;
