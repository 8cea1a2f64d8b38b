//! How the service is brought to a vehicle: the ROS package with its launch files, DDS-Security (and what of it takes the hardened build).

mod hardened_security;
mod launch;
mod security;
