//! Log lines wait while a screen is up: on the same terminal they would run through it.
//!
//! The logger writes through [`Writer`]; the screen calls [`hold`] when it goes up. What was held is written when
//! the guard is dropped. Lines that go to a file or a pipe are never held.

use std::io::{IsTerminal, Write};
use std::sync::{Mutex, PoisonError};

/// Bytes that are held at most; from there on lines are dropped and the end says so.
const MOST_HELD: usize = 1 << 20;

static HELD: Mutex<Option<Vec<u8>>> = Mutex::new(None);

/// Standard error, but for what is held.
#[derive(Debug, Clone, Copy, Default)]
pub struct Writer;

impl Write for Writer {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match HELD.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            Some(held) => {
                if held.len() + bytes.len() <= MOST_HELD {
                    held.extend_from_slice(bytes);
                }
                Ok(bytes.len())
            }
            None => std::io::stderr().write(bytes),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        std::io::stderr().flush()
    }
}

/// Holds log lines until it is dropped.
#[derive(Debug)]
pub struct Hold(());

/// Holds log lines from now on, if standard error is a terminal.
#[must_use]
pub fn hold() -> Hold {
    if std::io::stderr().is_terminal() {
        HELD.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(Vec::new);
    }
    Hold(())
}

impl Drop for Hold {
    fn drop(&mut self) {
        let held = HELD.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(held) = held {
            // Nothing can be done about a terminal that is gone.
            let _ = std::io::stderr().write_all(&held);
        }
    }
}
