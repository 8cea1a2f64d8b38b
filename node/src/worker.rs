//! A named thread that sleeps until woken and ends when told to: the three threads that every sample passes.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle, Result, Thread};
use tracing::Span;

/// Raised when the thread has to end. What is there by then is still worked off: read it *before* draining a ring.
#[derive(Debug)]
pub struct Stop(AtomicBool);

impl Stop {
    /// True once the thread has to end.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

/// A running thread.
#[derive(Debug)]
pub struct Worker {
    stop: Arc<Stop>,
    thread: JoinHandle<()>,
}

impl Worker {
    /// Runs `body` on a thread called `name`.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub fn start(name: &str, body: impl FnOnce(&Stop) + Send + 'static) -> io::Result<Self> {
        let stop = Arc::new(Stop(AtomicBool::new(false)));
        let thread = Builder::new().name(name.to_owned()).spawn({
            let (stop, span) = (Arc::clone(&stop), Span::current());
            move || {
                // What it logs is its damper's.
                let _inside = span.entered();
                body(&stop);
            }
        })?;
        Ok(Self { stop, thread })
    }

    /// The thread, for waking.
    #[must_use]
    pub fn thread(&self) -> Thread {
        self.thread.thread().clone()
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Tells the thread to end, wakes it, and waits for its end.
    ///
    /// # Errors
    /// The panic's payload, when it had panicked.
    pub fn stop(self) -> Result<()> {
        self.stop.0.store(true, Ordering::Release);
        self.thread.thread().unpark();
        self.thread.join()
    }
}
