//! Waits for a condition, with a deadline.

use std::time::{Duration, Instant};

/// Deadline of a wait. It is long, because a loaded machine must not fail a test.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);
/// Time between two looks at a condition.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Waits at most [`PATIENCE`] until `found` returns a value, and returns it.
#[track_caller]
pub(crate) fn until<T>(what: &str, mut found: impl FnMut() -> Option<T>) -> T {
    let mut value = None;
    wait_until(what, || {
        value = found();
        value.is_some()
    });
    value.expect("the wait has ended")
}

/// Waits at most [`PATIENCE`] until `done` returns true.
#[track_caller]
pub(crate) fn wait_until(what: &str, done: impl FnMut() -> bool) {
    assert!(comes_true(done), "waited {PATIENCE:?} for {what}");
}

/// Waits at most [`PATIENCE`] until `done` returns true; false if it did not. For a test whose next assertion says more
/// than the message of [`wait_until`].
#[must_use]
pub(crate) fn comes_true(mut done: impl FnMut() -> bool) -> bool {
    let deadline = Instant::now() + PATIENCE;
    while !done() {
        if Instant::now() >= deadline {
            return false;
        }
        std::thread::sleep(LOOK_EVERY);
    }
    true
}
