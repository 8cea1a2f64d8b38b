//! What ROS 2 tools expect of a node, and where it is found.

mod hardened;
mod hosts;
mod manage;
