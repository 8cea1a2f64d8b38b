//! The node under faults: of the wire, of peers, of what comes on its ports.

mod hardened;
mod malformed;
mod readers;
mod stopped;
mod told;
mod wire;

/// ARX models want the rate that they were identified at, which is none of these tests' business.
const NO_ARX: &[&str] = &["-p", "arx_model:=none"];
