//! What ROS 2 tools expect of a node, and on which hosts it is discovered.

mod hardened;
mod hosts;
mod manage;
mod standard;
