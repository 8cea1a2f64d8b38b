//! A consumer that stops reading, like one that is suspended or has lost its link.

use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// Forwards bytes between a consumer and the mirror. Once `stalled` is set, it no longer reads from the
/// mirror. Returns its endpoint.
pub(crate) fn proxy(to: &str, stalled: &Arc<AtomicBool>) -> String {
    let to = to.trim_start_matches("tcp/").to_owned();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("loopback has a free port");
    let address = listener.local_addr().expect("a bound socket has an address");
    let stalled = Arc::clone(stalled);
    thread::spawn(move || {
        while let Ok((consumer, _)) = listener.accept() {
            let mirror = std::net::TcpStream::connect(&to).expect("the mirror listens");
            let halves = [(&consumer, &mirror, None), (&mirror, &consumer, Some(Arc::clone(&stalled)))];
            for (from, to, stall) in halves {
                let mut from = from.try_clone().expect("sockets can be cloned");
                let mut to = to.try_clone().expect("sockets can be cloned");
                thread::spawn(move || {
                    let mut buffer = [0; 4096];
                    while let Ok(length @ 1..) = from.read(&mut buffer) {
                        if to.write_all(&buffer[..length]).is_err() {
                            return;
                        }
                        while stall.as_ref().is_some_and(|stall| stall.load(Ordering::Acquire)) {
                            thread::sleep(Duration::from_millis(5));
                        }
                    }
                });
            }
        }
    });
    format!("tcp/{address}")
}
