//! The node under faults: of the wire, of peers, of what comes on its ports.

mod told;
mod wire;
