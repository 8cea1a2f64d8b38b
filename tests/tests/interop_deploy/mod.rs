//! How the service is brought to a vehicle: the ROS package with its launch files, DDS-Security.

mod launch;
mod security;
