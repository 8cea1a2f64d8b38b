//! Endpoints of the tests, and Zenoh sessions at them.

use crate::wait::wait_until;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use zenoh::{Session, Wait};

/// The ports of [`endpoint`]. The system gives those from 32768 on to clients, so one of them could be in use when a router starts again.
const PORTS: std::ops::Range<u16> = 20_000..30_000;

/// An endpoint whose port was free a moment ago; each has another port.
pub(crate) fn endpoint() -> String {
    static TAKEN: AtomicUsize = AtomicUsize::new(0);
    // Test programs that run at the same time begin at different ports.
    let first = std::process::id() as usize * 100;
    let address = loop {
        let index = (first + TAKEN.fetch_add(1, Ordering::Relaxed)) % PORTS.len();
        let port = PORTS.start + u16::try_from(index).expect("below the number of ports");
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        if TcpListener::bind(address).is_ok() {
            break address;
        }
    };
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
