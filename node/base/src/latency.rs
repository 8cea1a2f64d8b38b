//! A histogram of the time that samples take through the node. Any thread can add to it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Buckets per factor of two.
const PER_OCTAVE: u32 = 4;
/// Number of buckets: from 1 ns to 8 s.
const BUCKETS: usize = 33 * PER_OCTAVE as usize;

/// Counts of durations since the last read.
#[derive(Debug)]
pub struct Latency {
    counts: [AtomicU64; BUCKETS],
    worst_ns: AtomicU64,
}

/// Quantiles of the counted durations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiles {
    /// The median, s, with an error of up to 12 %.
    pub median_s: f64,
    /// The 99th percentile, s, with the same error.
    pub p99_s: f64,
    /// The longest, s.
    pub worst_s: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { counts: [const { AtomicU64::new(0) }; BUCKETS], worst_ns: AtomicU64::new(0) }
    }
}

impl Latency {
    /// Counts `took`. It is cheap (two additions, no floating point), because the estimating thread calls it.
    #[inline]
    pub fn add(&self, took: Duration) {
        let ns = u64::try_from(took.as_nanos()).unwrap_or(u64::MAX).max(1);
        // The leading bit gives the octave, the next two bits the bucket within it.
        let octave = ns.ilog2();
        let within =
            if octave < 2 { ns << (2 - octave) } else { ns >> (octave - 2) } & u64::from(PER_OCTAVE - 1);
        // Longer durations go into the last bucket; the worst is kept exactly.
        let bucket = (octave * PER_OCTAVE) as usize + within as usize;
        self.counts[bucket.min(BUCKETS - 1)].fetch_add(1, Ordering::Relaxed);
        self.worst_ns.fetch_max(ns, Ordering::Relaxed);
    }

    /// The quantiles since the last call; `None` if nothing was counted.
    pub fn take(&self) -> Option<Quantiles> {
        let counts: Vec<u64> = self.counts.iter().map(|count| count.swap(0, Ordering::Relaxed)).collect();
        let worst_s = self.worst_ns.swap(0, Ordering::Relaxed) as f64 * 1e-9;
        let all: u64 = counts.iter().sum();
        let below = |share: f64| {
            let mut left = (share * all as f64).ceil() as u64;
            let bucket = counts.iter().position(|count| {
                let reached = *count >= left;
                left = left.saturating_sub(*count);
                reached
            });
            // The middle of the bucket can exceed the longest duration.
            bucket.map(|bucket| (middle_ns(bucket) * 1e-9).min(worst_s))
        };
        if all == 0 {
            return None;
        }
        Some(Quantiles { median_s: below(0.5)?, p99_s: below(0.99)?, worst_s })
    }
}

/// The middle of a bucket, ns.
fn middle_ns(bucket: usize) -> f64 {
    let per_octave = PER_OCTAVE as usize;
    let (octave, within) = (bucket / per_octave, bucket % per_octave);
    (1.0 + (within as f64 + 0.5) / f64::from(PER_OCTAVE)) * (octave as f64).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_is_accurate_to_an_eighth() {
        let latency = Latency::default();
        for ns in (1..5000).chain((1..230).map(|k| 5000.0 * 1.07_f64.powi(k)).map(|ns| ns as u64)) {
            latency.add(Duration::from_nanos(ns));
            // Keep the worst large, so that it does not cut off the middle of the bucket.
            latency.worst_ns.store(u64::MAX, Ordering::Relaxed);
            let read_ns = latency.take().expect("counted").median_s * 1e9;
            let off = read_ns / ns as f64 - 1.0;
            assert!(off.abs() <= 0.125 + 1e-9 || ns > 8_000_000_000, "{ns} ns read as {read_ns}");
        }
    }

    #[test]
    fn quantiles_are_near_and_counted_once() {
        let latency = Latency::default();
        assert_eq!(latency.take(), None);
        for us in 1..=1000 {
            latency.add(Duration::from_micros(us));
        }
        let quantiles = latency.take().expect("counted");
        assert!((quantiles.median_s / 500e-6 - 1.0).abs() < 0.125, "{quantiles:?}");
        assert!((quantiles.p99_s / 990e-6 - 1.0).abs() < 0.125, "{quantiles:?}");
        assert_eq!(quantiles.worst_s, 1e-3);
        assert_eq!(latency.take(), None);
        latency.add(Duration::from_secs(100));
        let quantiles = latency.take().expect("counted");
        assert_eq!(quantiles.worst_s, 100.0);
        assert!(quantiles.median_s <= quantiles.worst_s);
    }
}
