//! Zenoh session, naming rules of rmw_zenoh.

pub mod rmw;
pub mod session;
