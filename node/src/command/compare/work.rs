//! A list of work, done by a few threads.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Calls `work` with every index below `count` on `threads` threads, each taking the next index when it is free, and
/// returns the results in the order of the indices.
///
/// These are threads of their own and not rayon's: an identification waits for its restarts in rayon's pool, and a
/// pool's thread that waits takes up other work meanwhile. It would begin a second comparison inside the first, and
/// the time that the first one reports would be that of both.
pub(super) fn in_parallel<T: Send>(count: usize, threads: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
    let serve = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(slot) = results.get(index) else { break };
            let result = work(index);
            *slot.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(result);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.clamp(1, count.max(1)) {
            scope.spawn(serve);
        }
        serve();
    });
    let take = |slot: Mutex<Option<T>>| slot.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    // Every index below `count` was served: a thread ends only when none is left.
    results.into_iter().filter_map(take).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_index_once_and_in_order() {
        for (count, threads) in [(0, 2), (1, 4), (100, 3), (5, 0)] {
            assert_eq!(in_parallel(count, threads, |k| 2 * k), (0..count).map(|k| 2 * k).collect::<Vec<_>>());
        }
    }
}
