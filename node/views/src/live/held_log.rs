//! Holds log lines while a screen is shown, because they would disturb it on the same terminal.
//!
//! The logger writes through [`Writer`]. The screen calls [`hold`] when it starts; the held lines are written when the
//! guard is dropped. Lines that go to a file or a pipe are never held.

use std::io::{IsTerminal, Write};
use std::sync::{Mutex, PoisonError};

/// Largest number of bytes that are held; further lines are dropped.
const MOST_HELD: usize = 1 << 20;

static HELD: Mutex<Option<Vec<u8>>> = Mutex::new(None);

/// Standard error, except while lines are held.
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

/// A guard that holds log lines until it is dropped.
#[derive(Debug)]
pub struct Hold(());

/// Starts to hold log lines, if standard error is a terminal.
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
            // If the terminal is gone, the lines cannot be shown.
            let _ = std::io::stderr().write_all(&held);
        }
    }
}
