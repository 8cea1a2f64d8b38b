//! Deployment to a vehicle: the ROS package with its launch files, and DDS-Security (also what needs the hardened build).

mod hardened_security;
mod launch;
mod security;
