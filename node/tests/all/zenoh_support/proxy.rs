//! A consumer that stops reading, like one that is suspended or has lost its link.

use std::io::{Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::thread;
use std::time::Duration;

/// Time between two looks at whether the consumer still stalls.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Forwards bytes between a consumer and the mirror. While `stalled` is set, it does not read from the mirror. The stall
/// ends when the test drops `stalled`. Returns its endpoint.
pub(crate) fn proxy(to: &str, stalled: &Arc<AtomicBool>) -> String {
    let to = to.trim_start_matches("tcp/").to_owned();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("loopback has a free port");
    let address = listener.local_addr().expect("a bound socket has an address");
    let stalled = Arc::downgrade(stalled);
    thread::spawn(move || {
        while let Ok((consumer, _)) = listener.accept() {
            let mirror = std::net::TcpStream::connect(&to).expect("the mirror listens");
            let halves = [(&consumer, &mirror, None), (&mirror, &consumer, Some(Weak::clone(&stalled)))];
            for (from, to, stall) in halves {
                let mut from = from.try_clone().expect("sockets can be cloned");
                let mut to = to.try_clone().expect("sockets can be cloned");
                thread::spawn(move || {
                    let mut buffer = [0; 4096];
                    while let Ok(length @ 1..) = from.read(&mut buffer) {
                        if to.write_all(&buffer[..length]).is_err() {
                            return;
                        }
                        let stall = || stall.as_ref().and_then(Weak::upgrade);
                        while stall().is_some_and(|stalled| stalled.load(Ordering::Acquire)) {
                            thread::sleep(LOOK_EVERY);
                        }
                    }
                });
            }
        }
    });
    format!("tcp/{address}")
}
