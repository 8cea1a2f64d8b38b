//! The node under faults of the wire, of peers, and of packets on its ports.

mod hardened;
mod malformed;
mod peer_records;
mod readers;
mod stopped;
mod wire;

/// ARX models need the rate they were identified at, which these tests do not use.
const NO_ARX: &[&str] = &["-p", "arx_model:=none"];
