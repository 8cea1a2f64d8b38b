//! Independent pieces of work on all threads, with the results in order.
//!
//! The iterators of rayon are compiled again at each place that uses them: for fifty places they were a sixth of this crate's code, and of
//! the time to compile it. Here rayon sees one type of work, whatever the pieces are. A piece should take microseconds at least: each costs
//! a virtual call and an uncontended lock.

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use std::sync::{Mutex, PoisonError};

/// `of` each of `items`, in their order.
pub(crate) fn map<T: Sync, R: Send>(items: &[T], of: impl Fn(&T) -> R + Sync) -> Vec<R> {
    map_indices(items.len(), |index| of(&items[index]))
}

/// `of` each of `items`, which it consumes, in their order.
pub(crate) fn map_owned<T: Send, R: Send>(items: Vec<T>, of: impl Fn(T) -> R + Sync) -> Vec<R> {
    let items: Vec<Mutex<Option<T>>> = items.into_iter().map(|item| Mutex::new(Some(item))).collect();
    // No thread panics while it holds a lock.
    let take = |index: usize| items[index].lock().unwrap_or_else(PoisonError::into_inner).take();
    map_indices(items.len(), |index| take(index).map(&of)).into_iter().flatten().collect()
}

/// `of` each index below `count`, in order.
pub(crate) fn map_indices<R: Send>(count: usize, of: impl Fn(usize) -> R + Sync) -> Vec<R> {
    let results: Vec<Mutex<Option<R>>> = (0..count).map(|_| Mutex::new(None)).collect();
    // No thread panics while it holds a lock.
    for_each_index(count, &|index| {
        let result = of(index);
        *results[index].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    });
    let mut all = Vec::with_capacity(count);
    for result in results {
        all.extend(result.into_inner().unwrap_or_else(PoisonError::into_inner));
    }
    all
}

/// Calls `work` once with each index below `count`.
fn for_each_index(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn results_are_in_order_on_any_number_of_threads() {
        let items: Vec<u64> = (0..1000).collect();
        for threads in [1, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let squares = pool.install(|| map(&items, |item| item * item));
            assert!(squares.iter().zip(&items).all(|(square, item)| *square == item * item));
            assert_eq!(squares.len(), items.len());
            assert_eq!(pool.install(|| map_owned(items.clone(), |item| item * item)), squares);
        }
        assert!(map_indices(0, |index| index).is_empty());
    }

    #[test]
    fn each_index_is_worked_on_once_also_by_work_that_is_parallel_itself() {
        let calls = AtomicUsize::new(0);
        let sums = map_indices(20, |outer| {
            map_indices(outer, |inner| {
                calls.fetch_add(1, Ordering::Relaxed);
                inner
            })
            .iter()
            .sum::<usize>()
        });
        assert_eq!(calls.into_inner(), (0..20).sum());
        assert!(sums.iter().enumerate().all(|(outer, sum)| *sum == outer * outer.saturating_sub(1) / 2));
    }

    #[test]
    fn a_panic_of_the_work_reaches_the_caller() {
        let caught = std::panic::catch_unwind(|| map_indices(10, |index| assert_ne!(index, 7)));
        assert!(caught.is_err());
    }
}
