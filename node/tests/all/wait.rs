//! Waits for a condition, with a deadline.

use std::time::{Duration, Instant};

/// Deadline of a wait. It is long, because a loaded machine must not fail a test.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);
/// Time between two looks at a condition.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Waits at most [`PATIENCE`] until `found` returns a value, and returns it.
#[track_caller]
pub(crate) fn until<T>(what: &str, mut found: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = found() {
            return found;
        }
        assert!(Instant::now() < deadline, "waited {PATIENCE:?} for {what}");
        std::thread::sleep(LOOK_EVERY);
    }
}

/// Waits at most [`PATIENCE`] until `done` returns true.
#[track_caller]
pub(crate) fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    until(what, || done().then_some(()));
}
