//! Endpoints of the tests, and Zenoh sessions at them.

use crate::wait::wait_until;
use std::net::{TcpListener, TcpStream};
use zenoh::{Session, Wait};

/// An endpoint whose port was free a moment ago.
pub(crate) fn endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("loopback has a free port");
    let address = listener.local_addr().expect("a bound socket has an address");
    drop(listener);
    // A process that another test starts holds this socket, too, until its program runs.
    wait_until("nobody listens at the port", || TcpStream::connect(address).is_err());
    format!("tcp/{address}")
}

/// A session that connects only to `endpoint`.
pub(crate) fn session(endpoint: &str, settings: &[(&str, String)]) -> Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"peer\"".to_owned()),
        ("listen/endpoints", "[]".to_owned()),
        ("connect/endpoints", format!("[\"{endpoint}\"]")),
        ("connect/retry", "{ period_init_ms: 100, period_max_ms: 1000 }".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).expect("these are Zenoh's settings");
    }
    for (key, value) in settings {
        config.insert_json5(key, value).expect("these are Zenoh's settings");
    }
    zenoh::open(config).wait().expect("a peer always opens")
}

/// A router that listens at `endpoint`.
pub(crate) fn router(endpoint: &str) -> Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[\"{endpoint}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).expect("these are Zenoh's settings");
    }
    zenoh::open(config).wait().expect("the port is free")
}
