//! A named thread that sleeps until it is woken and ends on request. It is used for the threads on the path of every
//! sample.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle, Result, Thread};
use tracing::Span;

/// Raised when the thread has to end. Check it *before* draining a ring, so that the rest of the ring is still
/// processed.
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
    /// When the system cannot start the thread.
    pub fn start(name: &str, body: impl FnOnce(&Stop) + Send + 'static) -> io::Result<Self> {
        let stop = Arc::new(Stop(AtomicBool::new(false)));
        let thread = Builder::new().name(name.to_owned()).spawn({
            let (stop, span) = (Arc::clone(&stop), Span::current());
            move || {
                // Log lines of the thread carry its damper's name.
                let _inside = span.entered();
                body(&stop);
            }
        })?;
        Ok(Self { stop, thread })
    }

    /// The thread's handle, for waking it.
    #[must_use]
    pub fn thread(&self) -> Thread {
        self.thread.thread().clone()
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Tells the thread to end, wakes it, and waits for it.
    ///
    /// # Errors
    /// The panic's payload, if the thread had panicked.
    pub fn stop(self) -> Result<()> {
        self.stop.0.store(true, Ordering::Release);
        self.thread.thread().unpark();
        self.thread.join()
    }
}
