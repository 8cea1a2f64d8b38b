//! How long samples take through the node, counted in buckets that any thread may add to.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Buckets a factor of two.
const PER_OCTAVE: f64 = 4.0;
/// Buckets: from a microsecond to more than a second.
const BUCKETS: usize = 84;

/// Counts of durations since they were last read.
#[derive(Debug)]
pub struct Latency {
    counts: [AtomicU64; BUCKETS],
    worst_ns: AtomicU64,
}

/// What was counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiles {
    /// The median, s, up to 9 % off.
    pub median_s: f64,
    /// What 99 of 100 stay below, s, likewise.
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
    /// Counts `took`.
    pub fn add(&self, took: Duration) {
        let octaves = (took.as_secs_f64() * 1e6).max(1.0).log2();
        // Beyond the last bucket there is the worst one alone.
        let bucket = ((octaves * PER_OCTAVE).round() as usize).min(BUCKETS - 1);
        self.counts[bucket].fetch_add(1, Ordering::Relaxed);
        self.worst_ns.fetch_max(u64::try_from(took.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }

    /// What was counted since the last time, if anything was.
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
            // Middle of the bucket, which may lie above the longest there was.
            bucket.map(|bucket| ((bucket as f64 / PER_OCTAVE).exp2() * 1e-6).min(worst_s))
        };
        if all == 0 {
            return None;
        }
        Some(Quantiles { median_s: below(0.5)?, p99_s: below(0.99)?, worst_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_near_and_counted_once() {
        let latency = Latency::default();
        assert_eq!(latency.take(), None);
        for us in 1..=1000 {
            latency.add(Duration::from_micros(us));
        }
        let told = latency.take().expect("counted");
        assert!((told.median_s / 500e-6 - 1.0).abs() < 0.1, "{told:?}");
        assert!((told.p99_s / 990e-6 - 1.0).abs() < 0.1, "{told:?}");
        assert_eq!(told.worst_s, 1e-3);
        assert_eq!(latency.take(), None);
        latency.add(Duration::from_secs(100));
        let told = latency.take().expect("counted");
        assert_eq!(told.worst_s, 100.0);
        assert!(told.median_s <= told.worst_s);
    }
}
