//! Parallel work on a list, on a fixed number of threads.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of threads: one for each core.
pub(in crate::commands) fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Calls `work` with every index below `count` on `threads` threads and returns the results in the order of the indices.
/// Each thread takes the next index when it is free.
///
/// These threads are not rayon's: an identification waits for its restarts in rayon's pool, and a waiting thread of the pool
/// takes up other work. It would begin a second cell inside the first, and the first cell would report the time of both.
pub(in crate::commands) fn in_parallel<T: Send>(
    count: usize,
    threads: usize,
    work: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
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
    // Every index below `count` has a result: a thread ends only when no index is left.
    results.into_iter().filter_map(take).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_index_is_done_once_and_results_are_in_order() {
        for (count, threads) in [(0, 2), (1, 4), (100, 3), (5, 0)] {
            assert_eq!(in_parallel(count, threads, |k| 2 * k), (0..count).map(|k| 2 * k).collect::<Vec<_>>());
        }
    }
}
